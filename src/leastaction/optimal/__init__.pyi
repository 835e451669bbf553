from leastaction.optimal.checks import DerivativeReport, check_derivatives
from leastaction.optimal.checks.descent import CostAlong, cost_along
from leastaction.optimal.continuous import (
    Accuracy,
    ContinuousCost,
    ContinuousCostSum,
    ContinuousFunctionCost,
    ContinuousGaussNewton,
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
from leastaction.optimal.discrete.cost import AddedCost, Cost, CostGradient, QuadraticCost, WindowCost
from leastaction.optimal.discrete.function_cost import FunctionCost, GaussNewton
from leastaction.optimal.discrete.function_system import FunctionSystem, LinearSystem
from leastaction.optimal.discrete.hessians import CostHessian, HessianPart, ModelHessian
from leastaction.optimal.discrete.linear_quadratic import (
    LinearQuadraticSolution,
    adjoint,
    regulate,
    solve_linear_quadratic,
    sweep_forward,
)
from leastaction.optimal.discrete.projection import ProjectionOperator, linearize_along_curve
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.sums import CostSum
from leastaction.optimal.discrete.system import DiscreteSystem, WindowSystem
from leastaction.optimal.limit_report import LimitReport, LimitState
from leastaction.optimal.limits.limit import Bound, Equal, Limit, Within
from leastaction.optimal.limits.priced import PricedLimit, PricedLimits
from leastaction.optimal.loop import Callback
from leastaction.optimal.optimization import optimize, optimize_continuous
from leastaction.optimal.optimizer import Optimizer
from leastaction.optimal.options import Method, Options, Shooting
from leastaction.optimal.quantity import Entries, FunctionQuantity, Quantity
from leastaction.optimal.remembered.rates import RateCost
from leastaction.optimal.result import IterationRecord, OptimizationHistory, OptimizationResult, Status
from leastaction.optimal.space import ProductSpace, Rotations, StateSpace, Vectors
from leastaction.optimal.starts.coarse_to_fine import coarse_to_fine, resample
from leastaction.optimal.starts.continuation import continuation
from leastaction.optimal.starts.help import HelpedCost
from leastaction.optimal.starts.receding_horizon import receding_horizon
from leastaction.optimal.starts.stages import StageRecord, StageTable, StartResult, StartStatus
from leastaction.optimal.system import Linearization
from leastaction.optimal.table import IterationTable
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.optimal.unknowns.unknown import FinalTime, Parameter, Unknown

__all__ = [
    "Accuracy", "AddedCost", "Bound", "Callback", "ContinuousCost", "ContinuousCostSum",
    "ContinuousFunctionCost", "ContinuousGaussNewton",
    "ContinuousLinearQuadraticSolution", "ContinuousOptimizationResult", "ContinuousProjection",
    "ContinuousQuadraticCost", "ContinuousRollout",
    "ContinuousSystem", "Controllability", "ControllabilityWindow", "Cost", "CostAlong", "CostGradient", "CostHessian",
    "CostSum", "DenseTrajectory", "DerivativeReport", "DiscreteSystem", "Entries", "Equal", "FinalTime",
    "FunctionContinuousSystem", "FunctionCost",
    "FunctionQuantity", "FunctionSystem", "GaussNewton", "HelpedCost", "HessianPart",
    "IterationRecord", "IterationTable", "Limit", "LimitReport", "LimitState", "LinearContinuousSystem",
    "LinearQuadraticSolution", "LinearSystem", "Linearization", "Method", "ModelHessian", "OptimizationHistory",
    "OptimizationResult", "Optimizer", "Options", "Parameter", "Periodic", "PiecewisePolynomial", "PricedLimit",
    "PricedLimits", "ProductSpace", "ProjectionOperator", "QuadraticCost", "Quantity", "RateCost", "RateGradient",
    "RateHessian", "Rollout", "Rotations", "Shooting", "StageRecord", "StageTable", "StartResult", "StartStatus",
    "StateSpace", "Status", "Unknown", "Vectors", "WindowCost", "WindowSystem", "Within", "adjoint",
    "check_derivatives", "coarse_to_fine", "continuation", "controllability", "cost_along", "linearize_along_curve",
    "optimize", "optimize_continuous", "receding_horizon", "regulate", "regulate_continuous", "resample",
    "solve_continuous_linear_quadratic", "solve_linear_quadratic", "steady_state_regulator", "sweep_forward",
]  # fmt: skip
