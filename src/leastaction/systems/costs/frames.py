"""Prices in continuous time on where frames are and how they are turned, to be added to other costs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.mechanism.queries.moved_points import MovedPoints
from leastaction.numerics.arrays import Array, as_array, require_instance, require_mapping
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.numerics.public import public
from leastaction.numerics.time_functions import TimeFunction
from leastaction.optimal.continuous.cost import ContinuousCost, RateGradient, RateHessian
from leastaction.optimal.space import bent_by_numbers, by_numbers
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.costs.orientations import PricedTurns
from leastaction.systems.costs.places import PricedPlaces
from leastaction.systems.costs.words import weights_of_axes
from leastaction.systems.orientations import MissingTurn, Orientation, TurnedFrame, quaternions_of
from leastaction.systems.quantities.continuous import points_of

Place = ArrayLike | Callable[[float], ArrayLike]
"""A point (3,) (m), or a function of the time (s)."""


class CostOfFrames(ContinuousCost):
    """A price on frames in continuous time, with exact second derivatives; inputs and the last state have none.

    ``wanted``: of frames by their names. ``weights``: by the same names, (3,) or a number. Any number of threads may
    share it.
    """

    def __init__(
        self, system: MechanismSystem, wanted: Mapping[str, Any], weights: Mapping[str, ArrayLike], what: str
    ) -> None:
        require_instance(system, "system", MechanismSystem, "in discrete time there are PlaceCost and OrientationCost")
        require_mapping(wanted, what, "{'hand': ...}")
        require_mapping(weights, "weights", "{'hand': 10.0}")
        if not wanted:
            raise ArgumentError(f"{what}: got none, expected at least one frame")
        for name in weights:
            if name not in wanted:
                raise unknown("name", name, wanted, "weights")
        m = system.mechanism
        for name in wanted:
            m.frame_pose(m.configuration(), name)  # an unknown name is an error here, not at the first step
        self.system, self.frames = system, tuple(wanted)
        self.weights = weights_of_axes(weights, wanted)
        curves = [each for each in wanted.values() if isinstance(each, PiecewisePolynomial)]
        self.jumps = tuple(sorted({t for curve in curves for t in curve.jumps()}))
        self.nonnegative = True

    @abstractmethod
    def priced(self, t: Array) -> PricedPlaces | PricedTurns:
        """Return what has a price at times (n,)."""

    def rate(self, x: Array, u: Array, t: float) -> float:
        return float(self.rates(x[None], u[None], np.array([t]))[0])

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        return self.priced(t).prices(self._configurations(x, u))

    def gradient(self, x: Array, u: Array, t: Array) -> RateGradient:
        slopes = self._slopes(x, u, t)
        by_state = slopes if self.system.space is None else by_numbers(self.system.space, x, slopes[:, None])[:, 0]
        return RateGradient(by_state, np.zeros_like(u))

    def hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        return self._hessian(x, u, t, exact=True)

    def own_convex_hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        return self._hessian(x, u, t, exact=False)

    def _hessian(self, x: Array, u: Array, t: Array, *, exact: bool) -> RateHessian:
        m, space = self.system.mechanism, self.system.space
        n, nu = u.shape
        Q = np.zeros((n, 2 * m.nv, 2 * m.nv))
        Q[:, : m.nv, : m.nv] = self.priced(t).bends(self._configurations(x, u), exact=exact)
        if space is not None:
            slopes = self._slopes(x, u, t)
            Q = bent_by_numbers(space, x, slopes if exact else np.zeros_like(slopes), Q)
        return RateHessian(Q, np.zeros((n, nu, nu)), None)

    def _slopes(self, x: Array, u: Array, t: Array) -> Array:
        """Return the derivatives by the directions (n, ndx) of a state."""
        m = self.system.mechanism
        out = np.zeros((len(x), 2 * m.nv))
        out[:, : m.nv] = self.priced(t).slopes(self._configurations(x, u))
        return out

    def _configurations(self, x: Array, u: Array) -> Array:
        return points_of(self.system.mechanism, x, u)[0]


@public
class ContinuousPlaceCost(CostOfFrames):
    """Half the weighted squares of the distances of frames from wanted places, by the second.

    With exact second derivatives. Inputs have no price: add it to another cost by a `ContinuousCostSum`.

    Parameters
    ----------
    system : MechanismSystem
        Whose frames are meant.
    places : mapping of str to array_like (3,), or callable
        Where the origins of frames are wanted (m), by their names; or a function of the time (s), such as a
        `PiecewisePolynomial`.
    weights : mapping of str to float or array_like (3,)
        By the same names, in units of the cost by m^2 and s: of all directions, or of x, y, z. 1 if left out.

    Raises
    ------
    ArgumentError
        For an unknown frame, a wrong shape, or a weight that is negative or not finite.
    """

    def __init__(
        self, system: MechanismSystem, places: Mapping[str, Place], weights: Mapping[str, ArrayLike] | None = None
    ) -> None:
        super().__init__(system, places, {} if weights is None else weights, "places")
        self.places = tuple(TimeFunction(each, f"places: {name!r}") for name, each in places.items())
        for place in self.places:
            if place.is_constant:
                as_array(place.at(0.0), place.name, (3,))

    def priced(self, t: Array) -> PricedPlaces:
        """Return the places that are wanted at times (n,)."""
        points = MovedPoints.of(self.system.mechanism, self.frames)
        wanted = [as_array(each.samples(t), each.name, (len(t), 3)) for each in self.places]
        weights = np.broadcast_to(self.weights, (len(t), *self.weights.shape))
        return PricedPlaces(points, np.stack(wanted, axis=1), weights)


@public
class ContinuousOrientationCost(CostOfFrames):
    """Half the weighted squares of the rotations by which frames miss wanted orientations, by the second.

    Of the vector ``e = log(R_wanted' R)`` (rad) in the frame's axes, as of an `OrientationCost`. Inputs have no price:
    add it to another cost by a `ContinuousCostSum`.

    Parameters
    ----------
    system : MechanismSystem
        Whose frames are meant.
    orientations : mapping of str to array_like (3, 3) or (4,), or callable
        Rotations that are wanted of frames, by their names; or functions of the time (s).
    weights : mapping of str to float or array_like (3,)
        By the same names, in units of the cost by rad^2 and s: of turns about all axes of the frame, or about x, y, z.
        1 if left out.

    Raises
    ------
    ArgumentError
        For an unknown frame, what is no rotation, or a weight that is negative or not finite.
    """

    def __init__(
        self,
        system: MechanismSystem,
        orientations: Mapping[str, Orientation],
        weights: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        super().__init__(system, orientations, {} if weights is None else weights, "orientations")
        self.orientations: dict[str, Any] = {}
        for name, each in orientations.items():
            what = f"orientations: {name!r}"
            if not callable(each):  # what never changes is read once
                self.orientations[name] = quaternions_of(each, what, np.zeros(1))
            else:
                self.orientations[name] = each

    def priced(self, t: Array) -> PricedTurns:
        """Return the turns that are missing at times (n,)."""
        m = self.system.mechanism
        wanted = (
            quaternions_of(each, f"orientations: {name!r}", t) if callable(each) else each
            for name, each in self.orientations.items()
        )
        turns = [MissingTurn(TurnedFrame(m, name), each) for name, each in zip(self.frames, wanted, strict=True)]
        return PricedTurns(list(zip(turns, self.weights, strict=True)), m.nv)
