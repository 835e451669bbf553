"""Expressions of the user's own over coordinates, compiled to tapes that differentiate themselves."""

from __future__ import annotations

from leastaction.mechanics.expressions.terms import (
    coordinate,
    direction,
    distance,
    input_,
    parameter,
    point,
    rate,
    speed,
    time,
    unit_vector,
    variable,
)

__all__ = [
    "coordinate", "direction", "distance", "input_", "parameter", "point", "rate", "speed", "time", "unit_vector",
    "variable",
]  # fmt: skip
