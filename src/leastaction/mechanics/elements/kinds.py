"""Kinds of fields of elements: what each holds, uses and shows.

A kind checks what is given, knows the names that a value uses and the numbers that it holds, and shows it;
`leastaction.mechanics.elements.base.Element` asks it.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.poses import pose
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.directions import Direction, read_direction, three
from leastaction.numerics.arrays import as_array, as_flag, as_number
from leastaction.numerics.curve import Curve
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class Uses:
    """The names that an element uses, by kind.

    Attributes
    ----------
    frames : tuple of str
    dynamic, variables : tuple of str
        Known dynamic variables; known variables of either kind.
    kinematic, either : tuple of str
        Kinematic variables; variables of either kind. A name that no frame uses is a new kinematic variable.
    inputs : tuple of str
        Inputs, new with the element or shared with others.
    """

    frames: tuple[str, ...] = ()
    dynamic: tuple[str, ...] = ()
    kinematic: tuple[str, ...] = ()
    variables: tuple[str, ...] = ()
    either: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()

    def __add__(self, other: Uses) -> Uses:
        return Uses(**{kind: tuple(dict.fromkeys(a + getattr(other, kind))) for kind, a in vars(self).items()})


class Kind(abc.ABC):
    """A kind of field; the methods take values that `read` returned."""

    def for_value(self, value: Any) -> Kind:
        """The kind of a value, which answers the questions below, where a field takes several."""
        return self

    @abc.abstractmethod
    def read(self, value: Any, what: str) -> Any:
        """Return what was given, checked and hashable, or raise a `DescriptionError`."""

    def uses(self, value: Any) -> Uses:
        """The names that a value uses."""
        return Uses()

    def acts_on(self, value: Any) -> tuple[str, ...]:
        """The frames and variables that the element is called after."""
        return ()

    def movers(self, value: Any, context: Context) -> tuple[frozenset[str], str] | None:
        """The variables that change the scalar, if this is one, and the end of "no variable ..."."""
        return None

    def strings(self, value: Any) -> tuple[tuple[str, ...], ...]:
        """The paths of frames whose length it is."""
        return ()

    def numbers(self, field: str, value: Any) -> dict[str, float]:
        """The numbers that a value holds, by the names of the parameters."""
        return {}

    def with_number(self, field: str, value: Any, parameter: str, number: float) -> Any:
        """Return the value with another number of one parameter, not checked yet."""
        raise NotImplementedError

    def prescribed(self, value: Any) -> dict[str, str]:
        """The units of variables that stand for a number, by their names."""
        return {}

    def show(self, value: Any) -> str:
        """Return a value as text."""
        return str(value)


# Names


@dataclass(frozen=True)
class Frame(Kind):
    """The name of a frame; two such fields of an element are different frames.

    ``end``: whether it is one of two between which the element is a string, so that they must not meet.
    """

    end: bool = False

    def read(self, value: object, what: str) -> str:
        return check_name(value, f"{what}, a frame")

    def uses(self, value: str) -> Uses:
        return Uses(frames=(value,))

    def acts_on(self, value: str) -> tuple[str, ...]:
        return (value,)


@dataclass(frozen=True)
class Variable(Kind):
    """The name of a variable that is there, ``dynamic``, or of a ``kinematic`` one that may be new."""

    kind: str

    def read(self, value: object, what: str) -> str:
        return check_name(value, f"{what}, a {self.kind} variable")

    def uses(self, value: str) -> Uses:
        return Uses(**{self.kind: (value,)})

    def acts_on(self, value: str) -> tuple[str, ...]:
        return (value,) if self.kind == "dynamic" else ()


@dataclass(frozen=True)
class Input(Kind):
    """The name of an input."""

    def read(self, value: object, what: str) -> str:
        return check_name(value, what)

    def uses(self, value: str) -> Uses:
        return Uses(inputs=(value,))


@dataclass(frozen=True)
class Names(Kind):
    """A list of names of frames (``of="frames"``) or of variables (``of="variables"``)."""

    of: str

    def read(self, value: Any, what: str) -> tuple[str, ...]:
        if isinstance(value, (str, Mapping)) or not isinstance(value, Iterable):
            raise DescriptionError(f"{what}: expected a list, got {value!r} alone; write [...]")
        return tuple(check_name(name, what) for name in value)

    def uses(self, value: tuple[str, ...]) -> Uses:
        return Uses(**{self.of: value})

    def acts_on(self, value: tuple[str, ...]) -> tuple[str, ...]:
        return value


# Numbers


@dataclass(frozen=True)
class Number(Kind):
    """A finite number, which ``accept`` holds to what is ``expected``, with the reason ``why``."""

    accept: Callable[[float], bool] | None = None
    expected: str = "a number"
    why: str = ""
    unit: str = ""

    def read(self, value: object, what: str) -> float:
        given = as_number(value, what, error=DescriptionError)
        if self.accept is not None and not self.accept(given):
            raise DescriptionError(f"{what}: got {self.show(given)}, expected {self.expected}, {self.why}")
        return given

    def numbers(self, field: str, value: float) -> dict[str, float]:
        return {field: value}

    def with_number(self, field: str, value: float, parameter: str, number: float) -> float:
        return number

    def show(self, value: float) -> str:
        return f"{value:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class NumberOrVariable(Kind):
    """A number, or the name of the variable that has its value; ``kind`` is kinematic or either."""

    number: Number
    kind: str

    def for_value(self, value: float | str) -> Kind:
        return Variable(self.kind) if isinstance(value, str) else self.number

    def read(self, value: object, what: str) -> float | str:
        return check_name(value, what) if isinstance(value, str) else self.number.read(value, what)

    def prescribed(self, value: float | str) -> dict[str, str]:
        return {value: self.number.unit} if isinstance(value, str) else {}


class Several(Kind):
    """Several numbers, each of them a parameter."""

    @abc.abstractmethod
    def named(self, field: str, count: int) -> list[str]:
        """Return the names of so many parameters."""

    def numbers(self, field: str, value: Sequence[float]) -> dict[str, float]:
        return dict(zip(self.named(field, len(value)), value, strict=True))

    def with_number(self, field: str, value: Sequence[float], parameter: str, number: float) -> tuple[float, ...]:
        return tuple({**self.numbers(field, value), parameter: number}.values())

    def show(self, value: Sequence[float]) -> str:
        return ", ".join(f"{name} {number:g}" for name, number in self.numbers("", value).items())


@dataclass(frozen=True)
class Vector(Several):
    """Three numbers, the parameters ``<field>.x`` and so on."""

    def read(self, value: object, what: str) -> tuple[float, float, float]:
        return three(value, what)

    def named(self, field: str, count: int) -> list[str]:
        return [f"{field}.{axis}" for axis in "xyz"[:count]]

    def show(self, value: Sequence[float]) -> str:
        return f"({', '.join(f'{number:g}' for number in value)})"


@dataclass(frozen=True)
class Polynomial(Several):
    """The coefficients of a polynomial, the parameters c0, c1 and so on; two at least, or it would be a constant."""

    def read(self, value: Any, what: str) -> tuple[float, ...]:
        listed = isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, (str, bytes))
        if not listed or not 2 <= len(value) <= 16:
            raise DescriptionError(f"{what}: expected a list of two to sixteen numbers c0, c1, c2, ..., got {value!r}")
        return tuple(Number().read(c, f"{what}: c{i}") for i, c in enumerate(value))

    def named(self, field: str, count: int) -> list[str]:
        return [f"c{i}" for i in range(count)]


# Others


@dataclass(frozen=True)
class Axis(Kind):
    """A direction in the axes of a frame."""

    def read(self, value: object, what: str) -> Direction:
        return read_direction(value, what)

    def show(self, value: Direction) -> str:
        return value if isinstance(value, str) else Vector().show(value)


@dataclass(frozen=True)
class Rotation(Kind):
    """The rows of a rotation matrix."""

    def read(self, value: object, what: str) -> tuple[tuple[float, float, float], ...]:
        given = as_array(value, what, (3, 3), error=DescriptionError)
        try:
            matrix = pose(rotation=given).matrix
        except DescriptionError as error:
            raise DescriptionError(f"{what}: {error}") from None
        assert matrix is not None
        return tuple(three(row, what) for row in np.asarray(matrix)[:3, :3])


@dataclass(frozen=True)
class Flag(Kind):
    """True or False."""

    def read(self, value: object, what: str) -> bool:
        return as_flag(value, what, error=DescriptionError)


@dataclass(frozen=True)
class SmoothCurve(Kind):
    """A `Curve`."""

    def read(self, value: object, what: str) -> Curve:
        if not isinstance(value, Curve):
            raise DescriptionError(
                f"{what}: expected a Curve, got {value!r}; make one from points, Curve(x, y), or by Curve.from_function"
            )
        return value

    def show(self, value: Curve) -> str:
        return f"over {value.start:g} to {value.end:g}"
