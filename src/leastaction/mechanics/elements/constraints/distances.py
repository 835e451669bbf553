"""Holonomic constraints: equations h(q) = 0 that the motion keeps.

Here those of distances, of coinciding points and of sums of variables; `guides` has those that lead a
point, `loops` those that close a loop by a joint.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.along import Along, FramePair, Path, Sum, with_factor
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.reading import length_or_variable, number, show_length


@dataclass(frozen=True)
class Constraint(Element):
    """Base of the elements that add constraint equations; adds a single one unless it says otherwise."""

    @property
    def equations(self) -> tuple[str, ...]:
        """One equation, with the name of the element."""
        return ("",)

    def check_moved(self, context: Context, movers: Iterable[str], why: str) -> None:
        """Raise a `DescriptionError` if no dynamic variable is among the movers."""
        self.check_some_dynamic(context, movers, f"no dynamic variable {why}")


def refuse_own_variable(
    element: Element, variable: str, context: Context, frames: tuple[str, ...], what: str
) -> None:
    """Complain if the variable that prescribes what a constraint holds moves one of its frames itself."""
    if variable in context.moving(*frames):
        raise DescriptionError(
            f"{element.label}: {what} {variable!r} is also the variable of a frame that moves one of the "
            "ends; prescribe it by a variable of its own"
        )


@dataclass(frozen=True)
class Distance(FramePair, Constraint):
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
        length = length_or_variable(self.length, f"{self.label}: the length")
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
        return f"{self.frame1} to {self.frame2}, {show_length(self.length)}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_distance(context, "hold their distance")
        if isinstance(self.length, str):
            refuse_own_variable(
                self, self.length, context, (self.frame1, self.frame2), "the length"
            )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        if isinstance(self.length, str):
            builder.add_distance(first, second, 0.0, context.variable(self.length))
        else:
            slot = builder.add_distance(first, second, self.length)
            context.record(self, "length", slot)


@dataclass(frozen=True)
class PointToPoint(FramePair, Constraint):
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
        self.check_movable(context, "bring them together")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        for axis in self.axes:
            builder.add_coincidence(first, second, np.eye(3)["xyz".index(axis)].copy())


@dataclass(frozen=True)
class PathLength(Along, Constraint):
    """Hold the length of a string over via-points: ``h = sum of |p_i - p_i+1| - L`` (m), a tendon or rope.

    Parameters
    ----------
    frames : sequence of str
        Two frames or more, in the order of the string: the ends, and between them the via-points, such
        as pulleys of no radius.
    length : float or str
        The length L (m), or the name of the kinematic variable that prescribes it. A name that no frame
        uses is a new kinematic variable.
    name : str, optional

    Raises
    ------
    DescriptionError
        If there are fewer than two frames, one follows itself, or the length is not positive.

    Notes
    -----
    The multiplier is the impulse of the tension. Consecutive frames must not meet, where the string has no
    direction.
    """

    frames: Sequence[str]
    length: float | str

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "frames", Path.read(self.frames, f"{self.title}: frames"))
        length = length_or_variable(self.length, f"{self.title}: the length")
        object.__setattr__(self, "length", length)

    @property
    def scalar(self) -> Path:
        """What the constraint holds."""
        return Path(tuple(self.frames))

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        kinematic = (self.length,) if isinstance(self.length, str) else ()
        return Uses(frames=tuple(self.frames), kinematic=kinematic)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"path_length({self.scalar.names})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.scalar}, {show_length(self.length)}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        if isinstance(self.length, str):
            refuse_own_variable(self, self.length, context, tuple(self.frames), "the length")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        coordinate = self.coordinate(builder, context)
        if isinstance(self.length, str):
            builder.add_constraint(coordinate, -1, context.variable(self.length))
        else:
            slot = context.parameter(builder, self, "length", self.length)
            builder.add_constraint(coordinate, slot)


@dataclass(frozen=True)
class Coupling(Along, Constraint):
    """Couple configuration variables: ``h = sum of factor q - offset``, such as gears or a screw.

    Two gears of n1 and n2 teeth: ``{"a": n1, "b": n2}``. A screw of pitch p (m per turn) whose nut cannot
    turn: ``{"x": 1.0, "angle": -p / (2 pi)}``. The multiplier is the impulse between the teeth. Without the
    wish for it, write the sum as the coordinate of a frame: that costs no equation.

    Parameters
    ----------
    factors : mapping of str to float
        Factor of every variable of the sum, not zero.
    offset : float, optional
        What the sum is held at.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the factors are none or one is zero, or a number is not finite.
    """

    factors: Mapping[str, float]
    offset: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        given: object = self.factors
        if isinstance(given, str):
            raise DescriptionError(
                f"{self.title}: factors: expected a mapping of variables to factors, got {given!r}"
            )
        object.__setattr__(self, "factors", Sum.read(self.factors, f"{self.title}: factors"))
        object.__setattr__(self, "offset", number(self.offset, f"{self.title}: offset"))

    @property
    def scalar(self) -> Sum:
        """What the constraint holds."""
        return Sum.of(self.factors)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"coupling({self.scalar.names})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.scalar} = {self.offset:g}"

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        changed = with_factor(self, "factors", parameter, value)
        return super().with_number(parameter, value) if changed is None else changed

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slot = context.parameter(builder, self, "offset", self.offset)
        builder.add_constraint(self.coordinate(builder, context), slot)
