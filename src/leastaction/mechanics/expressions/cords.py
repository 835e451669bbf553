"""Cords that users write as expressions: what an expression of distances pulls along them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from leastaction.mechanics.expressions.symbols import MechanismSymbol
from leastaction.numerics.arrays import Array


@dataclass(frozen=True)
class ExpressionCord:
    """An expression that depends on places by distances of pairs of frames only, all with the same slope.

    ``pieces``: the pairs. ``symbols``: of their distances, then of variables, parameters and the time. ``slope``: of
    the expression by each distance.
    """

    pieces: tuple[tuple[str, str], ...]
    symbols: tuple[Any, ...]
    slope: Any

    def by_lengths(self, lengths: Array, values: Mapping[str, Any]) -> Array:
        """Return the slope for lengths (pieces, N) of the pieces, variables and parameters by name, the time by ""."""
        others = [values["".join(symbol.of[:1])] for symbol in self.symbols[len(self.pieces) :]]
        found = sympy.lambdify(self.symbols, self.slope, "numpy")(*lengths, *others)
        return np.broadcast_to(np.asarray(found, dtype=np.float64), lengths.shape[1:]).copy()


def cord_of(expression: Any) -> ExpressionCord | None:
    """Return an expression as a cord; None if it is none."""
    pieces: dict[tuple[str, str], Any] = {}
    known: dict[Any, Any] = {}
    for root in expression.atoms(sympy.Pow):
        frames = sorted({symbol.of[0] for symbol in root.free_symbols if getattr(symbol, "role", "") == "point"})
        if len(frames) != 2 or abs(root.exp) != sympy.Rational(1, 2):
            continue
        if sympy.expand(root.base - _squared(*frames)) == 0:
            symbol = pieces.setdefault((frames[0], frames[1]), sympy.Dummy(positive=True))
            known[root] = symbol ** (2 * root.exp)
    rest = _without_squares(expression.xreplace(known), pieces)
    others = sorted((each for each in rest.free_symbols if isinstance(each, MechanismSymbol)), key=str)
    if not pieces or any(each.role not in ("variable", "parameter", "time") for each in others):
        return None
    slopes = [sympy.diff(rest, symbol) for symbol in pieces.values()]
    if any(sympy.simplify(slope - slopes[0]) != 0 for slope in slopes[1:]):
        return None
    return ExpressionCord(tuple(pieces), (*pieces.values(), *others), slopes[0])


def _without_squares(expression: Any, pieces: dict[tuple[str, str], Any]) -> Any:
    """Return an expression with the squared distance of two frames, which has no root, as the square of a symbol."""
    frames = sorted({each.of[0] for each in expression.free_symbols if getattr(each, "role", "") == "point"})
    if len(frames) != 2:
        return expression
    expanded = sympy.expand(expression)
    factor = expanded.coeff(MechanismSymbol("point", frames[0], 0), 2)
    rest = sympy.expand(expanded - factor * _squared(*frames))
    if any(getattr(each, "role", "") == "point" for each in rest.free_symbols | factor.free_symbols):
        return expression
    return rest + factor * pieces.setdefault((frames[0], frames[1]), sympy.Dummy(positive=True)) ** 2


def _squared(frame1: str, frame2: str) -> Any:
    return sum((MechanismSymbol("point", frame1, i) - MechanismSymbol("point", frame2, i)) ** 2 for i in range(3))
