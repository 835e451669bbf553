"""Expressions as text, for files: written as they are in Python, read without running anything.

::

    parameter('k', 0.5)*(distance('hook', 'bob') - 1.2)**2/2
    variable('lift') - 0.01*(1 + sin(variable('angle')))

Functions are those of `leastaction.mechanics.expressions.terms` and of the tape; of `point` and `direction` there are
the components ``.x``, ``.y`` and ``.z``, sums, multiples, `dot` and `norm`.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

import sympy
from sympy.printing.str import StrPrinter

from leastaction.errors import DescriptionError, brief
from leastaction.mechanics.expressions import terms
from leastaction.mechanics.expressions.checks import FUNCTIONS, RECIPROCALS
from leastaction.mechanics.expressions.symbols import AXES, Coordinate, Rate

_DOUBLE = 53  # bits of the mantissa
_HIGHEST_POWER = 1000

_CALLS: dict[str, Callable[..., Any]] = {
    "point": terms.point,
    "direction": lambda frame, of: terms.direction(frame, of if isinstance(of, str) else [float(x) for x in of]),
    "distance": terms.distance,
    "variable": terms.variable,
    "speed": terms.speed,
    "time": terms.time,
    "rate": terms.rate,
    "coordinate": terms.coordinate,
    "input": terms.input_,
    "parameter": lambda name, value: terms.parameter(name, float(value)),
    "dot": lambda a, b: a.dot(b),
    "norm": lambda a: sympy.sqrt(sum(component**2 for component in a)),
    "sqrt": sympy.sqrt,
    **{function.__name__: function for function in (*FUNCTIONS, *RECIPROCALS)},
    "abs": sympy.Abs,
}
_CONSTANTS = {"pi": sympy.pi, "E": sympy.E}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Pow: operator.pow,
}


class _Printer(StrPrinter):  # type: ignore[misc]
    """Writes what `expression_of` reads, every number with all its digits."""

    def _print_Float(self, expr: sympy.Float) -> str:
        if expr._prec != _DOUBLE:
            raise DescriptionError(
                f"the number {expr} has {expr._prec} bits and is no double; write sympy.Float({expr})"
            )
        return repr(float(expr))

    def _print_Coordinate(self, expr: Coordinate) -> str:
        return f"coordinate({self._print(expr.args[0])})"

    def _print_Rate(self, expr: Rate) -> str:
        return f"rate({self._print(expr.args[0])})"


def expression_text(expression: Any) -> str:
    """Return an expression as text that `expression_of` reads as the same one, bit by bit.

    Raises `DescriptionError` for one that does not come back as it is, such as one that SymPy was told not to evaluate.
    """
    given = sympy.sympify(expression)
    text = str(_Printer({"order": None}).doprint(given))
    if expression_of(text) != given:
        raise DescriptionError(
            f"the expression {brief(given)} does not come back from text as it is; write it so that SymPy evaluates "
            "it, without numbers of more digits than a double"
        )
    return text


def expression_of(text: str) -> sympy.Expr:
    """Return the expression that a text is.

    Raises `DescriptionError` for what is no formula, and for names and calls other than those above.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError) as error:
        raise DescriptionError(f"{brief(text)!r} is no formula: {error.args[0]}") from None
    try:
        result = _read(tree.body)
    except (TypeError, ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, DescriptionError):
            raise
        raise DescriptionError(f"{brief(text)!r} is no formula: {error}") from None
    if not isinstance(result, sympy.Expr):
        raise DescriptionError(f"{brief(text)!r}: expected a scalar; of a point take .x, .y or .z, or dot and norm")
    return result


def _is_product(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.USub)
    return isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div))


def _is_scalar(value: Any) -> bool:
    return isinstance(value, sympy.Expr) and not getattr(value, "is_Matrix", False)


def _factors(node: ast.expr) -> list[Any]:
    """Return the factors of a product in their order, of what it is divided by the inverse, of a sign -1."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return [sympy.Integer(-1), *_factors(node.operand)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div)):
        first, last = _factors(node.left), _read(node.right)
        if isinstance(node.op, ast.Div) and not _is_scalar(last):
            raise TypeError("only a scalar divides")
        return [*first, last if isinstance(node.op, ast.Mult) else 1 / last]
    return [_read(node)]


def _read(node: ast.expr) -> Any:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float, str):
        return node.value if isinstance(node.value, str) else sympy.sympify(node.value)
    if isinstance(node, ast.Name) and node.id in _CONSTANTS:
        return _CONSTANTS[node.id]
    if isinstance(node, ast.Tuple):
        return [_read(part) for part in node.elts]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd):
        return _read(node.operand)
    if _is_product(node):
        # All at once: two by two, SymPy takes the number of ``-(x + 1)*y`` into the sum.
        factors = _factors(node)
        return sympy.Mul(*factors) if all(map(_is_scalar, factors)) else reduce(operator.mul, factors)
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        first, second = _read(node.left), _read(node.right)
        if isinstance(node.op, ast.Pow) and getattr(second, "is_number", False) and abs(second) > _HIGHEST_POWER:
            raise DescriptionError(f"the exponent {brief(second)} is too large; expected {_HIGHEST_POWER} at most")
        return _BINARY[type(node.op)](first, second)
    if isinstance(node, ast.Attribute) and node.attr in AXES:
        return _read(node.value)[AXES.index(node.attr)]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _CALLS and not node.keywords:
        return _CALLS[node.func.id](*map(_read, node.args))
    raise DescriptionError(
        f"{brief(ast.unparse(node))!r}: expected numbers, + - * / **, pi, and {', '.join(sorted(_CALLS))}; a variable "
        "is variable('its name')"
    )
