"""Limits on where frames of a mechanism may be."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number
from leastaction.optimal.collocation.limits import Points
from leastaction.optimal.limits.limit import Horizon, Limit, When, Within
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Instants, Quantity, Samples
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.regions_apart import Hole, Shape, Side, Solid, apart

__all__ = ["Ball", "Box", "HalfSpace", "Keep", "Region"]

Place = ArrayLike | Callable[[float], ArrayLike]


class Region(ABC):
    """A part of space, as functions of a point that are positive inside of it. Frozen; threads may share it."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """What each function says."""

    def over(self, t: Array) -> Region:  # noqa: ARG002
        """Return the region with all that depends on time looked up for the times of the instants."""
        return self

    def shape(self, k: Instants) -> Shape | None:  # noqa: ARG002 - overridden
        """Return what part of space it is at instants, of what can be told apart; None by default."""
        return None

    @abstractmethod
    def values(self, p: Array, k: Instants) -> Array:
        """Return how far points p (n, 3) are inside at instants k (n,), (n, m), in metres near the border."""

    @abstractmethod
    def gradient(self, p: Array, k: Instants) -> Array:
        """Return the derivatives (n, m, 3)."""

    @abstractmethod
    def hessian(self, p: Array, k: Instants) -> Array | None:
        """Return the second derivatives (n, m, 3, 3); None where all functions are linear."""


@dataclass(frozen=True)
class Box(Region):
    """A box along the axes.

    Parameters
    ----------
    low, high : array_like (3,)
        Its corners (m); infinite where it is open.
    """

    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        low, high = (np.asarray(each, dtype=np.float64) for each in (self.low, self.high))
        if low.shape != (3,) or high.shape != (3,) or not (low < high).all():
            raise ArgumentError(
                f"Box: got low {self.low!r} and high {self.high!r}, expected (3,), each low below its high"
            )

    @property
    def _faces(self) -> list[tuple[int, float, float]]:
        faces = []
        for axis in range(3):
            for sign, corner in ((1.0, self.low), (-1.0, self.high)):
                at = float(np.asarray(corner, dtype=np.float64)[axis])
                if np.isfinite(at):
                    faces.append((axis, sign, at))
        return faces

    @property
    def names(self) -> tuple[str, ...]:
        """The faces."""
        return tuple(f"{'xyz'[axis]} {'>=' if sign > 0.0 else '<='} {at:.4g} m" for axis, sign, at in self._faces)

    def shape(self, k: Instants) -> Shape:  # noqa: ARG002
        """Return its corners."""
        low, high = (np.asarray(each, dtype=np.float64)[None] for each in (self.low, self.high))
        return Solid(low, high)

    def values(self, p: Array, k: Instants) -> Array:  # noqa: ARG002 - boxes do not move
        """Return the distances from the faces."""
        return np.stack([sign * (p[:, axis] - at) for axis, sign, at in self._faces], axis=1)

    def gradient(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        """Return the faces' normals."""
        result = np.zeros((len(p), len(self._faces), 3))
        for j, (axis, sign, _) in enumerate(self._faces):
            result[:, j, axis] = sign
        return result

    def hessian(self, p: Array, k: Instants) -> None:
        """Return None: the faces are flat."""


