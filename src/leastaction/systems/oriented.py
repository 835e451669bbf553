"""Limits on how frames of a mechanism are turned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.public import public
from leastaction.optimal.cost import owned
from leastaction.optimal.limits.limit import Equal, Horizon, Limit, When, Within
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Quantity, Samples
from leastaction.systems.frames import OfConfiguration, frames_of, places_alike
from leastaction.systems.orientations import MissingTurn, Orientation, TurnedFrame, quaternions_of


class TurnOfFrame(OfConfiguration):
    """The rotation that is missing, about the frame's axes; or how far its angle is within a largest one (rad)."""

    def __init__(self, mechanism: Mechanism, t: Array, limit: Oriented) -> None:
        super().__init__(mechanism)
        self.limit, self.within = limit, limit.within
        wanted = quaternions_of(limit.rotation, f"{limit}: rotation", t)
        self.turn = MissingTurn(TurnedFrame(mechanism, limit.frame, limit.origin), wanted)
        self.says_all, self.unit = self.within is not None, "rad"
        self.names = (
            (f"{limit.frame} within {self.within:.4g} rad of its orientation",)
            if self.within
            else tuple(f"{limit.frame} about its {axis}" for axis in "xyz")
        )

    def values(self, at: Samples) -> Array:
        e = self.turn.values(self.q(at), at.k)
        if self.within is None:
            return e
        # Smooth where nothing is missing, and in radians near the border.
        return np.asarray(0.5 * (self.within - np.sum(e * e, axis=1, keepdims=True) / self.within))

    def jacobian(self, at: Samples) -> Array:
        q = self.q(at)
        e = self.turn.values(q, at.k)
        J = self.turn.jacobian(q, e)
        return J if self.within is None else -(e[:, None] @ J) / self.within

    def curvature(self, at: Samples, y: Array) -> Array:
        q = self.q(at)
        e = self.turn.values(q, at.k)
        if self.within is None:
            return self.turn.bent(q, e, y)
        J, share = self.turn.jacobian(q, e), -y / self.within
        return np.asarray(share[:, :, None] * (J.transpose(0, 2, 1) @ J) + self.turn.bent(q, e, share * e))

    def own_is_like(self, other: Quantity) -> bool:
        if not isinstance(other, TurnOfFrame) or self.limit is not other.limit:
            return False
        return np.array_equal(self.turn.wanted, other.turn.wanted) and places_alike(self.mechanism, other.mechanism)


@public
@dataclass(frozen=True)
class Oriented(Limit):
    """Hold how a frame is turned: as wanted, or within an angle of that.

    What is limited is the rotation that is missing, ``log(R_wanted' R)``, smooth up to half a turn.

    Parameters
    ----------
    frame : str
    rotation : array_like (3, 3), (4,), (N+1, 3, 3) or (N+1, 4), or callable
        The rotation that is wanted: a matrix whose columns are the frame's axes in the world, or a unit quaternion,
        scalar first. Or a function of the time (s).
    within : float, optional
        The largest angle (rad) by which it may be missed, below half a turn. If left out, it is met: three equations.
    at : str, int, float or sequence, optional
        As of `Bound`: every instant if left out.
    origin : str, optional
        A frame in whose axes the rotation is meant: ``Oriented("hips", numpy.eye(3), within=1.0, origin="chest")`` is
        what a back can bend and twist.

    Raises
    ------
    ArgumentError
        An angle that is not between 0 and half a turn; by `optimize`, an unknown frame or what is no rotation.
    """

    frame: str
    rotation: Orientation
    within: float | None = field(default=None, kw_only=True)
    at: When = field(default=None, kw_only=True)
    origin: str | None = field(default=None, kw_only=True)

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        if self.within is not None:
            as_number(self.within, f"{self}: within", above=0.0, below=np.pi)
        if not callable(self.rotation):
            object.__setattr__(self, "rotation", owned(self.rotation, f"{self}: rotation"))

    def __str__(self) -> str:
        return f"Oriented({self.frame!r})"

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows for a `MidpointSystem`, or for the points of a `MechanismSystem`'s horizon."""
        mechanism, t = frames_of(system, self)
        quantity = TurnOfFrame(mechanism, t, self)
        limit = Equal(quantity, 0.0, at=self.at) if self.within is None else Within(quantity, at=self.at)
        return limit.rows(system, first)
