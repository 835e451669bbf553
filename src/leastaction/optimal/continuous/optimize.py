"""Trajectory optimisation in continuous time by the projection operator (dissertation 6.4)."""

from __future__ import annotations

from typing import Literal

from leastaction.errors import ArgumentError
from leastaction.optimal.continuous.costs import ContinuousCost
from leastaction.optimal.continuous.integrate import Accuracy
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.protocol import ContinuousSystem
from leastaction.optimal.continuous.result import ContinuousOptimizationResult
from leastaction.optimal.continuous.signals import SignalLike
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.loop import Callback, Loop
from leastaction.optimal.settings import check_settings

__all__ = ["optimize_continuous"]


def optimize_continuous(
    system: ContinuousSystem,
    cost: ContinuousCost,
    *,
    initial: DenseTrajectory | tuple[SignalLike, SignalLike] | None = None,
    horizon: tuple[float, float] | None = None,
    resume: ContinuousOptimizationResult | None = None,
    method: Literal["auto", "steepest", "quasi-newton", "newton"] = "auto",
    regulator: Literal["descent", "lqr"] = "descent",
    max_iterations: int = 100,
    tolerance: float = 1e-9,
    absolute_tolerance: float = 1e-14,
    alpha: float = 1e-4,
    beta: float = 0.5,
    max_backtracks: int = 20,
    accuracy: Accuracy | None = None,
    callback: Callback | None = None,
) -> ContinuousOptimizationResult:
    """Minimise a cost over the trajectories of a system; the initial state stays as it is.

    The same iteration as `leastaction.optimal.optimize`, over functions of time.

    Parameters
    ----------
    system : ContinuousSystem
        What is steered.
    cost : ContinuousCost
        What is minimised, such as a `ContinuousQuadraticCost`.
    initial : DenseTrajectory or (x, u)
        Where to start: a curve, whose projection is taken; or x and u, of shapes (nx,) and (nu,), as
        constants, functions of one time or `PiecewisePolynomial`. A constant x is an initial state, to
        which u is applied.
    horizon : (t0, tf)
        Times (s); needed with ``(x, u)``.
    resume : ContinuousOptimizationResult
        Go on from an earlier result instead of `initial`. The iterates are those of a run that was
        never stopped, if method, regulator, accuracy, cost and system are the same.
    method, regulator, max_iterations, tolerance, absolute_tolerance, alpha, beta, max_backtracks
        As in `leastaction.optimal.optimize`.
    accuracy : Accuracy, optional
        Integrator and tolerances. An optimum is found to about the square of the relative tolerance in
        cost, and to the tolerance in the trajectory.
    callback : callable, optional
        As in `leastaction.optimal.optimize`; `x` and `u` of the record are samples at the ends of the
        trajectory's pieces, of which there are more or fewer from one iterate to the next.

    Returns
    -------
    ContinuousOptimizationResult
        Frozen; `status` says how it ended. Ctrl-C gives the last iterate.

    Raises
    ------
    ArgumentError
        Settings, shapes or values that are wrong, or an initial curve that cannot be projected.
    """
    settings = check_settings(
        has_curvature=system.has_curvature,
        system=type(system).__name__,
        method=method,
        regulator=regulator,
        max_iterations=max_iterations,
        tolerance=tolerance,
        absolute_tolerance=absolute_tolerance,
        alpha=alpha,
        beta=beta,
        max_backtracks=max_backtracks,
        chunk=1,  # the cost of a trial is looked at after every step of the integrator
    )
    if (initial is None) == (resume is None):
        raise ArgumentError(
            f"initial, resume: got {'neither' if initial is None else 'both'}, expected one of them."
        )
    problem = ContinuousProblem(system, cost, settings, accuracy or Accuracy())
    if resume is not None:
        problem.resume(resume)
    elif initial is not None:
        problem.start(initial, horizon)
    result = Loop(problem, settings, callback, resume).run()
    assert isinstance(result, ContinuousOptimizationResult)
    return result
