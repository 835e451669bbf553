"""Costs of a motion, and what a cost of one's own is made of."""

from __future__ import annotations

from leastaction.optimal import (
    ContinuousCost,
    ContinuousCostSum,
    ContinuousFunctionCost,
    ContinuousGaussNewton,
    ContinuousQuadraticCost,
    Cost,
    CostGradient,
    CostHessian,
    CostSum,
    FunctionCost,
    GaussNewton,
    QuadraticCost,
    RateCost,
    RateGradient,
    RateHessian,
)
from leastaction.systems import (
    ContinuousOrientationCost,
    ContinuousPlaceCost,
    DistanceCost,
    OrientationCost,
    PlaceCost,
    SmoothCost,
    tracking,
)

__all__ = [  # noqa: RUF022 - by topics
    # In both kinds of time
    "tracking",
    # In discrete time
    "CostSum", "DistanceCost", "FunctionCost", "GaussNewton", "OrientationCost", "PlaceCost", "QuadraticCost",
    "RateCost", "SmoothCost",
    # In continuous time
    "ContinuousCostSum", "ContinuousFunctionCost", "ContinuousGaussNewton", "ContinuousOrientationCost",
    "ContinuousPlaceCost", "ContinuousQuadraticCost",
    # Of one's own
    "ContinuousCost", "Cost", "CostGradient", "CostHessian", "RateGradient", "RateHessian",
]  # fmt: skip
