"""From elements to the core: coordinates, laws, and what is made of them.

Everything that is added is an index from then on: points, directions, coordinates (scalar functions s(q)),
laws (functions of one number), and slots, the places of numbers. All numbers of elements live in one vector
of the mechanism, so that they can change without another compilation; those that have a name are its parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.directions import Direction, triad
from leastaction.mechanics.elements.scalars import of_variables
from leastaction.mechanics.expressions.tapes import TapeWriter, dot
from leastaction.numerics.curve import Curve

Paths = Sequence[str] | Mapping[tuple[str, ...], float]
"""The frames of a path, or several paths with the factor that the length of each has in their sum."""

Scalar = str | Mapping[str, float] | Paths
"""A variable, a sum of some by their factors, or the length of a path or of a sum of some."""


@dataclass(frozen=True)
class Parts:
    """The parts of the compiled mechanism that an element came to: their counts before it and after it.

    ``uniform_gravity``: whether the weight of all bodies belongs to it, which is no part of its own.
    """

    first: _core.ElementCounts
    last: _core.ElementCounts
    uniform_gravity: bool

    def without_gravity(self) -> Parts:
        """Return the parts that are parts of their own."""
        return replace(self, uniform_gravity=False)


@dataclass(frozen=True)
class Compiler:
    """Adds one element after the other to the core's builder.

    Attributes
    ----------
    builder : leastaction._core.MechanismBuilder
    context : Context
        Names and frames.
    parameters : dict of str to int
        Slots of the numbers that have a name, such as ``"spring.stiffness"``.
    owners : dict of str to (str, str)
        Unique name of the element that each of them belongs to, and its name there.
    element, label : str
        Unique name of the element that is being added, and how messages call it.
    numbers : mapping of str to float
        The numbers that its fields hold.
    parts : dict of str to Parts
        What every element came to, by its unique name.
    """

    builder: _core.MechanismBuilder
    context: Context
    parameters: dict[str, int] = field(default_factory=dict)
    owners: dict[str, tuple[str, str]] = field(default_factory=dict)
    element: str = ""
    label: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    parts: dict[str, Parts] = field(default_factory=dict)
    _points: dict[str, int] = field(default_factory=dict)
    _directions: dict[tuple[int, bytes], int] = field(default_factory=dict)
    _constants: dict[float, int] = field(default_factory=dict)

    def within(self, element: str, label: str, numbers: Mapping[str, float]) -> Compiler:
        """Return the same compiler, shared, while an element is added."""
        return replace(self, element=element, label=label, numbers=numbers)

    # Numbers

    def slot(self, number: str | float) -> int:
        """Slot of a number of the fields, by the name of its parameter; of a plain one, made once."""
        if isinstance(number, str):
            full = f"{self.element}.{number}"
            if self.owners.get(full) == (self.element, number):
                return self.parameters[full]
            return self.parameter(number, self.numbers[number])
        if number not in self._constants:
            self._constants[number] = self.builder.add_number(number)
        return self._constants[number]

    def parameter(self, name: str, value: float) -> int:
        """Add a number as the parameter ``"element.name"``; return its slot."""
        return self.record(name, self.builder.add_number(float(value)))

    def record(self, name: str, slot: int) -> int:
        """Record a slot that the builder gave to a number of the element; return it."""
        full = f"{self.element}.{name}"
        if full in self.parameters:
            raise DescriptionError(
                f"{self.label}: its parameter {full!r} is also one of the element {self.owners[full][0]!r}; "
                "give one of them another name="
            )
        self.parameters[full], self.owners[full] = slot, (self.element, name)
        return slot

    def time(self, wanted: bool) -> list[int]:
        """Slot of the time, where it is wanted."""
        return [self.builder.time()] if wanted else []

    # What stands in the world

    def variable(self, name: str) -> int:
        """Index of a configuration variable, which is no turn of a quaternion."""
        if name in self.context.turns:
            raise DescriptionError(
                f"{self.label}: {name!r} is a turn of the joint {self.context.turns[name]!r}, whose rotation is a "
                "quaternion, and no number that an expression, a rotor or a length could hold. Springs, dampers, "
                "motors and couplings act on it; or give the joint angles, axes='xyz'"
            )
        return self.context.variables[name]

    def input(self, name: str) -> int:
        """Index of an input."""
        return self.context.inputs.index(name)

    def point(self, frame: str) -> int:
        """Index of the point at a frame's origin, made once."""
        if frame not in self._points:
            placed = self.context.placed(frame)
            offset = np.ascontiguousarray(placed.pose[:3, 3])
            self._points[frame] = self.builder.add_point(placed.joint, offset)
        return self._points[frame]

    def direction(self, frame: str, vector: ArrayLike) -> int:
        """Index of a vector (3,) in the axes of a frame, made once."""
        placed = self.context.placed(frame)
        turned = placed.pose[:3, :3] @ np.asarray(vector, dtype=np.float64)
        key = (placed.joint, turned.tobytes())
        if key not in self._directions:
            self._directions[key] = self.builder.add_direction(placed.joint, turned)
        return self._directions[key]

    # Coordinates

    def sum(self, given: str | Mapping[str, float], prefix: str = "factors") -> int:
        """Add a variable, or the sum of some by factors, which are parameters.

        A turn of a quaternion stands for its component of the joint's rotation vector.
        """
        names = _names(given)
        if self.context.turns.keys().isdisjoint(names):
            return self.builder.variables_coordinate([self.variable(n) for n in names], self.factors(given, prefix))
        each = [
            self.builder.rotation_coordinate(self.context.variables[n])
            if n in self.context.turns
            else self.builder.variables_coordinate([self.variable(n)], [self.slot(1.0)])
            for n in names
        ]
        return each[0] if isinstance(given, str) else self.builder.sum_coordinate(each, self.factors(given, prefix))

    def factors(self, given: str | Mapping[str, float], prefix: str = "factors") -> list[int]:
        """Return the slots of the factors of a sum."""
        return [self.slot(1.0 if isinstance(given, str) else f"{prefix}.{n}") for n in _names(given)]

    def path(self, frames: Paths, prefix: str = "factors") -> int:
        """Add the length of the straight pieces through the origins of frames (m), or a sum of such by factors."""
        if not isinstance(frames, Mapping):
            return self.builder.path_coordinate([self.point(frame) for frame in frames])
        slots = [self.slot(f"{prefix}.{i}") for i in range(1, len(frames) + 1)]
        return self.builder.sum_coordinate([self.path(one) for one in frames], slots)

    def along(self, given: Scalar, prefix: str = "factors") -> int:
        """Add what a field of the kind `SumOrPath` holds."""
        of: Any = given
        return self.sum(of, prefix) if of_variables(given) else self.path(of, prefix)

    def difference(self, first: int, second: int, law: int) -> int:
        """Add ``s1 - law(s2)`` of two coordinates."""
        both = [first, self.builder.law_coordinate(second, law)]
        return self.builder.sum_coordinate(both, [self.slot(1.0), self.slot(-1.0)])

    def component(self, frame1: str, frame2: str, carrier: str, vector: ArrayLike) -> int:
        """Add ``e . (p1 - p2)`` with a vector e in the axes of a third frame."""
        direction = self.direction(carrier, vector)
        return self.builder.component_coordinate(self.point(frame1), self.point(frame2), direction)

    def product(self, frame1: str, vector1: ArrayLike, frame2: str, vector2: ArrayLike) -> int:
        """Add ``e . d`` with e fixed in one frame and d in the other."""
        e, d = self.direction(frame1, vector1), self.direction(frame2, vector2)
        return self.builder.product_coordinate(e, d)

    def angle(self, frame1: str, frame2: str, axis: Direction) -> int:
        """Add the angle of frame2 about an axis a of frame1 (rad): ``atan2((a x e) . d, e . d)``.

        e is across the axis in frame1, d the same vector of frame2.
        """
        _, e, f = triad(axis)
        directions = [self.direction(frame1, e), self.direction(frame1, f), self.direction(frame2, e)]
        tape = TapeWriter(9)
        across1, across2, turned = tape.inputs[:3], tape.inputs[3:6], tape.inputs[6:]
        angle = tape.apply("atan2", dot(across2, turned), dot(across1, turned))
        return self.builder.tape_coordinate([], directions, [], tape.end(angle), [])

    def less(self, coordinate: int, name: str, given: float | str) -> tuple[int, str | float]:
        """Prepare a coordinate for a law of ``s - given``, where a field holds a number or a variable.

        Returns the coordinate, less the variable if it is one, and what is left to the law to subtract.
        """
        if isinstance(given, str):
            return self.builder.offset_coordinate(coordinate, variable=self.variable(given)), 0.0
        return coordinate, name

    # Laws

    def law(self, kind: str, *numbers: str | float) -> int:
        """Add a law of a known kind with its numbers.

        ``linear`` (k): k x. ``spring`` (k, x0): k/2 (x - x0)^2. ``polynomial`` (c0, c1, ...). ``inverse`` (c): c/x.
        ``tanh`` (m, e): m tanh(x/e). ``taut`` (k, x0, e): k/2 of the square of ``e log(1 + exp((x - x0)/e))``.
        """
        return self.builder.law(kind, [self.slot(number) for number in numbers])

    def curve(self, curve: Curve, scale: int) -> int:
        """Add a curve times the number in a slot."""
        return self.builder.piecewise_law(curve.breaks, curve.coefficients, scale)

    # Elements

    def rotor(self, given: str | Mapping[str, float], inertia: str) -> None:
        """Add ``T = J/2 (sum of factor v)^2``."""
        self.builder.add_rotor([self.variable(n) for n in _names(given)], self.factors(given), self.slot(inertia))

    def potential(self, coordinate: int, law: int = -1) -> None:
        """Add ``V = law(s)``, or s itself."""
        self.builder.add_potential(coordinate, law)

    def constraint(self, coordinate: int, name: str = "", given: float | str | None = None) -> None:
        """Add ``h = s``, less what a field holds: a number or a variable."""
        if given is None:
            self.builder.add_constraint(coordinate)
        elif isinstance(given, str):
            self.builder.add_constraint(coordinate, variable=self.variable(given))
        else:
            self.builder.add_constraint(coordinate, self.slot(name))

    def force(
        self, coordinate: int, gain: str | float, input_: str | None = None, by_place: int = -1, by_rate: int = -1
    ) -> None:
        """Add ``f_i = F ds/dq_i`` with ``F = gain u by_place(s) by_rate(sdot)``, without what is not given."""
        index = -1 if input_ is None else self.input(input_)
        self.builder.add_force(coordinate, self.slot(gain), index, by_place, by_rate)

    def force_by_rate(self, on: Scalar, gain: str | float, input_: str | None = None, by_rate: int = -1) -> None:
        """Add ``f_i = F ds'/dv_i`` with ``F = gain u by_rate(s')``, s' the rate of what a `SumOrPath` holds.

        The rate of a turn of a quaternion is an angular velocity in the axes of the moved frame.
        """
        of: Any = on
        if not of_variables(on) or self.context.turns.keys().isdisjoint(_names(of)):
            self.force(self.along(on), gain, input_, by_rate=by_rate)
            return
        variables = [self.context.variables[name] for name in _names(of)]
        index = -1 if input_ is None else self.input(input_)
        self.builder.add_rate_force(variables, self.factors(of), self.slot(gain), index, by_rate)

    def tape_force(self, coordinates: Sequence[int], inputs: Sequence[str], tape: Any, slots: Sequence[int]) -> None:
        """Add ``f_i = F ds/dq_i`` along the first of some coordinates.

        F is a tape of all of them, all their rates, the inputs, then the numbers.
        """
        self.builder.add_tape_force(coordinates, [self.input(n) for n in inputs], tape, slots)


def _names(given: str | Mapping[str, float]) -> list[str]:
    return [given] if isinstance(given, str) else list(given)
