"""Optimal control in continuous time: ``x' = f(x, u, t)``; knows no mechanics.

The counterpart of `leastaction.optimal.discrete`, name by name: a system is a `ContinuousSystem`, a cost a
`ContinuousCost`; `leastaction.optimize` brings them together. Functions of time are
`PiecewisePolynomial`, trajectories `DenseTrajectory`.
"""

from __future__ import annotations

from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost, ContinuousQuadraticCost, RateGradient, RateHessian
from leastaction.optimal.continuous.function_cost import ContinuousFunctionCost, ContinuousGaussNewton
from leastaction.optimal.continuous.function_system import FunctionContinuousSystem, LinearContinuousSystem
from leastaction.optimal.continuous.linear_quadratic import (
    regulate_continuous,
    solve_continuous_linear_quadratic,
    steady_state_regulator,
)
from leastaction.optimal.continuous.projection import ContinuousProjection, ContinuousRollout
from leastaction.optimal.continuous.riccati import ContinuousLinearQuadraticSolution
from leastaction.optimal.continuous.sums import ContinuousCostSum
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory

__all__ = [
    "Accuracy", "ContinuousCost", "ContinuousCostSum", "ContinuousFunctionCost", "ContinuousGaussNewton",
    "ContinuousLinearQuadraticSolution",
    "ContinuousOptimizationResult", "ContinuousProjection", "ContinuousQuadraticCost", "ContinuousRollout",
    "ContinuousSystem", "DenseTrajectory", "FunctionContinuousSystem", "LinearContinuousSystem", "PiecewisePolynomial",
    "RateGradient", "RateHessian", "regulate_continuous", "solve_continuous_linear_quadratic", "steady_state_regulator",
]  # fmt: skip
