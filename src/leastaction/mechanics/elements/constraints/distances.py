"""Holonomic constraints: equations h(q) = 0 that the motion keeps.

Here those of distances, of coinciding points and of sums of variables; `guides` has those that lead a
point, `loops` those that close a loop by a joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Constraint, Element
from leastaction.mechanics.elements.compiler import Compiler, Paths, Scalar
from leastaction.mechanics.elements.fields import (
    END,
    FACTORS,
    FRAME,
    OTHER_SUM_OR_PATH,
    PATH,
    SUM_OR_PATH,
    number,
    positive,
)
from leastaction.mechanics.elements.forces.tendons import TendonForce
from leastaction.mechanics.elements.kinds import Kind, Polynomial
from leastaction.mechanics.elements.looks import Look, Push, along_axes
from leastaction.mechanics.elements.potentials.springs import ElasticString, LinearSpring
from leastaction.mechanics.elements.scalars import unit_of
from leastaction.mechanics.elements.units import common
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public

_LENGTH = positive("as a string of zero length has no direction to pull in", unit="m", variable="kinematic")


@public
@dataclass(frozen=True)
class Distance(Constraint):
    """Hold the distance between two frames: ``h = |p1 - p2|^2 - L^2`` (m^2), a rod or a taut string.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends.
    length : float or str
        The distance (m), or the name of the kinematic variable that prescribes it. A name that no frame
        uses is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If both ends are the same frame or the length is not positive.
    """

    frame1: str = field(metadata=END)
    frame2: str = field(metadata=END)
    length: float | str = field(metadata=_LENGTH)

    called = "distance"
    reads = "{frame1} to {frame2}, {length}"
    task = "hold their distance"

    @property
    def looks(self) -> tuple[Look, ...]:
        return (Look("string" if isinstance(self.length, str) else "rod", (self.frame1, self.frame2)),)

    @property
    def length_variable(self) -> str | None:
        return self.length if isinstance(self.length, str) else None

    def tension(self, impulse: Array, dt: Array, start: Mapping[str, Array]) -> Array:
        length = start[self.length] if isinstance(self.length, str) else self.length
        return 2.0 * length * impulse / dt

    def as_spring(self, stiffness: float) -> Element:
        return LinearSpring(self.frame1, self.frame2, stiffness, self.length, name=self.name)

    def as_string(self, stiffness: float, smoothing: float) -> Element:
        return ElasticString((self.frame1, self.frame2), stiffness, self.length, smoothing=smoothing, name=self.name)

    def as_force(self, tension: str) -> Element:
        return TendonForce((self.frame1, self.frame2), tension, name=self.name)

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m^2",)

    def add_to(self, core: Compiler) -> None:
        ends = core.point(self.frame1), core.point(self.frame2)
        if isinstance(self.length, str):
            core.builder.add_distance(*ends, 0.0, core.variable(self.length))
        else:
            core.record("length", core.builder.add_distance(*ends, self.length))


@dataclass(frozen=True)
class _Axes(Kind):
    """Some of the world's axes."""

    def read(self, value: object, what: str) -> str:
        known = isinstance(value, str) and value != "" and set(value) <= set("xyz")
        if not isinstance(value, str) or not known or len(set(value)) < len(value):
            raise DescriptionError(f"{what}: got {value!r}, expected some of 'xyz', each once")
        return value

    def show(self, value: str) -> str:
        return ", ".join(value)


@public
@dataclass(frozen=True)
class PointToPoint(Constraint):
    """Let the origins of two frames coincide along axes of the world: ``h = p1[axis] - p2[axis]`` (m).

    Closes a loop of bodies: in the plane with two axes, in space with three. One equation an axis, named
    ``name.x`` and so on.

    Parameters
    ----------
    frame1, frame2 : str
        The frames.
    axes : str, optional
        Axes of the world along which they coincide, some of ``"xyz"``.

    Raises
    ------
    DescriptionError
        If both are the same frame or the axes are not some of x, y and z.
    """

    frame1: str = field(metadata=FRAME)
    frame2: str = field(metadata=FRAME)
    axes: str = field(default="xyz", metadata={"kind": _Axes()})

    called = "point_to_point"
    reads = "{frame1} on {frame2} along {axes}"
    task = "bring them together"

    @property
    def equations(self) -> tuple[str, ...]:
        return tuple(f".{axis}" for axis in self.axes)

    @property
    def pushes(self) -> tuple[Push, ...]:
        return (Push(self.frame1, along_axes({axis: f".{axis}" for axis in self.axes})),)

    def as_spring(self, stiffness: float) -> Element:
        return LinearSpring(self.frame1, self.frame2, stiffness, name=self.name)

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m",) * len(self.equations)

    def add_to(self, core: Compiler) -> None:
        first, second = core.point(self.frame1), core.point(self.frame2)
        for axis in self.axes:
            core.builder.add_coincidence(first, second, np.eye(3)["xyz".index(axis)].copy())