@dataclass(frozen=True)
class HalfSpace(Region):
    """One side of a plane: ``normal . p >= offset``.

    Parameters
    ----------
    normal : array_like (3,)
        Points into it; of any length but zero.
    offset : float
        Distance of the plane from the origin along the normal (m), times the normal's length.
    """

    normal: ArrayLike
    offset: float = 0.0

    def __post_init__(self) -> None:
        normal = as_array(self.normal, "HalfSpace: normal", (3,))
        if not normal.any():
            raise ArgumentError("HalfSpace: got a normal of zero, expected a direction")
        as_number(self.offset, "HalfSpace: offset", above=-np.inf)

    @property
    def names(self) -> tuple[str, ...]:
        """The side."""
        return (
            f"inside of the plane {tuple(as_array(self.normal, 'HalfSpace: normal', (3,)))} . p = {self.offset:.4g}",
        )

    def shape(self, k: Instants) -> Shape:  # noqa: ARG002
        """Return the plane."""
        normal = np.asarray(self.normal, dtype=np.float64)
        size = float(np.linalg.norm(normal))
        return Side(normal / size, self.offset / size)

    def values(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        """Return the distance from the plane."""
        normal = np.asarray(self.normal, dtype=np.float64)
        return np.asarray((p @ normal - self.offset)[:, None] / np.linalg.norm(normal))

    def gradient(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        """Return the normal."""
        normal = np.asarray(self.normal, dtype=np.float64)
        return np.broadcast_to(normal / np.linalg.norm(normal), (len(p), 1, 3))

    def hessian(self, p: Array, k: Instants) -> None:
        """Return None: the plane is flat."""


@dataclass(frozen=True)
class Ball(Region):
    """A ball, which may move.

    Parameters
    ----------
    center : array_like (3,) or callable
        Or a function of the time (s) that returns it (m).
    radius : float
        Metres.
    """

    center: Place
    radius: float

    def __post_init__(self) -> None:
        as_number(self.radius, "Ball: radius", above=0.0)
        if not callable(self.center):
            as_array(self.center, "Ball: center", (3,))

    @property
    def names(self) -> tuple[str, ...]:
        """The surface."""
        return (f"within {self.radius:.4g} m of {self.center!r}",)

    def shape(self, k: Instants) -> Shape:
        """Return its centre and radius."""
        center = -self._from_center(np.zeros((len(k), 3)), k)
        return Solid(center, center, self.radius)

    def values(self, p: Array, k: Instants) -> Array:
        """Return ``(radius^2 - d^2) / (2 radius)``, which is the distance near the surface and smooth at the centre."""
        d = self._from_center(p, k)
        return np.asarray((self.radius**2 - np.sum(d**2, axis=1))[:, None] / (2.0 * self.radius))

    def gradient(self, p: Array, k: Instants) -> Array:
        """Return the derivative."""
        return np.asarray(-self._from_center(p, k)[:, None, :] / self.radius)

    def hessian(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        """Return the second derivative."""
        return np.broadcast_to(-np.eye(3) / self.radius, (len(p), 1, 3, 3))

    def over(self, t: Array) -> Ball:
        """Return the ball with its centre (N+1, 3) at all instants."""
        if not callable(self.center):
            return self
        center = self.center
        places = np.stack([as_array(center(float(when)), "Ball: center at a time", (3,)) for when in t])
        return _Moving(places, self.radius)

    def _from_center(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        assert not callable(self.center)
        return np.asarray(p - np.asarray(self.center, dtype=np.float64))


@dataclass(frozen=True)
class _Moving(Ball):
    """A ball whose centre is known at all instants."""

    def __post_init__(self) -> None:
        """Hold what a `Ball` has checked."""

    @property
    def names(self) -> tuple[str, ...]:
        return (f"within {self.radius:.4g} m of a moving point",)

    def _from_center(self, p: Array, k: Instants) -> Array:
        return np.asarray(p - np.asarray(self.center)[k])


@dataclass(frozen=True)
class _Outside(Region):
    """All but a region of one smooth face."""

    region: Region

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"not {name}" for name in self.region.names)

    def over(self, t: Array) -> _Outside:
        return _Outside(self.region.over(t))

    def shape(self, k: Instants) -> Shape | None:
        inside = self.region.shape(k)
        if isinstance(inside, Side):
            return Side(-inside.normal, -inside.offset)
        return Hole(inside.low, inside.radius) if isinstance(self.region, Ball) and isinstance(inside, Solid) else None

    def values(self, p: Array, k: Instants) -> Array:
        return -self.region.values(p, k)

    def gradient(self, p: Array, k: Instants) -> Array:
        return -self.region.gradient(p, k)

    def hessian(self, p: Array, k: Instants) -> Array | None:
        inside = self.region.hessian(p, k)
        return None if inside is None else -inside


class _PlaceOfFrame(Quantity):
    """How far a point of a frame, or its way from the origin of another, is inside of a region."""

    of_state = says_all = True

    def __init__(self, mechanism: Mechanism, t: Array, keep: Keep, region: Region) -> None:
        self.mechanism, self.region = mechanism, region.over(t)
        self.frame, self.point, self.origin = keep.frame, np.asarray(keep.point, dtype=np.float64), keep.origin
        place = keep.frame if keep.origin is None else f"{keep.frame} from {keep.origin}"
        self.names = tuple(f"{place} {name}" for name in self.region.names)
        # Names of frames are looked up here, and not at the first step.
        q = np.zeros((1, mechanism.nq))
        self._places(mechanism, q)

    def values(self, at: Samples) -> Array:
        """Return how far inside the place is."""
        return self.region.values(self._places(self.mechanism, self._q(at)), at.k)

    def jacobian(self, at: Samples) -> Array:
        """Return the derivatives by the state."""
        q = self._q(at)
        slope = self.region.gradient(self._places(self.mechanism, q), at.k)
        result = np.zeros((len(at.k), len(self.names), at.x.shape[1]))
        result[:, :, : q.shape[1]] = slope @ self._velocities(q)
        return result

    def curvature(self, at: Samples, y: Array) -> Array:
        """Return the second derivative by the state."""
        q, m = self._q(at), self.mechanism
        p = self._places(m, q)
        J = self._velocities(q)
        bent = m.frame_jacobian_derivative(q, self.frame, point=self.point)[:, :3]
        if self.origin is not None:
            bent = bent - m.frame_jacobian_derivative(q, self.origin)[:, :3]
        pull = np.einsum("nm,nma->na", y, self.region.gradient(p, at.k))
        H = np.einsum("na,naij->nij", pull, bent)
        hessian = self.region.hessian(p, at.k)
        if hessian is not None:
            H += J.transpose(0, 2, 1) @ np.einsum("nm,nmab->nab", y, hessian) @ J
        result = np.zeros((len(at.k), at.x.shape[1], at.x.shape[1]))
        result[:, : q.shape[1], : q.shape[1]] = H
        return result

    def apart(self, other: Quantity, k: Instants) -> Array | None:
        """Return how far the regions are apart, of the same point."""
        if not isinstance(other, _PlaceOfFrame) or self.mechanism is not other.mechanism:
            return None
        if (self.frame, self.origin, *self.point) != (other.frame, other.origin, *other.point):
            return None
        one, another = self.region.shape(k), other.region.shape(k)
        return None if one is None or another is None else np.broadcast_to(apart(one, another), k.shape)

    def _q(self, at: Samples) -> Array:
        return np.ascontiguousarray(at.x[:, : self.mechanism.nq])

    def _places(self, mechanism: Mechanism, q: Array) -> Array:
        pose = mechanism.frame_pose(q, self.frame)
        place = pose[:, :3, :3] @ self.point + pose[:, :3, 3]
        if self.origin is not None:
            place = place - mechanism.frame_pose(q, self.origin)[:, :3, 3]
        return np.asarray(place)

    def _velocities(self, q: Array) -> Array:
        J = self.mechanism.frame_jacobian(q, self.frame, point=self.point)[:, :3]
        if self.origin is not None:
            J = J - self.mechanism.frame_jacobian(q, self.origin)[:, :3]
        return J


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

    def __post_init__(self) -> None:
        if (self.inside is None) == (self.outside is None):
            raise ArgumentError(f"Keep({self.frame!r}): expected a region, either as inside= or as outside=")
        region = self.inside if self.outside is None else self.outside
        if not isinstance(region, Region):
            raise ArgumentError(
                f"Keep({self.frame!r}): got {type(region).__name__}, expected a Ball, a Box or a HalfSpace"
            )
        if self.outside is not None and len(self.outside.names) > 1:
            raise ArgumentError(
                f"Keep({self.frame!r}): the outside of a {type(self.outside).__name__} has edges, which no smooth "
                "limit describes. Take a Ball around it, or a HalfSpace"
            )
        as_array(self.point, f"Keep({self.frame!r}): point", (3,))

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows for a `MidpointSystem`, or for the points of a `MechanismSystem`'s horizon."""
        if isinstance(system, MidpointSystem):
            mechanism, t = system.integrator.mechanism, system.t
        elif isinstance(system, Points) and isinstance(system.system, MechanismSystem):
            mechanism, t = system.system.mechanism, system.t
        else:
            got = system.system if isinstance(system, Points) else system
            raise ArgumentError(
                f"Keep({self.frame!r}): got a {type(got).__name__}, expected a MidpointSystem or a MechanismSystem: "
                "their frames have names"
            )
        region = _Outside(self.outside) if self.outside is not None else self.inside
        assert region is not None
        return Within(_PlaceOfFrame(mechanism, t, self, region), at=self.at).rows(system, first)
