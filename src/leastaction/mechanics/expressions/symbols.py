"""What expressions are made of: SymPy symbols that know what they stand for.

The only module besides the compiler of expressions that needs SymPy; it is imported when the first
expression is written. Users make symbols with the functions of `leastaction.mechanics.expressions.terms`.
"""

from __future__ import annotations

from typing import Any

import sympy

AXES = "xyz"


class MechanismSymbol(sympy.Symbol):  # type: ignore[misc]
    """A real symbol that stands for something of a mechanism; equal to any other of the same meaning.

    ``role``: ``"point"``, ``"direction"``, ``"variable"``, ``"input"``, ``"parameter"`` or ``"time"``. ``of``: what of
    that kind: ``(frame, axis)`` with the world's axis 0, 1, 2; ``(frame, vector, axis)`` with the vector in the frame's
    axes; ``(name,)``; ``(name,)``; ``(name, value)``; ``()``.
    """

    __slots__ = ("of", "role")

    role: str
    of: tuple[Any, ...]

    def __new__(cls, role: str, *of: Any) -> MechanismSymbol:
        """Make the symbol of a role and what it is of."""
        # The text is what SymPy compares and sorts by, so it must tell every meaning apart; it reads like
        # the call that makes the symbol.
        if role in ("point", "direction"):
            *what, axis = of
            text = f"{role}({', '.join(map(_shown, what))}).{AXES[axis]}"
        else:
            text = f"{role}({', '.join(map(_shown, of))})"
        symbol: MechanismSymbol = super().__new__(cls, text, real=True)
        symbol.role = role
        symbol.of = of
        return symbol

    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        return (self.role, *self.of), {}


def _shown(value: Any) -> str:
    for axis, unit in zip(AXES, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), strict=True):
        if value == unit:
            return repr(axis)
    return repr(value)


def sympified(expression: Any) -> Any:
    """Return what SymPy makes of an object; None if it makes nothing of it."""
    try:
        return sympy.sympify(expression)
    except (sympy.SympifyError, TypeError):
        return None


class Coordinate(sympy.Function):  # type: ignore[misc]
    """A scalar of the configuration that a force takes as one coordinate; its value is its argument."""

    nargs = 1
    is_real = True

    def fdiff(self, argindex: int = 1) -> sympy.Expr:  # noqa: ARG002 - SymPy's interface
        """Return the derivative by the argument, 1."""
        return sympy.Integer(1)


class Rate(sympy.Function):  # type: ignore[misc]
    """The rate of a scalar of the configuration in time."""

    nargs = 1
    is_real = True

    @classmethod
    def eval(cls, argument: sympy.Expr) -> sympy.Expr | None:
        """Return the rate of what depends on the time alone; 0 for a number, which does not change."""
        roles = {getattr(symbol, "role", "") for symbol in argument.free_symbols}
        return sympy.diff(argument, MechanismSymbol("time")) if roles <= {"time", "parameter"} else None
