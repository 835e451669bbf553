"""What it costs that springs in the place of strings push, which strings do not.

The price is ``w_i/2 min(0, r_i(q))^2``, with ``r_i`` by how much the spring i may still shrink, and ``w_i`` a price of
the energy that it has where it pushes, times its stiffness.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from leastaction.control.rigs.strings import Strings
from leastaction.numerics.arrays import Array
from leastaction.optimal import Cost
from leastaction.systems.costs.configurations import CostOfConfigurations
from leastaction.systems.midpoint import MidpointSystem


class Pushing:
    """The price of springs that push. Threads may share it.

    ``room`` (N+1, m): how much farther than to no stretch they may shrink at each instant (m); less than nothing where
    they have to pull. ``price`` (1/J).
    """

    def __init__(self, strings: Strings, room: Array, price: float) -> None:
        self.strings, self.room = strings, room
        self._weights = price * strings.stiffness

    def later(self, k: int) -> Pushing:
        """Return the price of what begins at instant k."""
        other = copy(self)
        other.room = self.room[k:]
        return other

    def slack(self, q: Array, start: int) -> Array:
        """Return by how much each is too short (n, m), negative, in configurations (n, nq) from instant `start` on."""
        return np.asarray(np.minimum(self.strings.stretches(q) + self.room[start : start + len(q)], 0.0))

    def prices(self, q: Array, start: int) -> Array:
        """Return the prices (n,) of configurations (n, nq) from instant `start` on."""
        return np.asarray(0.5 * self.slack(q, start) ** 2 @ self._weights)

    def derivatives(self, q: Array, start: int) -> tuple[Array, Array] | None:
        """Return the gradients (n, nq) and Gauss and Newton's Hessians (n, nq, nq); None where none is too short."""
        slack = self.slack(q, start)
        if not slack.any():
            return None
        slopes = self.strings.slopes(q)
        slopes[slack == 0.0] = 0.0
        weighted = np.swapaxes(slopes, 1, 2) * self._weights
        return (weighted @ slack[:, :, None])[:, :, 0], weighted @ slopes


class PushingCost(CostOfConfigurations):
    """Another cost, and that of springs that push; as fit for several threads as the other.

    Its second derivatives are Gauss and Newton's in either case: with those of the stretches a search from a plan for
    strings that do not stretch takes up to twice as many iterations.
    """

    def __init__(self, cost: Cost, system: MidpointSystem, pushing: Pushing) -> None:
        super().__init__(cost, "springs that push", system)
        self._pushing = pushing

    def _prices(self, q: Array, start: int) -> Array:
        return self._pushing.prices(q, start)

    def _slopes(self, q: Array) -> Array:
        found = self._pushing.derivatives(q, 0)
        return np.zeros((len(q), self._nv)) if found is None else found[0]

    def _bends(self, q: Array, *, exact: bool) -> Array:  # noqa: ARG002
        found = self._pushing.derivatives(q, 0)
        return np.zeros((len(q), self._nv, self._nv)) if found is None else found[1]
