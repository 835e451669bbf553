"""Formulas in the time t, as text: read without running anything."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, brief
from leastaction.numerics.arrays import Array

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "sinh", "cosh")},
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "radians": np.radians,
    "smooth": lambda t, start, end: _smooth(np.clip((t - start) / (end - start), 0.0, 1.0)),
}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def _smooth(s: Array) -> Array:
    """Return how a motion from 0 to 1 at rest at both ends, with no jump of acceleration, has got on at its part s."""
    return s**3 * (10.0 + s * (6.0 * s - 15.0))


def formula(text: str) -> Callable[[Any], Any]:
    """Return a formula in t as a function of times of any shape.

    Numbers, + - * / **, pi, t and functions: sin, cos, ... and ``smooth(t, start, end)``, which goes from 0 to 1.

    Raises `ArgumentError`: what is no formula.
    """
    try:
        body = ast.parse(text.strip(), mode="eval").body
        # Once, so that what is wrong with it is said now.
        _value(body, np.zeros(1))
    except (SyntaxError, ValueError, TypeError, RecursionError, ArithmeticError) as error:
        if isinstance(error, ArgumentError):
            raise
        raise ArgumentError(f"{brief(text)!r} is no formula in t: {error.args[0]}") from None

    def function(t: Any) -> Any:
        times = np.asarray(t, dtype=np.float64)
        with np.errstate(all="ignore"):
            values = np.broadcast_to(np.asarray(_value(body, times), dtype=np.float64), times.shape)
        if not np.all(np.isfinite(values)):
            bad = float(np.atleast_1d(times)[~np.isfinite(np.atleast_1d(values))][0])
            raise ArgumentError(f"the formula {brief(text)!r} has no value at t = {bad:g} s")
        return float(values) if values.ndim == 0 else values

    return function


def _value(node: ast.expr | ast.keyword, t: Array) -> Any:
    with np.errstate(all="ignore"):
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return np.float64(node.value)  # type: ignore[arg-type]
        if isinstance(node, ast.Name) and node.id in ("t", "pi"):
            return t if node.id == "t" else np.pi
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            return -_value(node.operand, t) if isinstance(node.op, ast.USub) else _value(node.operand, t)
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            return _BINARY[type(node.op)](_value(node.left, t), _value(node.right, t))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
            arguments: list[ast.expr | ast.keyword] = [*node.args, *node.keywords]
            return _FUNCTIONS[node.func.id](*(_value(part, t) for part in arguments))
    raise ArgumentError(
        f"{brief(ast.unparse(node))!r}: expected numbers, t, pi, + - * / ** and {', '.join(sorted(_FUNCTIONS))}"
    )