@public
@dataclass(frozen=True)
class PathLength(Constraint):
    """Hold the length of a string over via-points: ``h = sum of |p_i - p_i+1| - L`` (m), a tendon or rope.

    Parameters
    ----------
    frames : sequence of str, or mapping of such to float
        Two frames or more, in the order of the string: the ends, and between them the via-points, such
        as pulleys of no radius.
    length : float or str
        The length L (m), or the name of the kinematic variable that prescribes it. A name that no frame
        uses is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If there are fewer than two frames, one follows itself, or the length is not positive.

    Notes
    -----
    The multiplier is the impulse of the tension. Consecutive frames must not meet, where the string has no direction.
    """

    frames: Paths = field(metadata=PATH)
    length: float | str = field(metadata=_LENGTH)

    called = "path_length"
    reads = "{frames}, {length}"
    seen_as = "string"

    @property
    def length_variable(self) -> str | None:
        return self.length if isinstance(self.length, str) else None

    def tension(self, impulse: Array, dt: Array, start: Mapping[str, Array]) -> Array:
        return impulse / dt

    def as_spring(self, stiffness: float) -> Element:
        return ElasticString(self.frames, stiffness, self.length, tension_only=False, name=self.name)

    def as_string(self, stiffness: float, smoothing: float) -> Element:
        return ElasticString(self.frames, stiffness, self.length, smoothing=smoothing, name=self.name)

    def as_force(self, tension: str) -> Element:
        return TendonForce(self.frames, tension, name=self.name)

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m",)

    def add_to(self, core: Compiler) -> None:
        core.constraint(core.path(self.frames), "length", self.length)


@public
@dataclass(frozen=True)
class Coupling(Constraint):
    """Couple configuration variables: ``h = sum of factor q - offset``, such as gears or a screw.

    Two gears of n1 and n2 teeth: ``{"a": n1, "b": n2}``. A screw of pitch p (m per turn) whose nut cannot
    turn: ``{"x": 1.0, "angle": -p / (2 pi)}``. The multiplier is the impulse between the teeth. Without the
    wish for it, write the sum as the coordinate of a frame: that costs no equation.

    Parameters
    ----------
    factors : mapping of str to float
        Factor of every variable of the sum, not zero.
    offset : float or str, optional
        What the sum is held at: a number, or the name of the kinematic variable that prescribes it. A name
        that no frame uses is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If the factors are none or one is zero, or a number is not finite.
    """

    factors: Mapping[str, float] = field(metadata=FACTORS)
    offset: float | str = field(default=0.0, metadata=number(variable="kinematic"))

    called = "coupling"
    reads = "{factors} = {offset}"

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        unit = common(of.get(name, "") for name in self.factors)
        return dict.fromkeys(super().units(of), unit)

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return (common(of.get(name, "") for name in self.factors),)

    def add_to(self, core: Compiler) -> None:
        core.constraint(core.sum(self.factors), "offset", self.offset)


@public
@dataclass(frozen=True)
class PolynomialCoupling(Constraint):
    """Couple two scalars by a polynomial: ``h = s - (c0 + c1 x + c2 x^2 + ...)``, such as a knee's rolling.

    Parameters
    ----------
    on : str, mapping of str to float, or sequence of str
        What s is: a variable, a sum of some by their factors, or the length of a path through the origins of frames, or
        of several with a factor each, as in `PathLength`.
    of : str, mapping of str to float, or sequence of str
        What x is, likewise.
    coefficients : sequence of float
        c0, c1, c2, ..., two to sixteen.

    Raises
    ------
    DescriptionError
        If ``on`` or ``of`` is none of these, or the coefficients are not two to sixteen numbers.

    Notes
    -----
    The parameters are ``"polynomial.c0"`` and so on; the factors of the sums are ``"polynomial.factors.a"`` of s and
    ``"polynomial.of.b"`` of x. A linear one of variables is a `Coupling`.
    """

    on: Scalar = field(metadata=SUM_OR_PATH)
    of: Scalar = field(metadata=OTHER_SUM_OR_PATH)
    coefficients: Sequence[float] = field(metadata={"kind": Polynomial()})

    called = "polynomial"
    reads = "{on} by {of}, {coefficients}"

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return (unit_of(self.on, of),)

    def add_to(self, core: Compiler) -> None:
        law = core.law("polynomial", *(f"c{i}" for i in range(len(self.coefficients))))
        core.constraint(core.difference(core.along(self.on), core.along(self.of, "of"), law))
