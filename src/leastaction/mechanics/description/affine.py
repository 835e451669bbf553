"""Linear expressions of configuration variables: the coordinate by which a joint moves.

A joint coordinate is ``s = sum f_k q_k + s0``. Most are one variable, factor 1 and offset 0; the rest are
gears, mimic joints and parallel linkages::

    rz("theta")                                     # theta itself
    rz(2.0 * var("theta") + 0.3)                    # a gear
    rz({"theta": 2.0, "phi": -1.0}, offset=0.3)     # the same idea without arithmetic
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.numerics.arrays import as_number
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public

_NUMBERS = (int, float, np.integer, np.floating)


@public
@dataclass(frozen=True)
class Affine:
    """A linear expression of variables and a constant; made by `var` and arithmetic on it.

    Adding, subtracting and scaling by numbers give new expressions. A variable whose factors cancel is no
    longer part of it.

    Attributes
    ----------
    terms : tuple of (str, float)
        Variables and their factors, none of them zero, every variable once.
    offset : float
        The constant (m or rad).
    """

    terms: tuple[tuple[str, float], ...] = ()
    offset: float = 0.0

    # Without this, np.float64(2) * var("a") would try to make an array of the expression.
    __array_ufunc__ = None

    def __post_init__(self) -> None:
        for name, factor in self.terms:
            as_number(factor, f"the factor of {name!r}", error=DescriptionError)
        as_number(self.offset, "the constant of a linear expression", error=DescriptionError)

    @property
    def names(self) -> tuple[str, ...]:
        """The variables, in the order that they were met."""
        return tuple(name for name, _ in self.terms)

    @property
    def plain(self) -> bool:
        """Whether it is one variable and nothing else."""
        return len(self.terms) == 1 and self.terms[0][1] == 1.0 and self.offset == 0.0

    def value(self, values: Mapping[str, float]) -> float:
        """Return the value where the variables have the given values."""
        return sum((factor * values[name] for name, factor in self.terms), self.offset)

    def __add__(self, other: Affine | float) -> Affine:
        if isinstance(other, Affine):
            factors = dict(self.terms)
            for name, factor in other.terms:
                factors[name] = factors.get(name, 0.0) + factor
            terms = tuple((name, factor) for name, factor in factors.items() if factor != 0.0)
            return Affine(terms, self.offset + other.offset)
        if not _is_number(other):
            return NotImplemented
        return Affine(self.terms, self.offset + _number(other))

    __radd__ = __add__

    def __neg__(self) -> Affine:
        return self * -1.0

    def __pos__(self) -> Affine:
        return self

    def __sub__(self, other: Affine | float) -> Affine:
        if isinstance(other, Affine):
            return self + -other
        return self + -_number(other) if _is_number(other) else NotImplemented

    def __rsub__(self, other: float) -> Affine:
        return -self + other

    def __mul__(self, other: Affine | float) -> Affine:
        if isinstance(other, Affine):
            raise DescriptionError(
                f"({self}) * ({other}): a joint moves by a linear expression, and a product of variables is "
                "not linear; use a constraint or an expression element for it"
            )
        if not _is_number(other):
            return NotImplemented
        number = _number(other)
        terms = tuple((name, factor * number) for name, factor in self.terms)
        return Affine(tuple(t for t in terms if t[1] != 0.0), self.offset * number)

    __rmul__ = __mul__

    def __truediv__(self, other: float) -> Affine:
        if not _is_number(other):
            return NotImplemented
        number = _number(other)
        if number == 0.0:
            raise DescriptionError(f"({self}) / {other}: expected a divisor that is not zero")
        terms = tuple((name, factor / number) for name, factor in self.terms)
        return Affine(tuple(t for t in terms if t[1] != 0.0), self.offset / number)

    def __str__(self) -> str:
        """Return it as a formula, such as ``2 theta - phi + 0.3``."""
        text = ""
        for name, factor in self.terms:
            size = "" if abs(factor) == 1.0 else f"{abs(factor):.6g} "
            sign = ("-" if factor < 0.0 else "") if not text else (" - " if factor < 0.0 else " + ")
            text += f"{sign}{size}{name}"
        if not text:
            return f"{self.offset:.6g}"
        if self.offset != 0.0:
            text += f" {'-' if self.offset < 0.0 else '+'} {abs(self.offset):.6g}"
        return text


CoordinateLike: TypeAlias = float | str | Affine | Mapping[str, float]
"""How far a joint moves: a number, a variable's name, or a linear expression of variables."""


@public
def var(name: str) -> Affine:
    """Return a variable as an expression that can be added, subtracted and scaled.

    Parameters
    ----------
    name : str
        The configuration variable.
    """
    return Affine(((check_name(name, "var"), 1.0),))


def as_affine(coordinate: object, what: str, offset: float = 0.0) -> Affine:
    """Return the coordinate of a joint as a linear expression.

    ``what``: the joint, for messages. ``offset``: added to it (m or rad). Raises `DescriptionError` for anything else,
    a number that is not finite, a factor of zero or a mapping of nothing.
    """
    extra = as_number(offset, f"{what}: offset", error=DescriptionError)
    if isinstance(coordinate, Affine):
        return coordinate + extra
    if isinstance(coordinate, str):
        return Affine(((check_name(coordinate, f"the variable of {what}"), 1.0),), extra)
    if isinstance(coordinate, Mapping):
        if not coordinate:
            raise DescriptionError(
                f"{what}: the coordinate is an empty mapping; give the factor of each variable, as in "
                "{'theta': 2.0}, or a number"
            )
        terms = []
        for name, factor in coordinate.items():
            check_name(name, f"a variable of {what}")
            number = as_number(factor, f"{what}: the factor of {name!r}", error=DescriptionError)
            if number == 0.0:
                raise DescriptionError(f"{what}: the factor of {name!r} is 0; leave the variable out")
            terms.append((name, number))
        return Affine(tuple(terms), extra)
    number = as_number(
        coordinate,
        f"{what}: the coordinate, a number, a variable's name or a linear expression",
        error=DescriptionError,
    )
    return Affine((), number + extra)


def _is_number(value: object) -> bool:
    return isinstance(value, _NUMBERS) and not isinstance(value, bool)


def _number(value: object) -> float:
    return as_number(value, "a linear expression of variables", error=DescriptionError)
