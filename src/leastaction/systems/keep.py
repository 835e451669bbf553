"""Limits on where frames of a mechanism may be."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.frozen import own_arrays, restore_state, saved_state
from leastaction.optimal.collocation.limits import Points
from leastaction.optimal.limits.limit import Horizon, Limit, When, Within
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Instants, Quantity, Samples
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.regions import Outside, Region
from leastaction.systems.regions.apart import apart


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
        return self.region.values(self._places(self.mechanism, self._q(at)), at.k)

    def jacobian(self, at: Samples) -> Array:
        q = self._q(at)
        slope = self.region.gradient(self._places(self.mechanism, q), at.k)
        result = np.zeros((len(at.k), len(self.names), at.x.shape[1]))
        result[:, :, : q.shape[1]] = slope @ self._velocities(q)
        return result

    def curvature(self, at: Samples, y: Array) -> Array:
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

    __getstate__, __setstate__ = saved_state, restore_state

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
        own_arrays(self, "point")

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
        region = Outside(self.outside) if self.outside is not None else self.inside
        assert region is not None
        return Within(_PlaceOfFrame(mechanism, t, self, region), at=self.at).rows(system, first)
