"""Trajectory optimisation of discrete systems ``x+ = f(x, u, k)``; knows no mechanics.

A system is a `DiscreteSystem`, a cost a `Cost`; `optimize` brings them together.
"""

from __future__ import annotations

from leastaction.optimal.checks import DerivativeReport, check_derivatives
from leastaction.optimal.costs import Cost, CostGradient, CostHessian, QuadraticCost
from leastaction.optimal.discrete.linear_quadratic import (
    LinearQuadraticSolution,
    adjoint,
    regulate,
    solve_linear_quadratic,
    sweep_forward,
)
from leastaction.optimal.discrete.projection import Projection
from leastaction.optimal.function_system import FunctionSystem, LinearSystem
from leastaction.optimal.optimize import optimize
from leastaction.optimal.protocol import DiscreteSystem, Linearization, Rollout
from leastaction.optimal.result import (
    IterationRecord,
    OptimizationHistory,
    OptimizationResult,
    Settings,
    Status,
)
from leastaction.optimal.table import IterationTable

__all__ = [
    "Cost",
    "CostGradient",
    "CostHessian",
    "DerivativeReport",
    "DiscreteSystem",
    "FunctionSystem",
    "IterationRecord",
    "IterationTable",
    "LinearQuadraticSolution",
    "LinearSystem",
    "Linearization",
    "OptimizationHistory",
    "OptimizationResult",
    "Projection",
    "QuadraticCost",
    "Rollout",
    "Settings",
    "Status",
    "adjoint",
    "check_derivatives",
    "optimize",
    "regulate",
    "solve_linear_quadratic",
    "sweep_forward",
]
