"""Constraints that close a loop of bodies by a joint, without equations to spare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.directions import Direction, triad
from leastaction.mechanics.elements.fields import AXIS, FLAG, FRAME, ROTATION
from leastaction.mechanics.elements.looks import Push, along_axes
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class HingeLoop(Constraint):
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

    Raises
    ------
    DescriptionError
        If both are the same frame or the axis is none.

    Notes
    -----
    Take ``planar=True`` for a loop whose joints all turn about parallel axes (or slide across them), the five equations
    for a loop in space. The five run in a plane mechanism too, and in loops that move only by their special geometry,
    such as Bennett's and Bricard's linkages: where equations are redundant, the smallest multipliers that explain the
    motion are found. They then are not unique, so do not read them as the forces in the hinge, and every step pays for
    them. The origins alone, without an axis, are `PointToPoint`.

    The axes may close opposed, too: ``a`` and the axis of frame2 are parallel, in one sense or the other.
    """

    frame1: str = field(metadata=FRAME)
    frame2: str = field(metadata=FRAME)
    axis: Direction = field(default="z", metadata=AXIS)
    planar: bool = field(default=False, metadata=FLAG)

    called = "hinge"
    reads = "{frame1} on {frame2} about {axis}"
    task = "close the loop"

    @property
    def equations(self) -> tuple[str, ...]:
        return (".across1", ".across2") if self.planar else (".x", ".y", ".z", ".tilt1", ".tilt2")

    @property
    def pushes(self) -> tuple[Push, ...]:
        if not self.planar:
            return (Push(self.frame1, along_axes({axis: f".{axis}" for axis in "xyz"})),)
        across = [tuple(float(c) for c in side) for side in triad(self.axis)[1:]]
        terms = tuple(((x, y, z), suffix) for (x, y, z), suffix in zip(across, self.equations, strict=True))
        return (Push(self.frame1, terms, axes=self.frame1),)

    def describe(self) -> str:
        return super().describe() + (", planar" if self.planar else "")

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m", "m") if self.planar else ("m", "m", "m", "", "")

    def add_to(self, core: Compiler) -> None:
        along, *across = triad(self.axis)
        if self.planar:
            for side in across:
                core.constraint(core.component(self.frame1, self.frame2, self.frame1, side))
            return
        first, second = core.point(self.frame1), core.point(self.frame2)
        for axis in np.eye(3):
            core.builder.add_coincidence(first, second, axis.copy())
        for side in across:
            core.constraint(core.product(self.frame1, along, self.frame2, side))


@public
@dataclass(frozen=True)
class FixedOrientation(Constraint):
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

    Raises
    ------
    DescriptionError
        If both are the same frame or the matrix is no rotation.

    Notes
    -----
    Half a turn about any of the axes meets the equations as well, and so does a third of a turn that exchanges them. A
    motion that starts at the wanted attitude stays there; an assembly from a rough guess should start nearer to it than
    to those.
    """

    frame1: str = field(metadata=FRAME)
    frame2: str = field(metadata=FRAME)
    rotation: ArrayLike | None = field(default=None, metadata=ROTATION)

    called = "fixed_orientation"
    task = "hold the attitude"
    turning = True

    @property
    def equations(self) -> tuple[str, ...]:
        return (".x", ".y", ".z")

    def describe(self) -> str:
        how = "turned like" if self.rotation is None else "at a fixed rotation from"
        return f"{self.frame2} {how} {self.frame1}"

    def add_to(self, core: Compiler) -> None:
        axes = np.eye(3)
        wanted = axes if self.rotation is None else np.asarray(self.rotation, dtype=np.float64)
        # At the wanted attitude, row i of the rotation is axis i of frame1 in the axes of frame2.
        for first, second in ((1, 2), (2, 0), (0, 1)):
            core.constraint(core.product(self.frame1, axes[first], self.frame2, wanted[second]))
