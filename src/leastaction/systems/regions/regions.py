"""Parts of space, as functions of a point that are positive inside of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_number, read_only
from leastaction.numerics.frozen import changed, own_arrays, restore_state, saved_state
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public
from leastaction.optimal.quantity import Instants
from leastaction.systems.regions.apart import ConvexSolid, Hole, Shape, Side

Place = ArrayLike | Callable[[float], ArrayLike]


class Region(ABC):
    """A part of space, as functions of a point that are positive inside of it. Frozen; threads may share it."""

    __repr__ = printed

    __getstate__, __setstate__ = saved_state, restore_state

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


def _said(vector: ArrayLike) -> str:
    """Return three numbers as text."""
    return f"({', '.join(f'{each:.4g}' for each in np.asarray(vector, dtype=np.float64))})"


@public
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
        low, high = (as_array(getattr(self, name), f"Box: {name}", (3,), finite=False) for name in ("low", "high"))
        if not (low < high).all():
            raise ArgumentError(f"Box: got low {self.low!r} and high {self.high!r}, expected each low below its high")
        own_arrays(self, "low", "high")

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
        return tuple(f"{'xyz'[axis]} {'>=' if sign > 0.0 else '<='} {at:.4g} m" for axis, sign, at in self._faces)

    def shape(self, k: Instants) -> Shape:  # noqa: ARG002
        low, high = (np.asarray(each, dtype=np.float64)[None] for each in (self.low, self.high))
        return ConvexSolid(low, high)

    def values(self, p: Array, k: Instants) -> Array:  # noqa: ARG002 - boxes do not move
        return np.stack([sign * (p[:, axis] - at) for axis, sign, at in self._faces], axis=1)

    def gradient(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        result = np.zeros((len(p), len(self._faces), 3))
        for j, (axis, sign, _) in enumerate(self._faces):
            result[:, j, axis] = sign
        return result

    def hessian(self, p: Array, k: Instants) -> None:
        """Return None: the faces are flat."""


@public
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
        own_arrays(self, "normal")

    @property
    def names(self) -> tuple[str, ...]:
        return (f"inside of the plane {_said(self.normal)} . p = {self.offset:.4g}",)

    def shape(self, k: Instants) -> Side:  # noqa: ARG002
        normal = np.asarray(self.normal, dtype=np.float64)
        size = float(np.linalg.norm(normal))
        return Side(normal / size, self.offset / size)

    def values(self, p: Array, k: Instants) -> Array:
        normal, offset = self.shape(k)
        return np.asarray((p @ normal - offset)[:, None])

    def gradient(self, p: Array, k: Instants) -> Array:
        return np.broadcast_to(self.shape(k).normal, (len(p), 1, 3))

    def hessian(self, p: Array, k: Instants) -> None:
        """Return None: the plane is flat."""


@public
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
        own_arrays(self, "center")

    @property
    def names(self) -> tuple[str, ...]:
        center = "a moving point" if callable(self.center) or np.ndim(self.center) == 2 else _said(self.center)
        return (f"within {self.radius:.4g} m of {center}",)

    def shape(self, k: Instants) -> Shape:
        center = np.broadcast_to(self.center_at(k), (len(k), 3))
        return ConvexSolid(center, center, self.radius)

    def values(self, p: Array, k: Instants) -> Array:
        """Return ``(radius^2 - d^2) / (2 radius)``, which is the distance near the surface and smooth at the centre."""
        d = p - self.center_at(k)
        return np.asarray((self.radius * self.radius - np.sum(d**2, axis=1))[:, None] / (2.0 * self.radius))

    def gradient(self, p: Array, k: Instants) -> Array:
        return np.asarray(-(p - self.center_at(k))[:, None, :] / self.radius)

    def hessian(self, p: Array, k: Instants) -> Array:  # noqa: ARG002
        return np.broadcast_to(-np.eye(3) / self.radius, (len(p), 1, 3, 3))

    def over(self, t: Array) -> Ball:
        """Return the ball with its centre (N+1, 3) at all instants."""
        if not callable(self.center):
            return self
        center = self.center
        places = np.stack([as_array(center(float(when)), "Ball: center at a time", (3,)) for when in t])
        return changed(self, center=read_only(places))  # which is more than the user may give

    def center_at(self, k: Instants) -> Array:
        """Return its centre at instants (n,), (n, 3); or (1, 3) where it stays."""
        assert not callable(self.center)
        center = np.asarray(self.center, dtype=np.float64)
        return center[k] if center.ndim == 2 else center[None]


@dataclass(frozen=True)
class Outside(Region):
    """All but a region of one smooth face."""

    region: Region

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"not {name}" for name in self.region.names)

    def over(self, t: Array) -> Outside:
        return Outside(self.region.over(t))

    def shape(self, k: Instants) -> Shape | None:
        inside = self.region.shape(k)
        if isinstance(inside, Side):
            return Side(-inside.normal, -inside.offset)
        return (
            Hole(inside.low, inside.radius)
            if isinstance(self.region, Ball) and isinstance(inside, ConvexSolid)
            else None
        )

    def values(self, p: Array, k: Instants) -> Array:
        return -self.region.values(p, k)

    def gradient(self, p: Array, k: Instants) -> Array:
        return -self.region.gradient(p, k)

    def hessian(self, p: Array, k: Instants) -> Array | None:
        inside = self.region.hessian(p, k)
        return None if inside is None else -inside
