"""What the fields of elements hold, declared as metadata of plain dataclass fields.

::

    frame1: str = field(metadata=FRAME)
    stiffness: float = field(metadata=positive("as a spring drives back to its rest", unit="N/m"))
    rest: float | str = field(default=0.0, metadata=number(unit="m", variable="either"))

A kind of field checks what is given, knows the names that a value uses and the numbers that it holds, and
shows it; `leastaction.mechanics.elements.base.Element` asks it. A field whose default is None may be left out.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.poses import pose
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.directions import Direction, read_direction, three
from leastaction.numerics.arrays import as_array, as_flag, as_number
from leastaction.numerics.curve import Curve
from leastaction.numerics.names import check_name

PULLS_BACK = "as a spring drives back to its rest"

Metadata = Mapping[str, "Kind"]


class Factors(dict[str, float]):
    """Numbers by name that can be hashed, as the fields of a frozen element must be."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


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


# Scalars of the configuration


@dataclass(frozen=True)
class Sum(Kind):
    """A variable, or the sum of some by their factors, which are the parameters ``factors.<variable>``.

    ``alone``: what a single variable may be: "variables" for any, "dynamic", or "" for none.
    """

    alone: str = "variables"

    def read(self, value: Any, what: str) -> str | Factors:
        if isinstance(value, str) and self.alone:
            return check_name(value, f"{what}: a variable's name")
        if not isinstance(value, Mapping):
            expected = "a variable's name or a mapping" if self.alone else "a mapping"
            raise DescriptionError(
                f"{what}: expected {expected} of variables to factors such as {{'theta': 2.0}}, got {value!r}"
            )
        if not value:
            raise DescriptionError(f"{what}: the mapping is empty; give at least one variable")
        result = Factors()
        for name, given in value.items():
            check_name(name, f"{what}: a variable's name")
            result[name] = as_number(given, f"{what}: {name!r}", error=DescriptionError)
            if result[name] == 0.0:
                raise DescriptionError(f"{what}: the factor of {name!r} is zero; leave the variable out")
        return result

    def uses(self, value: str | Factors) -> Uses:
        return Uses(**{self.alone if isinstance(value, str) else "variables": self.acts_on(value)})

    def acts_on(self, value: str | Factors) -> tuple[str, ...]:
        return (value,) if isinstance(value, str) else tuple(value)

    def movers(self, value: str | Factors, context: Context) -> tuple[frozenset[str], str]:
        names = self.acts_on(value)
        return frozenset(names) & context.variables.keys(), (
            f"is among {', '.join(map(repr, names))}, so nothing can give way to the element; remove it or "
            "name a variable that can"
        )

    def numbers(self, field: str, value: str | Factors) -> dict[str, float]:
        return {} if isinstance(value, str) else {f"factors.{n}": f for n, f in value.items()}

    def with_number(self, field: str, value: Factors, parameter: str, number: float) -> Any:
        return {**value, parameter.removeprefix("factors."): number}

    def show(self, value: str | Factors) -> str:
        if isinstance(value, str):
            return value
        plain = {1.0: "", -1.0: "-"}
        terms = [plain.get(factor, f"{factor:g} ") + name for name, factor in value.items()]
        return " + ".join(terms).replace("+ -", "- ")


