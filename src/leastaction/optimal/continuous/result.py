"""What an optimisation in continuous time returns."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.continuous.integrate import Accuracy
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.result import OptimizationResult

__all__ = ["ContinuousOptimizationResult"]


@dataclass(frozen=True)
class ContinuousOptimizationResult(OptimizationResult):
    """An optimised trajectory in continuous time; everything that the discrete result has, and more.

    `x` (n+1, nx), `u` (n+1, nu), `K` (n+1, nu, nx) and `projection_gain` are samples at the times `t`,
    so input and gains have as many rows as the states.

    Attributes
    ----------
    t : ndarray (n+1,)
        Times of the samples (s): the ends of the trajectory's pieces.
    trajectory : DenseTrajectory
        The trajectory as functions of time.
    feedback : PiecewisePolynomial
        Gains (nu, nx) about it as a function of time, ``u = u_opt - K (x - x_opt)``.
    projection : PiecewisePolynomial
        The gains by which the trajectory was reached. Resuming needs them to go on exactly.
    accuracy : Accuracy
        How the run integrated.
    jumps : tuple of float
        Times (s) where integrations start anew: those of the system, of the cost, and of the curve that
        the optimisation began with.
    """

    t: Array
    trajectory: DenseTrajectory
    feedback: PiecewisePolynomial
    projection: PiecewisePolynomial
    accuracy: Accuracy
    jumps: tuple[float, ...]
