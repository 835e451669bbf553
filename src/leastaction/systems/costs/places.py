"""A price on how far points of frames are from wanted places, beside any other cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.mechanics.mechanism.queries.moved_points import MovedPoints
from leastaction.numerics.arrays import Array, as_number, as_wanted, read_only, require_mapping
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost
from leastaction.systems.costs.configurations import CostOfConfigurations
from leastaction.systems.midpoint import MidpointSystem


@dataclass(frozen=True, eq=False)
class PricedPlaces:
    """Half the weighted squares of the distances of P points from wanted places, at n configurations.

    ``wanted``, ``weights`` (n, P, 3). Derivatives are by the nv directions of configurations.
    """

    points: MovedPoints
    wanted: Array
    weights: Array

    def prices(self, q: Array) -> Array:
        """Return them (n,)."""
        return np.asarray(0.5 * np.sum(self.weights * (self.points.places(q) - self.wanted) ** 2, axis=(1, 2)))

    def slopes(self, q: Array) -> Array:
        """Return their derivatives (n, nv)."""
        return np.asarray(self.points.slopes(q, range(self.wanted.shape[1]), self._pulls(q)).sum(axis=1))

    def bends(self, q: Array, *, exact: bool) -> Array:
        """Return their second derivatives (n, nv, nv), or Gauss and Newton's, where they need not be ``exact``."""
        jacobian = self.points.jacobian(q)
        J = jacobian.reshape(len(q), -1, jacobian.shape[-1])
        total = J.swapaxes(1, 2) @ (self.weights.reshape(len(q), -1, 1) * J)
        if exact:
            total += self.points.bent(q, self._pulls(q))
        return np.asarray(total)

    def _pulls(self, q: Array) -> Array:
        """Return the derivatives by the places (n, P, 3)."""
        return self.weights * (self.points.places(q) - self.wanted)


@public
class PlaceCost(CostOfConfigurations):
    """Another cost and half the weighted squares of the distances of frames from wanted places.

    With exact second derivatives. As fit for several threads as the other cost.

    Parameters
    ----------
    cost : Cost
        Such as a `QuadraticCost`.
    system : MidpointSystem
        Whose frames are meant.
    places : mapping of str to array_like (N+1, 3) or (3,)
        Where the origins of frames are wanted (m), by their names; NaN where anywhere is as good.
    weights : mapping of str to float
        By the same names, in units of the cost by m^2.

    Raises
    ------
    ArgumentError
        For an unknown frame, a wrong shape, or a weight that is negative or not finite.
    """

    def __init__(
        self, cost: Cost, system: MidpointSystem, places: Mapping[str, ArrayLike], weights: Mapping[str, float]
    ) -> None:
        m, N = system.mechanism, system.N
        require_mapping(places, "places", "{'hand': [0.0, 0.3, 1.0]}")
        require_mapping(weights, "weights", "{'hand': 10.0}")
        super().__init__(cost, "places", system, places, weights)
        self._frames = tuple(places)
        wanted, weighed = np.zeros((2, N + 1, len(places), 3))
        for i, (name, given) in enumerate(places.items()):
            m.frame_pose(m.configuration(), name)  # an unknown name is an error here, not at the first step
            place = as_wanted(given, f"places: {name!r}", (N + 1, 3), (3,))
            weight = as_number(weights.get(name, 1.0), f"weights: {name!r}", least=0.0)
            wanted[:, i], weighed[:, i] = np.nan_to_num(place), weight * ~np.isnan(place)
        self._wanted, self._weights = read_only(wanted), read_only(weighed)

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        other = self._over(start, stop, N, nu)
        other._wanted, other._weights = self._wanted[start : stop + 1], self._weights[start : stop + 1]
        return other

    def _prices(self, q: Array, start: int) -> Array:
        return self._priced(slice(start, start + len(q))).prices(q)

    def _slopes(self, q: Array) -> Array:
        return self._priced(slice(None)).slopes(q)

    def _bends(self, q: Array, *, exact: bool) -> Array:
        return self._priced(slice(None)).bends(q, exact=exact)

    def _priced(self, rows: slice) -> PricedPlaces:
        points = MovedPoints.of(self.system.mechanism, self._frames)
        return PricedPlaces(points, self._wanted[rows], self._weights[rows])
