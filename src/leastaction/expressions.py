"""Expressions over coordinates, rates, inputs and places of points, which differentiate themselves.

`ExpressionPotential`, `ExpressionForce` and `ExpressionConstraint` (`leastaction.elements`) are made of them.
"""

from __future__ import annotations

from leastaction.mechanics.expressions import (
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
