"""The cost along descent directions, beside the models that these are the minima of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_choice, require_instance
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem, given_start
from leastaction.optimal.line_search import Trial
from leastaction.optimal.loop import Problem
from leastaction.optimal.options import Method, Options
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.system import check_system

_LENGTHS = np.linspace(0.0, 1.5, 31)  # step lengths, up to half beyond the minimum of the model


@public
@dataclass(frozen=True)
class CostAlong(Frozen):
    """The cost of projected trajectories along a descent direction. Frozen, so any number of threads may share it.

    Attributes
    ----------
    method : str
        Whose model the direction is the minimum of.
    gamma : ndarray (n,)
        Step lengths; 1 is the minimum of the model.
    cost : ndarray (n,)
        Cost of the projection of ``xi + gamma dxi``; NaN where the system cannot follow.
    start : float
        Cost of the trajectory xi itself.
    slope : float
        ``Dg . dxi``, negative.
    """

    method: str
    gamma: Array
    cost: Array
    start: float
    slope: float

    @property
    def linear(self) -> Array:
        """The linear model (n,): ``g + gamma Dg . dxi``."""
        return np.asarray(self.start + self.gamma * self.slope)

    @property
    def quadratic(self) -> Array:
        """The quadratic model (n,), whose minimum is at ``gamma = 1``: half of what the linear model promises."""
        return np.asarray(self.start + self.slope * (self.gamma - 0.5 * self.gamma**2))


@public
def cost_along(
    system: DiscreteSystem | ContinuousSystem,
    cost: Cost | ContinuousCost,
    initial: Any,
    *,
    method: str = "newton",
    gamma: ArrayLike | None = None,
    horizon: tuple[float, float] | None = None,
) -> CostAlong:
    """Return the cost along the descent direction of a trajectory.

    Where derivatives are right the cost leaves along its linear model, and with Newton's method along its quadratic
    model; how far it stays with them says which steps can be taken.

    Parameters
    ----------
    system, cost
        As of `optimize`, without limits.
    initial : (x, u), OptimizationResult or DenseTrajectory
        The trajectory, as of `optimize`: not one at a minimum, where there is no direction.
    method : {"newton", "quasi-newton", "steepest"}
        The model.
    gamma : array_like (n,), optional
        Step lengths; 0 to 1.5 if left out.
    horizon : (t0, tf), optional
        Times (s); needed with ``(x, u)`` of a continuous system.

    Returns
    -------
    CostAlong

    Raises
    ------
    ArgumentError
        As of `optimize`, and where the model has no minimum.
    """
    check_system(system, (DiscreteSystem, ContinuousSystem), ("nx", "nu"))
    as_choice(method, "method", [name for name in get_args(Method) if name != "auto"])
    if method == "newton" and not system.has_curvature:
        raise ArgumentError(
            f"method: got 'newton', but {type(system).__name__} has no second derivative; use 'quasi-newton'"
        )
    lengths = _LENGTHS if gamma is None else as_array(gamma, "gamma", (None,))
    settings = Options(method=method, max_iterations=1, tolerance=0.0, absolute_tolerance=0.0)
    made: Problem[Any, Any, Any]
    if isinstance(system, DiscreteSystem):
        require_instance(cost, "cost", Cost, "such as a QuadraticCost")
        made = DiscreteProblem(system, cast(Cost, cost).over(system.N), settings)
        pair = (initial.x, initial.u) if isinstance(initial, OptimizationResult) else initial
        given: Any = given_start(system, pair)
    else:
        require_instance(cost, "cost", ContinuousCost, "such as a ContinuousQuadraticCost")
        made = ContinuousProblem(system, cast(ContinuousCost, cost), settings, Accuracy(), horizon)
        given = initial.dense if isinstance(initial, ContinuousOptimizationResult) else initial
    problem: Any = made  # whose models and directions go with it, whatever the kind of time
    problem.start(given)
    model = problem.models.minimise(method, 1.0 if method == "newton" else 0.0)
    if not model.definite:
        raise ArgumentError(
            f"method: got {method!r}, whose model has no minimum along this trajectory: {model.message}. "
            "Use 'quasi-newton'"
        )
    direction = problem.steps.direction(method, model, 1.0 if method == "newton" else 0.0)
    trials = [problem.steps.simulate(direction, float(length), np.inf) for length in lengths]
    costs = np.array([trial.cost if isinstance(trial, Trial) else np.nan for trial in trials])
    return CostAlong(method, lengths, costs, float(problem.here.value), float(direction.slope))
