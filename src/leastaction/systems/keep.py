"""Limits on where frames of a mechanism may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.moved_points import MovedPoints
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.frozen import own_arrays, restore_state, saved_state
from leastaction.numerics.public import public
from leastaction.optimal.limits.limit import Horizon, Limit, When, Within
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Instants, Quantity, Samples
from leastaction.systems.frames import OfConfiguration, frames_of, places_alike
from leastaction.systems.regions import Outside, Region
from leastaction.systems.regions.apart import apart
from leastaction.systems.regions.balls import Balls, balls_of


class _PlaceOfFrame(OfConfiguration):
    """How far a point of a frame, or its way from the origin of another, is inside of a region."""

    says_all = True

    def __init__(self, mechanism: Mechanism, t: Array, keep: Keep, region: Region) -> None:
        super().__init__(mechanism)
        self.region, self.keep, self.t = region.over(t), keep, t
        self.frame, self.point, self.origin = keep.frame, np.asarray(keep.point, dtype=np.float64), keep.origin
        place = keep.frame if keep.origin is None else f"{keep.frame} from {keep.origin}"
        self.names = tuple(f"{place} {name}" for name in self.region.names)
        # Names of frames are looked up here, and not at the first step.
        frames, points = [keep.frame], [self.point]
        if keep.origin is not None:
            frames, points = [*frames, keep.origin], [*points, np.zeros(3)]
        self._points = MovedPoints.of(mechanism, frames, points)

    def values(self, at: Samples) -> Array:
        return self.region.values(self._places(self.q(at)), at.k)

    def jacobian(self, at: Samples) -> Array:
        q = self.q(at)
        return self.region.gradient(self._places(q), at.k) @ self._velocities(q)

    def curvature(self, at: Samples, y: Array) -> Array:
        q = self.q(at)
        p = self._places(q)
        pull = (y[:, None, :] @ self.region.gradient(p, at.k))[:, 0]
        H = self._points.bent(q, np.stack([pull] if self.origin is None else [pull, -pull], axis=1))
        hessian = self.region.hessian(p, at.k)
        if hessian is not None:
            J = self._velocities(q)
            H += J.transpose(0, 2, 1) @ np.einsum("nm,nmab->nab", y, hessian) @ J
        return H

    def joined(self, others: Sequence[Quantity]) -> Quantity | None:
        places = self.among(others)
        regions = balls_of([place.region for place in places])
        if regions is None or any(place.origin is not None for place in places):
            return None
        return _PlacesOfFrames(self.mechanism, [(place.frame, place.point) for place in places], regions)

    def own_is_like(self, other: Quantity) -> bool:
        if not isinstance(other, _PlaceOfFrame) or self.keep is not other.keep:
            return False
        region = self.keep.inside or self.keep.outside
        stands = region is not None and region.over(self.t) is region
        return (stands or np.array_equal(self.t, other.t)) and places_alike(self.mechanism, other.mechanism)

    def apart(self, other: Quantity, k: Instants) -> Array | None:
        if not isinstance(other, _PlaceOfFrame) or self.mechanism is not other.mechanism:
            return None
        if (self.frame, self.origin, *self.point) != (other.frame, other.origin, *other.point):
            return None
        one, another = self.region.shape(k), other.region.shape(k)
        return None if one is None or another is None else np.broadcast_to(apart(one, another), k.shape)

    def _places(self, q: Array) -> Array:
        return _way(self._points.places(q))

    def _velocities(self, q: Array) -> Array:
        return _way(self._points.jacobian(q))


def _way(of_points: Array) -> Array:
    """Return what is of a point (n, 1, ...), or that less what is of another (n, 2, ...)."""
    return of_points[:, 0] if of_points.shape[1] == 1 else of_points[:, 0] - of_points[:, 1]


class _PlacesOfFrames(OfConfiguration):
    """How far points of frames are inside of balls, or outside: of many balls at once.

    ``points``: frame and point in its axes (3,) of each ball, of which several may be of the same one.
    """

    says_all = True

    def __init__(self, mechanism: Mechanism, points: Sequence[tuple[str, Array]], balls: Balls) -> None:
        super().__init__(mechanism)
        self.balls, self.names = balls, balls.names
        keys = [(frame, *point.tolist()) for frame, point in points]
        distinct = list(dict.fromkeys(keys))
        self._of = [distinct.index(key) for key in keys]
        self._points = MovedPoints.of(mechanism, [key[0] for key in distinct], [key[1:] for key in distinct])
        self._owned = np.eye(len(distinct))[self._of]

    def values(self, at: Samples) -> Array:
        return self.balls.values(self._places(self.q(at)), at.k)

    def jacobian(self, at: Samples) -> Array:
        q = self.q(at)
        return self._points.slopes(q, self._of, self.balls.gradient(self._places(q), at.k))

    def curvature(self, at: Samples, y: Array) -> Array:
        q = self.q(at)
        pulls = y[:, :, None] * self.balls.gradient(self._places(q), at.k)
        force = np.ascontiguousarray((pulls.transpose(0, 2, 1) @ self._owned).transpose(0, 2, 1))
        return self._points.bent(q, force, (y * self.balls.bend) @ self._owned)

    def _places(self, q: Array) -> Array:
        return self._points.places(q)[:, self._of]


@public
@dataclass(frozen=True)
class Keep(Limit):
    """Keep a point of a frame inside or outside of a region, at every instant or at some.

    Parameters
    ----------
    frame : str
    inside, outside : Region
        One of them. Outside of a `Box` is no smooth limit: take a `Ball` or a `HalfSpace`.
    point : array_like (3,), optional
        The point, in the frame's axes (m); its origin if left out.
    origin : str, optional
        A frame whose origin is the region's, in world axes: ``Keep("hand", outside=Ball((0, 0, 0), 0.2),
        origin="head")`` keeps hand and head apart.
    at : str, int, float or sequence, optional
        As of `Bound`.
    """

    frame: str
    inside: Region | None = field(default=None, kw_only=True)
    outside: Region | None = field(default=None, kw_only=True)
    point: ArrayLike = field(default=(0.0, 0.0, 0.0), kw_only=True)
    origin: str | None = field(default=None, kw_only=True)
    at: When = field(default=None, kw_only=True)

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        if (self.inside is None) == (self.outside is None):
            raise ArgumentError(f"{self}: expected a region, either as inside= or as outside=")
        region = self.inside if self.outside is None else self.outside
        if not isinstance(region, Region):
            raise ArgumentError(f"{self}: got {type(region).__name__}, expected a Ball, a Box or a HalfSpace")
        if self.outside is not None and len(self.outside.names) > 1:
            raise ArgumentError(
                f"{self}: the outside of a {type(self.outside).__name__} has edges, which no smooth "
                "limit describes. Take a Ball around it, or a HalfSpace"
            )
        as_array(self.point, f"{self}: point", (3,))
        own_arrays(self, "point")

    def __str__(self) -> str:
        return f"Keep({self.frame!r})"

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows for a `MidpointSystem`, or for the points of a `MechanismSystem`'s horizon."""
        mechanism, t = frames_of(system, self)
        region = Outside(self.outside) if self.outside is not None else self.inside
        assert region is not None
        return Within(_PlaceOfFrame(mechanism, t, self, region), at=self.at).rows(system, first)
