"""Whether a search creeps, so that it is worth to go on elsewhere, or has come as far as it needs to.

A search that is on its way has ever less to gain, or goes on to barriers that are less. One that creeps along a flat
valley expects as much from each iteration as long before, and gets a small part of it. One that only leads to the next
need not come near a minimum.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from leastaction.optimal import IterationRecord, OptimizationResult

_SHORTLY: Final = 10  # iterations in which the cost of a search that only leads to the next should change
_SOME: Final = 5  # iterations that expect little, of a search that is there
_LESS: Final = 0.1  # share of the tolerance that they expect
LOOKED_BACK: Final = 20
"""Iterations that are compared with as many before."""
_AS_MUCH: Final = 0.7  # share of the decreases expected before, which a search expects that gets nowhere
_LITTLE: Final = 0.01  # share of its cost that such a search gains meanwhile


class Pace:
    """How one optimisation gets on. For one thread.

    ``hardly``: of a search that only leads to the next, and need not come near a minimum, the part of its cost that is
    no change. ``earlier``: what it goes on with, as if it had not been stopped.
    """

    def __init__(self, *, hardly: float = 0.0, earlier: OptimizationResult | None = None) -> None:
        self._hardly = hardly
        self._expected = [] if earlier is None else [math.nan, *map(float, earlier.history.expected_decrease)]
        self._barrier = math.nan  # when it was last looked at
        self._costs = [] if earlier is None else [*map(float, earlier.history.cost)]

    def creeps(self, record: IterationRecord) -> bool:
        """Return whether the optimisation creeps; to be told of every iteration."""
        if record.iteration < len(self._costs):
            return False  # where an earlier one was stopped
        self._expected.append(record.expected_decrease)
        self._costs.append(record.cost)
        iterations = len(self._costs) - 1
        if iterations >= 2 * _SHORTLY:
            change = abs(self._costs[-1 - _SHORTLY] - record.cost)
            if change < self._hardly * abs(record.cost):
                return True
        if iterations < 2 * LOOKED_BACK or iterations % LOOKED_BACK:
            return False
        limits = record.snapshot().limits
        barrier = 0.0 if limits is None else limits.mu
        same, self._barrier = barrier == self._barrier, barrier
        return same and iterations >= 3 * LOOKED_BACK and self._gets_nowhere()

    def _gets_nowhere(self) -> bool:
        before, now = np.median(np.reshape(self._expected[-2 * LOOKED_BACK :], (2, LOOKED_BACK)), axis=1)
        gained = self._costs[-1 - LOOKED_BACK] - self._costs[-1]
        return bool(now > _AS_MUCH * before and gained < _LITTLE * abs(self._costs[-1]))

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
