"""What an expression may hold: real, finite, smooth, and made of what the core knows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy

from leastaction.errors import DescriptionError, brief
from leastaction.mechanics.expressions.symbols import Coordinate, MechanismSymbol, Rate, sympified

# The operation of each function; those in the second table are one over it.
FUNCTIONS: dict[Any, str] = {
    sympy.exp: "exp",
    sympy.log: "log",
    sympy.sin: "sin",
    sympy.cos: "cos",
    sympy.tan: "tan",
    sympy.asin: "asin",
    sympy.acos: "acos",
    sympy.atan: "atan",
    sympy.atan2: "atan2",
    sympy.sinh: "sinh",
    sympy.cosh: "cosh",
    sympy.tanh: "tanh",
    sympy.asinh: "asinh",
    sympy.acosh: "acosh",
    sympy.atanh: "atanh",
    sympy.Abs: "abs",
}
RECIPROCALS: dict[Any, str] = {
    sympy.sec: "cos",
    sympy.csc: "sin",
    sympy.cot: "tan",
    sympy.sech: "cosh",
    sympy.csch: "sinh",
    sympy.coth: "tanh",
}
NOT_SMOOTH = (
    sympy.Piecewise,
    sympy.Min,
    sympy.Max,
    sympy.Heaviside,
    sympy.sign,
    sympy.floor,
    sympy.ceiling,
    sympy.Mod,
    sympy.DiracDelta,
)


def check_expression(expression: Any, what: str, *, allowed: Sequence[sympy.Symbol] | None = None) -> sympy.Expr:
    """Return an expression that a tape can hold, or raise an error that names the part that it cannot.

    ``what``: what it belongs to, for messages. ``allowed``: the symbols that may occur. By default every
    `MechanismSymbol`. Raises `DescriptionError` for text, matrices and truth values; plain symbols; numbers that are
    infinite or not real; functions that are unknown or have a jump or a kink.
    """
    if isinstance(expression, str):
        raise DescriptionError(
            f"{what}: got the text {expression!r}, expected an expression; build it with point(...), "
            "distance(...), variable(...) and the functions of sympy"
        )
    scalar = sympified(expression)
    if isinstance(scalar, sympy.MatrixBase):
        raise DescriptionError(
            f"{what}: got a matrix of shape {scalar.shape}, expected a scalar; take an entry, as in "
            "point('frame')[0], or a product, as in a.dot(b)"
        )
    if not isinstance(scalar, sympy.Expr):
        raise DescriptionError(
            f"{what}: expected a scalar expression of real numbers, got {expression!r} ({type(expression).__name__})"
        )
    for part in sympy.preorder_traversal(scalar):
        _check_part(part, what, allowed)
    return scalar


def _check_part(part: sympy.Basic, what: str, allowed: Sequence[sympy.Symbol] | None) -> None:
    if isinstance(part, sympy.Symbol):
        fits = isinstance(part, MechanismSymbol) if allowed is None else part in allowed
        if fits:
            return
        if isinstance(part, MechanismSymbol):
            raise DescriptionError(f"{what}: {part} is not an argument of this function")
        hint = (
            f"write variable({part.name!r}), input_({part.name!r}) or "
            f"parameter({part.name!r}, value), or substitute a number for it"
            if allowed is None
            else f"its arguments are {', '.join(map(str, allowed)) or 'none'}"
        )
        raise DescriptionError(f"{what}: the symbol {part} stands for nothing; {hint}")
    if part in (sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
        raise DescriptionError(f"{what}: found {part}, expected finite numbers; look for a division by zero")
    if part is sympy.I or (part.is_number and part.is_extended_real is False):
        raise DescriptionError(f"{what}: found {brief(part)}, which is not real; expected real numbers")
    if isinstance(part, NOT_SMOOTH):
        raise DescriptionError(
            f"{what}: {brief(part)} has a jump or a kink, where derivatives do not exist; use a smooth function "
            "instead, such as tanh(x/eps) for a sign or eps*log(1 + exp(x/eps)) for max(x, 0)"
        )
    if isinstance(part, (sympy.Add, sympy.Mul, sympy.Pow, sympy.Number, sympy.NumberSymbol)):
        return
    if type(part) in FUNCTIONS or type(part) in RECIPROCALS:
        return
    if isinstance(part, (Rate, Coordinate)) and allowed is None:
        return
    known = ", ".join(sorted(str(function) for function in (*FUNCTIONS, *RECIPROCALS)))
    raise DescriptionError(
        f"{what}: {brief(part)} ({type(part).__name__}) cannot be compiled; work it out first, as with .doit(), "
        f"or write it with sums, products, powers, sqrt and {known}"
    )
