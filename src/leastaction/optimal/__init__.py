"""Trajectory optimisation of systems ``x+ = f(x, u, k)`` and ``x' = f(x, u, t)``; knows no mechanics.

A system is a `DiscreteSystem` or a `ContinuousSystem`, a cost a `Cost` or a `ContinuousCost`; `optimize`
brings them together.
"""

from __future__ import annotations

from leastaction.optimal.checks import DerivativeReport, check_derivatives
from leastaction.optimal.continuous import (
    Accuracy,
    ContinuousCost,
    ContinuousLinearQuadraticSolution,
    ContinuousOptimizationResult,
    ContinuousProjection,
    ContinuousQuadraticCost,
    ContinuousRollout,
    ContinuousSystem,
    DenseTrajectory,
    FunctionContinuousSystem,
    LinearContinuousSystem,
    PiecewisePolynomial,
    RateGradient,
    RateHessian,
    regulate_continuous,
    solve_continuous_linear_quadratic,
    steady_state_regulator,
)
from leastaction.optimal.discrete.controllability import Controllability, ControllabilityWindow, controllability
from leastaction.optimal.discrete.cost import Cost, CostGradient, QuadraticCost, WindowCost
from leastaction.optimal.discrete.function_system import FunctionSystem, LinearSystem
from leastaction.optimal.discrete.hessians import CostHessian, HessianPart, ModelHessian
from leastaction.optimal.discrete.linear_quadratic import (
    LinearQuadraticSolution,
    adjoint,
    regulate,
    solve_linear_quadratic,
    sweep_forward,
)
from leastaction.optimal.discrete.projection import Projection
from leastaction.optimal.discrete.system import DiscreteSystem, Rollout, WindowSystem
from leastaction.optimal.limit_report import LimitReport, LimitState
from leastaction.optimal.limits.limit import Bound, Equal, Limit, Within
from leastaction.optimal.optimize import optimize, optimize_continuous
from leastaction.optimal.optimizer import Optimizer
from leastaction.optimal.options import Options
from leastaction.optimal.quantity import Entries, FunctionQuantity, Quantity
from leastaction.optimal.result import IterationRecord, OptimizationHistory, OptimizationResult, Status
from leastaction.optimal.starts import (
    HelpedCost,
    StageRecord,
    StageTable,
    StartResult,
    StartStatus,
    coarse_to_fine,
    continuation,
    receding_horizon,
    resample,
)
from leastaction.optimal.system import Linearization
from leastaction.optimal.table import IterationTable
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.optimal.unknowns.unknown import FinalTime, Parameter, Unknown

__all__ = [
    "Accuracy", "Bound", "ContinuousCost", "ContinuousLinearQuadraticSolution", "ContinuousOptimizationResult",
    "ContinuousProjection", "ContinuousQuadraticCost", "ContinuousRollout", "ContinuousSystem", "Controllability",
    "ControllabilityWindow", "Cost", "CostGradient", "CostHessian", "DenseTrajectory", "DerivativeReport",
    "DiscreteSystem", "Entries", "Equal", "FinalTime", "FunctionContinuousSystem", "FunctionQuantity",
    "FunctionSystem", "HelpedCost", "HessianPart", "IterationRecord", "IterationTable", "Limit", "LimitReport",
    "LimitState", "LinearContinuousSystem", "LinearQuadraticSolution", "LinearSystem", "Linearization",
    "ModelHessian", "OptimizationHistory", "OptimizationResult", "Optimizer", "Options", "Parameter", "Periodic",
    "PiecewisePolynomial", "Projection", "QuadraticCost", "Quantity", "RateGradient", "RateHessian", "Rollout",
    "StageRecord", "StageTable", "StartResult", "StartStatus", "Status", "Unknown", "WindowCost", "WindowSystem",
    "Within", "adjoint", "check_derivatives", "coarse_to_fine", "continuation", "controllability", "optimize",
    "optimize_continuous", "receding_horizon", "regulate", "regulate_continuous", "resample",
    "solve_continuous_linear_quadratic", "solve_linear_quadratic", "steady_state_regulator", "sweep_forward",
]  # fmt: skip
