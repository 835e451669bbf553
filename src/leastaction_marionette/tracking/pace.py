"""Whether a search creeps, so that it is worth to begin elsewhere.

A search that is on its way has ever less to gain, or goes on to barriers that are less. One that creeps along a flat
valley expects as much from each iteration as long before, and gets a small part of it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from leastaction.optimal import IterationRecord

LOOKED_BACK: Final = 20
"""Iterations that are compared with as many before."""

_NEVER_BEFORE: Final = 3 * LOOKED_BACK
_AS_MUCH = 0.7  # of the decreases that were expected before are those of a search that gets nowhere
_LITTLE = 0.01  # of its cost is what such a search gains meanwhile
_SHORTLY = 10  # iterations in which the cost of a search that only leads to the next should change
_SOME, _LESS = 5, 0.1  # iterations that expect so little, and how much less than is tolerated


class Pace:
    """How one optimisation gets on. For one thread.

    ``hardly``: of a search that only leads to the next, and need not come near a minimum, the part of its cost that is
    no change.
    """

    def __init__(self, *, hardly: float = 0.0) -> None:
        self._hardly = hardly
        self._expected: list[float] = []
        self._costs: list[float] = []
        self._barrier = np.nan  # when it was last looked at

    def creeps(self, record: IterationRecord) -> bool:
        """Return whether the optimisation creeps; to be told of every iteration."""
        self._expected.append(record.expected_decrease)
        self._costs.append(record.cost)
        iterations = len(self._costs) - 1
        if iterations >= 2 * _SHORTLY:
            change = abs(self._costs[-1 - _SHORTLY] - self._costs[-1])
            if change < self._hardly * abs(self._costs[-1]):
                return True
        if iterations < _NEVER_BEFORE - LOOKED_BACK or iterations % LOOKED_BACK:
            return False
        limits = record.snapshot().limits
        barrier = 0.0 if limits is None else limits.mu
        same, self._barrier = barrier == self._barrier, barrier
        return same and iterations >= _NEVER_BEFORE and self._gets_nowhere()

    def is_there(self, record: IterationRecord, tolerance: float) -> bool:
        """Return whether little is to be gained but what limits are off by, at the last barrier; after `creeps`.

        ``tolerance``: that part of the cost is little.
        """
        latest = self._expected[-_SOME:]
        if len(latest) < _SOME or not max(latest) <= _LESS * tolerance * abs(record.cost):
            return False
        limits = record.snapshot().limits
        barrier = None if limits is None else limits.barrier
        return limits is None or (barrier is not None and limits.mu <= barrier.last_mu * (1.0 + 1e-9))

    def _gets_nowhere(self) -> bool:
        before, now = np.median(np.reshape(self._expected[-2 * LOOKED_BACK :], (2, LOOKED_BACK)), axis=1)
        gained = self._costs[-1 - LOOKED_BACK] - self._costs[-1]
        return bool(now > _AS_MUCH * before and gained < _LITTLE * abs(self._costs[-1]))
