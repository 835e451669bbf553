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


class Pace:
    """How one optimisation gets on. For one thread."""

    def __init__(self) -> None:
        self._expected: list[float] = []
        self._costs: list[float] = []
        self._barrier = np.nan  # when it was last looked at

    def creeps(self, record: IterationRecord) -> bool:
        """Return whether the optimisation creeps; to be told of every iteration."""
        self._expected.append(record.expected_decrease)
        self._costs.append(record.cost)
        iterations = len(self._costs) - 1
        if iterations < _NEVER_BEFORE - LOOKED_BACK or iterations % LOOKED_BACK:
            return False
        limits = record.snapshot().limits
        barrier = 0.0 if limits is None else limits.mu
        same, self._barrier = barrier == self._barrier, barrier
        return same and iterations >= _NEVER_BEFORE and self._gets_nowhere()

    def _gets_nowhere(self) -> bool:
        before, now = np.median(np.reshape(self._expected[-2 * LOOKED_BACK :], (2, LOOKED_BACK)), axis=1)
        gained = self._costs[-1 - LOOKED_BACK] - self._costs[-1]
        return bool(now > _AS_MUCH * before and gained < _LITTLE * abs(self._costs[-1]))