@dataclass(frozen=True)
class Path(Kind):
    """The frames of a path: two or more, each different from the one before it.

    Those between the ends are via-points: pulleys of no radius, eyelets, sheaths of a tendon.
    """

    def read(self, value: object, what: str) -> tuple[str, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise DescriptionError(f"{what}: expected a list of frames, got {value!r}")
        names = tuple(check_name(name, what) for name in value)
        if len(names) < 2:
            raise DescriptionError(
                f"{what}: got {len(names)} frame{'s'[: len(names) != 1]}, expected two or more: both ends "
                "and what lies between"
            )
        for before, name in pairwise(names):
            if before == name:
                raise DescriptionError(
                    f"{what}: {name!r} follows itself, which is a piece of length zero; name it once"
                )
        return names

    def uses(self, value: tuple[str, ...]) -> Uses:
        return Uses(frames=value)

    def acts_on(self, value: tuple[str, ...]) -> tuple[str, ...]:
        return value if len(value) <= 3 else (value[0], "...", value[-1])

    def movers(self, value: tuple[str, ...], context: Context) -> tuple[frozenset[str], str]:
        return context.moving(*value), (
            f"moves the frames of the path {self.show(value)} relative to each other, so nothing can change "
            "its length; remove the element or choose other frames"
        )

    def strings(self, value: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        return (value,)

    def show(self, value: tuple[str, ...]) -> str:
        return " to ".join(value)


@dataclass(frozen=True)
class SumOrPath(Kind):
    """A variable, a sum of some, or the length of a path."""

    def read(self, value: object, what: str) -> Any:
        return _kind_of(value).read(value, what)

    def uses(self, value: Any) -> Uses:
        return _kind_of(value).uses(value)

    def acts_on(self, value: Any) -> tuple[str, ...]:
        return _kind_of(value).acts_on(value)

    def movers(self, value: Any, context: Context) -> tuple[frozenset[str], str]:
        return _kind_of(value).movers(value, context)

    def strings(self, value: Any) -> tuple[tuple[str, ...], ...]:
        return _kind_of(value).strings(value)

    def numbers(self, field: str, value: Any) -> dict[str, float]:
        return _kind_of(value).numbers(field, value)

    def with_number(self, field: str, value: Any, parameter: str, number: float) -> Any:
        return _kind_of(value).with_number(field, value, parameter, number)

    def show(self, value: Any) -> str:
        return _kind_of(value).show(value)


def _kind_of(value: object) -> Sum | Path:
    return Sum() if isinstance(value, (str, Mapping)) else Path()


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

    def read(self, value: object, what: str) -> float | str:
        return check_name(value, what) if isinstance(value, str) else self.number.read(value, what)

    def uses(self, value: float | str) -> Uses:
        return Uses(**{self.kind: (value,)}) if isinstance(value, str) else Uses()

    def numbers(self, field: str, value: float | str) -> dict[str, float]:
        return {} if isinstance(value, str) else self.number.numbers(field, value)

    def with_number(self, field: str, value: float, parameter: str, number: float) -> float:
        return number

    def show(self, value: float | str) -> str:
        return value if isinstance(value, str) else self.number.show(value)


@dataclass(frozen=True)
class Vector(Kind):
    """Three numbers, the parameters ``<field>.x`` and so on."""

    def read(self, value: object, what: str) -> tuple[float, float, float]:
        return three(value, what)

    def numbers(self, field: str, value: Sequence[float]) -> dict[str, float]:
        return {f"{field}.{axis}": number for axis, number in zip("xyz", value, strict=True)}

    def with_number(self, field: str, value: Sequence[float], parameter: str, number: float) -> tuple[float, ...]:
        return tuple({**self.numbers(field, value), parameter: number}.values())

    def show(self, value: Sequence[float]) -> str:
        return f"({', '.join(f'{number:g}' for number in value)})"


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


# What declarations are written with: metadata of `dataclasses.field`

FRAME: Metadata = {"kind": Frame()}
END: Metadata = {"kind": Frame(end=True)}
FRAMES: Metadata = {"kind": Names("frames")}
PATH: Metadata = {"kind": Path()}
DYNAMIC: Metadata = {"kind": Variable("dynamic")}
KINEMATIC: Metadata = {"kind": Variable("kinematic")}
SUM: Metadata = {"kind": Sum()}
DYNAMIC_SUM: Metadata = {"kind": Sum("dynamic")}
FACTORS: Metadata = {"kind": Sum("")}
SUM_OR_PATH: Metadata = {"kind": SumOrPath()}
INPUT: Metadata = {"kind": Input()}
VECTOR: Metadata = {"kind": Vector()}
AXIS: Metadata = {"kind": Axis()}
ROTATION: Metadata = {"kind": Rotation()}
FLAG: Metadata = {"kind": Flag()}
CURVE: Metadata = {"kind": SmoothCurve()}


def number(
    accept: Callable[[float], bool] | None = None,
    expected: str = "",
    why: str = "",
    *,
    unit: str = "",
    variable: str | None = None,
) -> Metadata:
    """Return the metadata of a finite number.

    ``accept``: whether the element can have it. ``expected``, ``why``: what the message says if it cannot. ``unit``:
    shown behind the number. ``variable`` {"kinematic", "either"}: the kind of variable that may stand for the number;
    none by default.
    """
    kind = Number(accept, expected, why, unit)
    return {"kind": kind if variable is None else NumberOrVariable(kind, variable)}


def positive(why: str, *, unit: str = "", variable: str | None = None) -> Metadata:
    """Return the metadata of a positive number; see `number`."""
    return number(lambda x: x > 0.0, "a positive number", why, unit=unit, variable=variable)


def not_negative(why: str, *, unit: str = "", variable: str | None = None) -> Metadata:
    """Return the metadata of a number that is zero or more; see `number`."""
    return number(lambda x: x >= 0.0, "zero or more", why, unit=unit, variable=variable)


def not_zero(why: str, *, unit: str = "") -> Metadata:
    """Return the metadata of a number that is not zero; see `number`."""
    return number(lambda x: x != 0.0, "a number that is not zero", why, unit=unit)
