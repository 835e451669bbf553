"""Linear springs: quadratic energies of a variable, a length or an angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.along import Along, FramePair, Sum, with_factor
from leastaction.mechanics.elements.base import Builder, Context, Element
from leastaction.mechanics.elements.potentials.gravity import Potential
from leastaction.mechanics.elements.reading import (
    PULLS_BACK,
    Direction,
    direction,
    number,
    positive,
    show,
    triad,
)
from leastaction.mechanics.expressions.tapes import TapeWriter, dot


@dataclass(frozen=True)
class JointSpring(Along, Potential):
    """A spring on a configuration variable, or on a sum of some: ``V = k/2 (s - s0)^2``.

    Parameters
    ----------
    variable : str or mapping of str to float
        The variable s, or the factors of the sum ``s = sum of factor q``.
    stiffness : float
        The stiffness k (N/m or N m/rad).
    rest : float, optional
        Value s0 of s at which the spring is slack (m or rad).
    name : str, optional

    Raises
    ------
    DescriptionError
        If the stiffness is not positive, a factor is zero, or a number is not finite.
    """

    variable: str | Mapping[str, float]
    stiffness: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        title = self.title
        object.__setattr__(self, "variable", Sum.read(self.variable, f"{title}: variable"))
        stiffness = positive(self.stiffness, f"{title}: stiffness", PULLS_BACK)
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "rest", number(self.rest, f"{title}: rest"))

    @property
    def scalar(self) -> Sum:
        """What the spring acts along."""
        return Sum.of(self.variable)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"joint_spring({self.scalar.names})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.scalar}, stiffness {self.stiffness:g}, rest {self.rest:g}"

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        changed = with_factor(self, "variable", parameter, value)
        return super().with_number(parameter, value) if changed is None else changed

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots = [
            context.parameter(builder, self, "stiffness", self.stiffness),
            context.parameter(builder, self, "rest", self.rest),
        ]
        builder.add_potential(self.coordinate(builder, context), builder.law("spring", slots))


@dataclass(frozen=True)
class LinearSpring(FramePair, Potential):
    """A spring between two frames: ``V = k/2 (|p1 - p2| - L)^2``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends.
    stiffness : float
        The stiffness k (N/m).
    length : float, optional
        Length L of the slack spring (m).
    name : str, optional

    Raises
    ------
    DescriptionError
        If both ends are the same frame, the stiffness is not positive or the length negative.

    Notes
    -----
    The ends of a spring with a length must not meet: there it has no direction to push in. Without one
    the energy is ``k/2 |p1 - p2|^2``, which is smooth everywhere; such a spring has no parameter
    ``"spring.length"``.
    """

    stiffness: float
    length: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        stiffness = positive(self.stiffness, f"{self.title}: stiffness", PULLS_BACK)
        length = positive(self.length, f"{self.title}: length", "in metres", zero=True)
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "length", length)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"spring({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.frame1} to {self.frame2}, {self.stiffness:g} N/m, length {self.length:g} m"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        if self.length > 0.0:
            self.check_distance(context, "give way to the spring")
        else:
            self.check_movable(context, "give way to the spring")

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        if parameter == "length" and value == 0.0:
            raise DescriptionError(
                f"{self.label}: length: got 0, but a spring that was described with a length keeps one; "
                "describe the mechanism anew with a spring without"
            )
        return super().with_number(parameter, value)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        stiffness = context.parameter(builder, self, "stiffness", self.stiffness)
        if self.length > 0.0:
            length = context.parameter(builder, self, "length", self.length)
            law = builder.law("spring", [stiffness, length])
            builder.add_potential(builder.path_coordinate([first, second]), law)
            return
        law = builder.law("spring", [stiffness, context.constant(builder, 0.0)])
        for axis in np.eye(3):
            along = context.direction(builder, context.world, axis)
            builder.add_potential(builder.component_coordinate(first, second, along), law)


@dataclass(frozen=True)
class TorsionalSpring(FramePair, Potential):
    """A spring against the turning of one frame relative to another: ``V = k/2 (phi - phi0)^2``.

    The angle is that of frame2 about an axis a of frame1: with e fixed across the axis in frame1, and
    d the same vector of frame2, ``phi = atan2((a x e) . d, e . d)``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames; at the same attitude the angle is zero.
    stiffness : float
        The stiffness k (N m/rad).
    axis : str or array_like, shape (3,), optional
        Axis in frame1: ``"x"``, ``"y"``, ``"z"`` or three numbers.
    rest : float, optional
        Angle phi0 of the slack spring (rad), between -pi and pi.
    name : str, optional

    Raises
    ------
    DescriptionError
        If both are the same frame, the stiffness is not positive, the axis is none, or the rest lies
        outside of (-pi, pi).

    Notes
    -----
    The angle lies in (-pi, pi) and jumps there, and so would the energy: for a joint that turns further
    use `JointSpring`. If frame2 tilts too, the angle is that of the projection of d on the plane across
    the axis; it is not determined where d is along the axis.
    """

    stiffness: float
    axis: Direction = "z"
    rest: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        title = self.title
        stiffness = positive(self.stiffness, f"{title}: stiffness", PULLS_BACK)
        rest = number(self.rest, f"{title}: rest")
        if abs(rest) >= np.pi:
            raise DescriptionError(
                f"{title}: rest: got {rest:g} rad, expected an angle in (-pi, pi), where the spring's angle "
                "lies; use JointSpring for joints that turn further"
            )
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "axis", direction(self.axis, f"{title}: axis"))
        object.__setattr__(self, "rest", rest)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"torsional_spring({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return (
            f"{self.frame1} to {self.frame2} about {show(self.axis)}, {self.stiffness:g} N m/rad, "
            f"rest {self.rest:g} rad"
        )

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_movable(context, "give way to the spring", turning=True)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        _, e, f = triad(self.axis)
        directions = [
            context.direction(builder, self.frame1, e),
            context.direction(builder, self.frame1, f),
            context.direction(builder, self.frame2, e),
        ]
        tape = TapeWriter(9)
        across1, across2, turned = tape.inputs[:3], tape.inputs[3:6], tape.inputs[6:]
        sine, cosine = dot(across2, turned), dot(across1, turned)
        angle = tape.end(tape.apply("atan2", sine, cosine))
        slots = [
            context.parameter(builder, self, "stiffness", self.stiffness),
            context.parameter(builder, self, "rest", self.rest),
        ]
        coordinate = builder.tape_coordinate([], directions, [], angle, [])
        builder.add_potential(coordinate, builder.law("spring", slots))
