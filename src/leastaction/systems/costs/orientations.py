"""A price on how far frames are turned from wanted orientations, beside any other cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost
from leastaction.systems.costs.configurations import CostOfConfigurations
from leastaction.systems.costs.words import weights_of_axes
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.orientations import MissingTurn, Orientation, TurnedFrame, known_quaternions


class PricedTurns:
    """Half the weighted squares of the rotations by which frames miss wanted orientations, at n configurations.

    ``turns``: what is missing, and its weights (3,) or (n, 3). Derivatives are by the ``nv`` directions of
    configurations.
    """

    def __init__(self, turns: Sequence[tuple[MissingTurn, Array]], nv: int) -> None:
        self.turns, self.nv = tuple(turns), nv

    def prices(self, q: Array, rows: slice = slice(None)) -> Array:
        """Return them (n,); ``rows``: which of the instants configurations are of."""
        total = np.zeros(len(q))
        for turn, weight in self.turns:
            total += 0.5 * np.sum((weight if weight.ndim == 1 else weight[rows]) * turn.values(q, rows) ** 2, axis=1)
        return total

    def slopes(self, q: Array) -> Array:
        """Return their derivatives (n, nv)."""
        total = np.zeros((len(q), self.nv))
        for turn, weight in self.turns:
            e = turn.values(q)
            total += np.einsum("na,nai->ni", weight * e, turn.jacobian(q, e))
        return total

    def bends(self, q: Array, *, exact: bool) -> Array:
        """Return their second derivatives (n, nv, nv), or Gauss and Newton's, where they need not be ``exact``."""
        total = np.zeros((len(q), self.nv, self.nv))
        for turn, weight in self.turns:
            e = turn.values(q)
            J = turn.jacobian(q, e)
            total += J.transpose(0, 2, 1) @ (weight[..., None] * J)
            if exact:
                total += turn.bent(q, e, weight * e)
        return total


@public
class OrientationCost(CostOfConfigurations):
    """Another cost and half the weighted squares of the rotations by which frames miss wanted orientations.

    Of the vector ``e = log(R_wanted' R)`` (rad) in the frame's axes: up to half a turn it is smooth, with exact second
    derivatives. As fit for several threads as the other cost.

    Parameters
    ----------
    cost : Cost
        Such as a `QuadraticCost`.
    system : MidpointSystem
        Whose frames are meant.
    orientations : mapping of str to array_like (3, 3), (4,), (N+1, 3, 3) or (N+1, 4), or callable
        Rotations that are wanted of frames, by their names: matrices whose columns are the frame's axes in the world,
        or unit quaternions, scalar first; all numbers NaN where any is as good. Or a function of the time (s).
    weights : mapping of str to float or array_like (3,)
        By the same names, in units of the cost by rad^2: of turns about all axes of the frame, or about x, y, z. 1 if
        left out.

    Raises
    ------
    ArgumentError
        For an unknown frame, what is no rotation, or a weight that is negative or not finite.
    """

    def __init__(
        self,
        cost: Cost,
        system: MidpointSystem,
        orientations: Mapping[str, Orientation],
        weights: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        given = {} if weights is None else weights
        super().__init__(cost, "orientations", system, orientations, given)
        self._wanted, self._weights = {}, {}
        for (name, each), weight in zip(orientations.items(), weights_of_axes(given, orientations), strict=True):
            self._wanted[name], known = known_quaternions(each, f"orientations: {name!r}", system.t)
            self._weights[name] = read_only(weight if known.all() else weight * known[:, None])
        self._turns()  # an unknown frame is told here

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        other = self._over(start, stop, N, nu)
        rows = slice(start, stop + 1)
        other._wanted = {name: each if len(each) == 1 else each[rows] for name, each in self._wanted.items()}
        other._weights = {name: each if each.ndim == 1 else each[rows] for name, each in self._weights.items()}
        return other

    def _turns(self) -> PricedTurns:
        m = self.system.mechanism
        return PricedTurns(
            [(MissingTurn(TurnedFrame(m, name), wanted), self._weights[name]) for name, wanted in self._wanted.items()],
            m.nv,
        )

    def _prices(self, q: Array, start: int) -> Array:
        return self._turns().prices(q, slice(start, start + len(q)))

    def _slopes(self, q: Array) -> Array:
        return self._turns().slopes(q)

    def _bends(self, q: Array, *, exact: bool) -> Array:
        return self._turns().bends(q, exact=exact)
