"""A price on how far apart pairs of frames are, beside any other cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.queries.moved_points import MovedPoints
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost
from leastaction.systems.costs.configurations import CostOfConfigurations
from leastaction.systems.midpoint import MidpointSystem


@public
class DistanceCost(CostOfConfigurations):
    """Another cost and half the weighted squares of how much farther apart pairs of frames are than is wanted.

    What two frames are off by is ``c = (d^2 - L^2) / (2 L)``, with their distance d and the wanted one, L: nearly d - L
    where these are close, and smooth everywhere. Derivatives are exact. As fit for several threads as the other cost.

    Parameters
    ----------
    cost : Cost
        Such as a `QuadraticCost`.
    system : MidpointSystem
        Whose frames are meant.
    pairs : sequence of (str, str)
        Names of P pairs of frames, whose origins are meant.
    distances : array_like (P,) or (N+1, P)
        How far they are wanted apart (m), more than zero.
    weights : array_like (), (P,) or (N+1, P)
        In units of the cost by m^2, for all instants or for each.

    Raises
    ------
    ArgumentError
        For an unknown frame, a wrong shape, a distance that is not above zero, or a weight that is negative or not
        finite.
    """

    def __init__(
        self,
        cost: Cost,
        system: MidpointSystem,
        pairs: Sequence[tuple[str, str]],
        distances: ArrayLike,
        weights: ArrayLike = 1.0,
    ) -> None:
        super().__init__(cost, "distances", system)
        P, N = len(pairs), system.N
        wanted = as_array(distances, "distances", (P,), (N + 1, P))
        weighed = as_array(weights, "weights", (), (P,), (N + 1, P))
        if not (wanted > 0.0).all():
            raise ArgumentError(f"distances: got {wanted.min():g}, expected numbers > 0 (m); to meet, give a PlaceCost")
        if not (weighed >= 0.0).all():
            raise ArgumentError(f"weights: got {weighed.min():g}, expected numbers >= 0")
        self._ends = [*(one for one, _ in pairs), *(other for _, other in pairs)]
        MovedPoints.of(system.mechanism, self._ends)  # an unknown frame is an error here, not at the first step
        shape = (N + 1, P)
        self._wanted = read_only(np.array(np.broadcast_to(wanted, shape)))
        self._weights = read_only(np.array(np.broadcast_to(weighed, shape)))

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        other = self._over(start, stop, N, nu)
        other._wanted, other._weights = self._wanted[start : stop + 1], self._weights[start : stop + 1]
        return other

    def _prices(self, q: Array, start: int) -> Array:
        rows = slice(start, start + len(q))
        off = self._off(self._points().apart(q), rows)
        return np.asarray(0.5 * np.sum(self._weights[rows] * off**2, axis=1))

    def _slopes(self, q: Array) -> Array:
        points = self._points()
        apart = points.apart(q)
        return np.asarray(np.sum(points.apart_slopes(q, self._pulls(apart)[:, :, None] * apart), axis=1))

    def _bends(self, q: Array, *, exact: bool) -> Array:
        points = self._points()
        apart = points.apart(q)
        # Where two are too far apart, all that moves them farther bends the price too: D^2 c = (D'D + d . D^2 d) / L.
        pull = self._pulls(apart)
        felt = pull if exact else np.maximum(pull, 0.0)  # two that are too close bend it downwards
        bends = points.apart_bent(q, apart, self._weights / self._wanted**2, felt)
        if exact:
            force = pull[:, :, None] * apart
            bends += points.bent(q, np.concatenate([force, -force], axis=1))
        return bends

    def _pulls(self, apart: Array) -> Array:
        """Return what pairs are pulled together with, by how far they are apart (N+1, P, 3), in parts of that."""
        return np.asarray(self._weights * self._off(apart, slice(None)) / self._wanted)

    def _off(self, apart: Array, rows: slice) -> Array:
        """Return what pairs are off by at some instants, by how far they are apart (n, P, 3): (n, P)."""
        wanted = self._wanted[rows]
        return np.asarray((np.sum(apart**2, axis=2) - wanted**2) / (2.0 * wanted))

    def _points(self) -> MovedPoints:
        return MovedPoints.of(self.system.mechanism, self._ends)
