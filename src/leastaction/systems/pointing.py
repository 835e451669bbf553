"""Limits on where axes of frames point."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number, read_only
from leastaction.numerics.frozen import own_arrays, restore_state, saved_state
from leastaction.numerics.public import public
from leastaction.optimal.limits.limit import Horizon, Limit, When, Within
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Quantity, Samples
from leastaction.systems.frames import OfConfiguration, frames_of, places_alike
from leastaction.systems.orientations import TurnedFrame


class AngleToDirection(OfConfiguration):
    """By how much the angle between an axis of a frame and a direction is within, or beyond, what is said (rad).

    That is exact near the border, and smooth at every angle: it is the angle's cosine that is compared.
    """

    says_all, unit = True, "rad"

    def __init__(self, mechanism: Mechanism, limit: Pointing) -> None:
        super().__init__(mechanism)
        self.limit = limit
        self.turned = TurnedFrame(mechanism, limit.frame, limit.origin)
        self._axis, self._towards = (_unit(each) for each in (limit.axis, limit.towards))
        angle = limit.within if limit.beyond is None else limit.beyond
        assert angle is not None
        self._scale = (1.0 if limit.beyond is None else -1.0) / np.sin(angle)
        self._cosine = np.cos(angle)
        how = "within" if limit.beyond is None else "beyond"
        where = "" if limit.origin is None else f" of {limit.origin}"
        self.names = (f"{limit.frame} {how} {angle:.4g} rad of a direction{where}",)

    def values(self, at: Samples) -> Array:
        axis, towards = self._directions(self.q(at))
        return np.asarray(self._scale * (np.sum(axis * towards, axis=1, keepdims=True) - self._cosine))

    def jacobian(self, at: Samples) -> Array:
        q = self.q(at)
        axis, towards = self._directions(q)
        own, *other = self.turned.turns(q)
        return np.asarray(self._scale * (np.cross(axis, towards)[:, None] @ (own - other[0] if other else own)))

    def curvature(self, at: Samples, y: Array) -> Array:
        q = self.q(at)
        axis, towards = (each[:, None] for each in self._directions(q))
        # The cosine turns with n . (w - w'), n = axis x towards: both are carried along, by w and w'.
        own, *other = (each.transpose(0, 2, 1) for each in self.turned.turns(q))
        normal = np.cross(np.cross(own, axis), towards)
        if other:
            normal += np.cross(axis, np.cross(other[0], towards))
        between = own - other[0] if other else own
        H = between @ normal.transpose(0, 2, 1)
        H += np.einsum("na,naij->nij", np.cross(axis, towards)[:, 0], self.turned.changes(q))
        return np.asarray(0.5 * self._scale * y[:, :, None] * (H + H.transpose(0, 2, 1)))

    def own_is_like(self, other: Quantity) -> bool:
        if not isinstance(other, AngleToDirection) or self.limit is not other.limit:
            return False
        return places_alike(self.mechanism, other.mechanism)

    def _directions(self, q: Array) -> tuple[Array, Array]:
        """Return the frame's axis and the direction, both (n, 3) in the world."""
        R, *origin = self.turned.rotations(q)
        axis = R @ self._axis
        return axis, origin[0] @ self._towards if origin else np.broadcast_to(self._towards, axis.shape)


@public
@dataclass(frozen=True)
class Pointing(Limit):
    """Keep an axis of a frame within a cone about a direction, or out of one.

    What turns about the axis is free. Smooth at every angle.

    Parameters
    ----------
    frame : str
    axis : array_like (3,)
        In the frame; of any length but zero.
    towards : array_like (3,)
        The direction, in the world; of any length but zero.
    within, beyond : float
        One of them: the largest angle (rad) between both, or the least; between 0 and half a turn.
    origin : str, optional
        A frame in whose axes the direction is meant: ``Pointing("arm", (0, 0, -1), (1, 0, 0), within=1.9,
        origin="torso")`` is the reach of a shoulder.
    at : str, int, float or sequence, optional
        As of `Bound`: every instant if left out.

    Raises
    ------
    ArgumentError
        Not one angle, or one that is not between 0 and half a turn; a direction of length zero; by `optimize`, an
        unknown frame.
    """

    frame: str
    axis: ArrayLike
    towards: ArrayLike
    within: float | None = field(default=None, kw_only=True)
    beyond: float | None = field(default=None, kw_only=True)
    origin: str | None = field(default=None, kw_only=True)
    at: When = field(default=None, kw_only=True)

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        if (self.within is None) == (self.beyond is None):
            raise ArgumentError(f"{self}: expected an angle (rad), either as within= or as beyond=")
        for what in ("within", "beyond"):
            if getattr(self, what) is not None:
                as_number(getattr(self, what), f"{self}: {what}", above=0.0, below=np.pi)
        for what in ("axis", "towards"):
            if not as_array(getattr(self, what), f"{self}: {what}", (3,)).any():
                raise ArgumentError(f"{self}: {what}: got a direction of length zero, expected one such as (0, 0, 1)")
        own_arrays(self, "axis", "towards")

    def __str__(self) -> str:
        return f"Pointing({self.frame!r})"

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows for a `MidpointSystem`, or for the points of a `MechanismSystem`'s horizon."""
        return Within(AngleToDirection(frames_of(system, self)[0], self), at=self.at).rows(system, first)


def _unit(direction: ArrayLike) -> Array:
    given = np.asarray(direction, dtype=np.float64)
    return read_only(given / np.linalg.norm(given))
