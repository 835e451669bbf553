"""Kinds of fields that are scalars of the configuration: sums of variables, lengths of paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.kinds import Kind, Uses
from leastaction.mechanics.elements.units import common
from leastaction.numerics.arrays import as_number
from leastaction.numerics.names import check_name


class Factors(dict[Any, float]):
    """Numbers by name, or by path, that can be hashed, as the fields of a frozen element must be."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


def of_variables(value: object) -> bool:
    """Whether a scalar is a variable or a sum of some; else it is one of paths."""
    return isinstance(value, str) or (isinstance(value, Mapping) and not any(isinstance(key, tuple) for key in value))


def unit_of(scalar: Any, of: Mapping[str, str]) -> str:
    """Return the unit of a scalar; ``of``: those of the variables that move joints, by name."""
    if not of_variables(scalar):
        return "m"
    return common(of.get(name, "") for name in ((scalar,) if isinstance(scalar, str) else scalar))


@dataclass(frozen=True)
class Sum(Kind):
    """A variable, or the sum of some by their factors, which are the parameters ``factors.<variable>``.

    ``alone``: what a single variable may be: "variables" for any, "dynamic", or "" for none. ``prefix``: stands for
    "factors" where an element has two sums.
    """

    alone: str = "variables"
    prefix: str = "factors"

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
        return {} if isinstance(value, str) else {f"{self.prefix}.{n}": f for n, f in value.items()}

    def with_number(self, field: str, value: Factors, parameter: str, number: float) -> Any:
        return {**value, parameter.removeprefix(f"{self.prefix}."): number}

    def show(self, value: str | Factors) -> str:
        if isinstance(value, str):
            return value
        plain = {1.0: "", -1.0: "-"}
        terms = [plain.get(factor, f"{factor:g} ") + name for name, factor in value.items()]
        return " + ".join(terms).replace("+ -", "- ")


@dataclass(frozen=True)
class Path(Kind):
    """The frames of a path: two or more, each different from the one before it; or a sum of paths by their factors.

    Those between the ends are via-points: pulleys of no radius, eyelets, sheaths of a tendon. The factors of a sum are
    the parameters ``factors.1``, ``factors.2`` ... in the order given. ``prefix``: as of a `Sum`.
    """

    prefix: str = "factors"

    def read(self, value: object, what: str) -> tuple[str, ...] | Factors:
        if not isinstance(value, Mapping):
            return self._read_one(value, what)
        if not value:
            raise DescriptionError(f"{what}: the mapping is empty; give at least one path")
        result = Factors()
        for path, given in value.items():
            names = self._read_one(path, what)
            result[names] = as_number(
                given, f"{what}: the factor of the path {self.show(names)}", error=DescriptionError
            )
            if result[names] == 0.0:
                raise DescriptionError(f"{what}: the factor of the path {self.show(names)} is zero; leave it out")
        return result

    def _read_one(self, value: object, what: str) -> tuple[str, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise DescriptionError(
                f"{what}: expected a list of frames, or a mapping of such paths to factors, got {value!r}"
            )
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

    def uses(self, value: tuple[str, ...] | Factors) -> Uses:
        return Uses(frames=tuple(dict.fromkeys(name for path in self.strings(value) for name in path)))

    def acts_on(self, value: tuple[str, ...] | Factors) -> tuple[str, ...]:
        names = tuple(name for path in self.strings(value) for name in path)
        return names if len(names) <= 3 else (names[0], "...", names[-1])

    def movers(self, value: tuple[str, ...] | Factors, context: Context) -> tuple[frozenset[str], str]:
        return frozenset().union(*(context.moving(*path) for path in self.strings(value))), (
            f"moves the frames of the path {self.show(value)} relative to each other, so nothing can change "
            "its length; remove the element or choose other frames"
        )

    def strings(self, value: tuple[str, ...] | Factors) -> tuple[tuple[str, ...], ...]:
        return tuple(value) if isinstance(value, Mapping) else (value,)

    def numbers(self, field: str, value: tuple[str, ...] | Factors) -> dict[str, float]:
        if not isinstance(value, Mapping):
            return {}
        return {f"{self.prefix}.{i}": factor for i, factor in enumerate(value.values(), 1)}

    def with_number(self, field: str, value: Factors, parameter: str, number: float) -> Any:
        return dict(zip(value, {**self.numbers(field, value), parameter: number}.values(), strict=True))

    def show(self, value: tuple[str, ...] | Factors) -> str:
        if isinstance(value, Mapping):
            return " + ".join(f"{factor:g} ({' to '.join(path)})" for path, factor in value.items()).replace(
                "+ -", "- "
            )
        return " to ".join(value)


@dataclass(frozen=True)
class SumOrPath(Kind):
    """A variable, a sum of some, the length of a path, or a sum of such; see `Sum` and `Path`."""

    alone: str = "variables"
    prefix: str = "factors"

    def for_value(self, value: object) -> Kind:
        return Sum(self.alone, self.prefix) if of_variables(value) else Path(self.prefix)

    def read(self, value: object, what: str) -> Any:
        return self.for_value(value).read(value, what)
