"""Constraints that close a loop of bodies by a joint, without equations to spare."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from leastaction.mechanics.elements.along import FramePair
from leastaction.mechanics.elements.base import Builder, Context
from leastaction.mechanics.elements.constraints.distances import Constraint
from leastaction.mechanics.elements.reading import Direction, direction, flag, rotation, show, triad


@dataclass(frozen=True)
class HingeLoop(FramePair, Constraint):
    """Close a loop by a hinge: two frames share their origin and an axis, about which they turn freely.

    In space these are five equations: the origins coincide along the axes of the world (``name.x``,
    ``name.y``, ``name.z``, m), and the axis a of frame1 is across two vectors b, c of frame2 that are
    across the same axis there (``name.tilt1`` = ``a . b``, ``name.tilt2`` = ``a . c``).

    In a plane mechanism, where every axis is the same by construction, three of these are always met.
    ``planar=True`` leaves them out: the origins coincide along the two directions of frame1 across the
    axis (``name.across1``, ``name.across2``, m).

    Parameters
    ----------
    frame1, frame2 : str
        The frames.
    axis : str or array_like, shape (3,), optional
        The hinge's axis, with the same numbers in both frames: ``"x"``, ``"y"``, ``"z"`` or three numbers.
    planar : bool, optional
        Whether the mechanism is plane, with all its axes along this one.
    name : str, optional

    Raises
    ------
    DescriptionError
        If both are the same frame or the axis is none.

    Notes
    -----
    Take ``planar=True`` for a loop whose joints all turn about parallel axes (or slide across them), the
    five equations for a loop in space. The five run in a plane mechanism too, and in loops that move only
    by their special geometry, such as Bennett's and Bricard's linkages: where equations are redundant, the
    smallest multipliers that explain the motion are found. They then are not unique, so do not read them
    as the forces in the hinge, and every step pays for them. The origins alone, without an axis, are
    `PointToPoint`.

    The axes may close opposed, too: ``a`` and the axis of frame2 are parallel, in one sense or the other.
    """

    axis: Direction = "z"
    planar: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "axis", direction(self.axis, f"{self.title}: axis"))
        object.__setattr__(self, "planar", flag(self.planar, f"{self.title}: planar"))

    @property
    def equations(self) -> tuple[str, ...]:
        """Five equations, or two in a plane."""
        return (".across1", ".across2") if self.planar else (".x", ".y", ".z", ".tilt1", ".tilt2")

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"hinge({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        plane = ", planar" if self.planar else ""
        return f"{self.frame1} on {self.frame2} about {show(self.axis)}{plane}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_movable(context, "close the loop")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        along, *across = triad(self.axis)
        if self.planar:
            for side in across:
                held = context.direction(builder, self.frame1, side)
                builder.add_constraint(builder.component_coordinate(first, second, held))
            return
        for axis in np.eye(3):
            builder.add_coincidence(first, second, axis.copy())
        hinge = context.direction(builder, self.frame1, along)
        for side in across:
            other = context.direction(builder, self.frame2, side)
            builder.add_constraint(builder.product_coordinate(hinge, other))


@dataclass(frozen=True)
class FixedOrientation(FramePair, Constraint):
    """Hold the attitude of one frame relative to another; the origins stay free.

    With the axes e of frame1 and d of frame2 after the wanted rotation was taken back, the three
    equations are ``name.x``: ``e_y . d_z = 0``, ``name.y``: ``e_z . d_x = 0``, ``name.z``:
    ``e_x . d_y = 0``. Their derivatives by a rotation about x, y, z are independent at the wanted attitude.

    Parameters
    ----------
    frame1, frame2 : str
        The frames.
    rotation : array_like, shape (3, 3), optional
        The wanted axes of frame2 in frame1, as columns; the same axes if not given.
    name : str, optional

    Raises
    ------
    DescriptionError
        If both are the same frame or the matrix is no rotation.

    Notes
    -----
    Half a turn about any of the axes meets the equations as well. A motion that starts at the wanted
    attitude stays there; an assembly from a rough guess should start nearer to it than to those.
    """

    rotation: npt.ArrayLike | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rotation is not None:
            rows = rotation(self.rotation, f"{self.title}: rotation")
            object.__setattr__(self, "rotation", rows)

    @property
    def equations(self) -> tuple[str, ...]:
        """One equation a rotation."""
        return (".x", ".y", ".z")

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"fixed_orientation({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        how = "turned like" if self.rotation is None else "at a fixed rotation from"
        return f"{self.frame2} {how} {self.frame1}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_movable(context, "hold the attitude", turning=True)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        wanted = np.eye(3) if self.rotation is None else np.asarray(self.rotation, dtype=np.float64)
        # At the wanted attitude, row i of the rotation is axis i of frame1 in the axes of frame2.
        for first, second in ((1, 2), (2, 0), (0, 1)):
            e = context.direction(builder, self.frame1, np.eye(3)[first])
            d = context.direction(builder, self.frame2, wanted[second])
            builder.add_constraint(builder.product_coordinate(e, d))
