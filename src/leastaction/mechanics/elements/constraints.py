"""Holonomic constraints: equations h(q) = 0 that the motion keeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.arguments import as_number
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.frames import check_name
from leastaction.mechanics.tree import Joint


@dataclass(frozen=True)
class Constraint(Element):
    """Base of the elements that add constraint equations; adds a single one unless it says otherwise."""

    @property
    def equations(self) -> tuple[str, ...]:
        """One equation, with the name of the element."""
        return ("",)


@dataclass(frozen=True)
class FramePair(Constraint):
    """Base of the constraints between the origins of two frames, one of which the other must be free to meet.

    Parameters
    ----------
    frame1, frame2 : str
        The frames.
    name : str, optional
        Name of the constraint.
    """

    frame1: str
    frame2: str

    def __post_init__(self) -> None:
        super().__post_init__()
        kind = type(self).__name__
        check_name(self.frame1, f"{kind}: frame1")
        check_name(self.frame2, f"{kind}: frame2")
        if self.frame1 == self.frame2:
            raise DescriptionError(
                f"{self.label}: both ends are the frame {self.frame1!r}; give two different frames"
            )

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=(self.frame1, self.frame2))

    def joints_that_can(self, context: Context, task: str) -> list[Joint]:
        """Return the joints between the frames; complain that nothing can do the task if none is free."""
        between = context.joints_between(self.frame1, self.frame2)
        joints = [context.tree.joints[joint] for joint in between]
        if all(joint.kinematic for joint in joints):
            raise DescriptionError(
                f"{self.label}: no dynamic variable moves {self.frame1!r} relative to {self.frame2!r}, so "
                f"nothing can {task}; remove the constraint or choose other frames"
            )
        return joints

    def points(self, builder: Builder, context: Context) -> tuple[int, int]:
        """Add both origins to the core and return them."""
        return context.point(builder, self.frame1), context.point(builder, self.frame2)


@dataclass(frozen=True)
class Distance(FramePair):
    """Hold the distance between two frames: ``h = |p1 - p2|^2 - L^2`` (m^2), a rod or a taut string.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends.
    length : float or str
        The distance (m), or the name of the kinematic variable that prescribes it. A name that no frame
        uses is a new kinematic variable.
    name : str, optional
        Name of the constraint.

    Raises
    ------
    DescriptionError
        If both ends are the same frame or the length is not positive.
    """

    length: float | str

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.length, str):
            check_name(self.length, f"{self.label}: length")
            return
        length = as_number(self.length, f"{self.label}: length", error=DescriptionError)
        if length <= 0.0:
            raise DescriptionError(
                f"{self.label}: the length is {length} m; expected a positive one, as a string of zero "
                "length has no direction to pull in"
            )
        object.__setattr__(self, "length", length)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        kinematic = (self.length,) if isinstance(self.length, str) else ()
        return Uses(frames=(self.frame1, self.frame2), kinematic=kinematic)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"distance({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        length = self.length if isinstance(self.length, str) else f"{self.length:g} m"
        return f"{self.frame1} to {self.frame2}, {length}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        joints = self.joints_that_can(context, "hold their distance")
        if any(joint.variable == self.length for joint in joints):
            raise DescriptionError(
                f"{self.label}: the length {self.length!r} is also the variable of a frame that moves one "
                "of the ends; prescribe the length by a variable of its own"
            )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        if isinstance(self.length, str):
            builder.add_distance(first, second, 0.0, context.variable(self.length))
        else:
            builder.add_distance(first, second, self.length)


@dataclass(frozen=True)
class PointToPoint(FramePair):
    """Let the origins of two frames coincide along axes of the world: ``h = p1[axis] - p2[axis]`` (m).

    Closes a loop of bodies: in the plane with two axes, in space with three. One equation an axis, named
    ``name.x`` and so on.

    Parameters
    ----------
    frame1, frame2 : str
        The frames.
    axes : str, optional
        Axes of the world along which they coincide, some of ``"xyz"``.
    name : str, optional
        Name of the constraint.

    Raises
    ------
    DescriptionError
        If both are the same frame or the axes are not some of x, y and z.
    """

    axes: str = "xyz"

    def __post_init__(self) -> None:
        super().__post_init__()
        axes: object = self.axes
        known = isinstance(axes, str) and axes != "" and set(axes) <= set("xyz")
        if not known or len(set(self.axes)) < len(self.axes):
            raise DescriptionError(
                f"{self.label}: got axes {axes!r}, expected some of 'xyz', each once"
            )

    @property
    def equations(self) -> tuple[str, ...]:
        """One equation an axis."""
        return tuple(f".{axis}" for axis in self.axes)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"point_to_point({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.frame1} on {self.frame2} along {', '.join(self.axes)}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.joints_that_can(context, "bring them together")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        for axis in self.axes:
            builder.add_coincidence(first, second, np.eye(3)["xyz".index(axis)].copy())
