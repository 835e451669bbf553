"""Trajectories and curves in continuous time as objects, and what an optimisation returns of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.dataset import TIME, Dataset
from leastaction.numerics.piecewise import PiecewisePolynomial, Through, approximate
from leastaction.numerics.public import public
from leastaction.numerics.time_functions import TimeFunction, TimeFunctionLike
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.content import ContinuousContent
from leastaction.optimal.continuous.horizon import first_mesh
from leastaction.optimal.result import OptimizationResult, dataset_of

_FIRST_PIECES = 16  # pieces in which functions of time are first sampled


@public
class DenseTrajectory:
    """States and inputs as functions of time; a curve, if they do not obey the dynamics.

    Nothing in it changes, so any number of threads may share it.

    Parameters
    ----------
    xu : PiecewisePolynomial
        States and inputs in one vector (nx + nu,).
    nx : int
        Number of states.
    """

    def __init__(self, xu: PiecewisePolynomial, nx: int) -> None:
        self.xu = xu
        self.nx = nx
        self.nu = xu.shape[0] - nx

    @classmethod
    def from_samples(cls, t: ArrayLike, x: ArrayLike, u: ArrayLike, *, kind: Through = "cubic") -> DenseTrajectory:
        """Return the curve through samples.

        Parameters
        ----------
        t : array_like (n+1,)
            Times (s), increasing.
        x : array_like (n+1, nx)
            States; a cubic spline goes through them.
        u : array_like (n+1, nu), or (n, nu) for "hold"
            Inputs.
        kind : {"linear", "hold", "cubic"}
            How the inputs go from one sample to the next.

        Raises
        ------
        ArgumentError
            Wrong shapes or values that are not finite.
        """
        states = PiecewisePolynomial.through(t, x)
        inputs = PiecewisePolynomial.through(t, u, kind=kind)
        if len(states.shape) != 1 or len(inputs.shape) != 1:
            raise ArgumentError(
                f"x, u: got samples of shapes {states.shape} and {inputs.shape}, expected (nx,) and (nu,)."
            )
        mesh = first_mesh(states.t0, states.tf, states.breaks[1:-1].tolist(), 1)
        values = np.hstack([states(mesh.t), inputs(mesh.t)])
        return cls(mesh.fit(values, (values.shape[1],)), states.shape[0])

    @classmethod
    def from_functions(
        cls,
        x: TimeFunctionLike,
        u: TimeFunctionLike,
        *,
        horizon: tuple[float, float],
        nx: int,
        nu: int,
        tolerance: float = 1e-9,
    ) -> DenseTrajectory:
        """Return the curve of two functions of time, or constants.

        Parameters
        ----------
        x, u : of shape (nx,), (nu,)
            Constants, `PiecewisePolynomial` or functions of one time.
        horizon : (t0, tf)
            Times (s).
        nx, nu : int
            Numbers of states and inputs.
        tolerance : float
            Of the approximation, relative.

        Raises
        ------
        ArgumentError
            Wrong shapes or values that are not finite.
        """
        t0, tf = horizon
        states, inputs = TimeFunction(x, "x", row=True), TimeFunction(u, "u", row=True)
        states.check(t0, tf, (nx,), what="(nx,)")
        inputs.check(t0, tf, (nu,), what="(nu,)")
        jumps = sorted({*states.jumps, *inputs.jumps})
        mesh, values = approximate(
            lambda t: np.hstack([states.samples(t), inputs.samples(t)]),
            first_mesh(t0, tf, jumps, _FIRST_PIECES),
            tolerance,
        )
        return cls(mesh.fit(as_array(values, "x, u"), (nx + nu,)), nx)

    @cached_property
    def x(self) -> PiecewisePolynomial:
        """States (nx,) as a function of time."""
        return self.xu.part(np.arange(self.nx), (self.nx,))

    @cached_property
    def u(self) -> PiecewisePolynomial:
        """Inputs (nu,) as a function of time."""
        return self.xu.part(self.nx + np.arange(self.nu), (self.nu,))

    @property
    def t(self) -> Array:
        """Ends of the pieces (s), about where the integrator stepped."""
        return self.xu.breaks

    @property
    def t0(self) -> float:
        """First time (s)."""
        return self.xu.t0

    @property
    def tf(self) -> float:
        """Last time (s)."""
        return self.xu.tf

    def sample(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return states (n, nx) and inputs (n, nu) at times (n,).

        Raises
        ------
        ArgumentError
            Times outside of the horizon.
        """
        times = as_array(t, "t")
        slack = 1e-9 * (self.tf - self.t0)
        if times.size and not (self.t0 - slack <= times.min() and times.max() <= self.tf + slack):
            raise ArgumentError(
                f"t: got times from {times.min():g} to {times.max():g} s, expected times in [{self.t0:g}, {self.tf:g}]."
            )
        values = self.xu(times)
        return values[..., : self.nx], values[..., self.nx :]


@dataclass(frozen=True)
class OverTime:
    """An optimised trajectory as a function of time, and how it was integrated.

    ``dense``: The states and inputs. ``accuracy``: How the run integrated. ``jumps``: Times (s) where integrations
    start anew: those of the system, of the cost, and of the curve that the optimisation began with.
    """

    dense: DenseTrajectory
    accuracy: Accuracy
    jumps: tuple[float, ...]


@public
@dataclass(frozen=True)
class ContinuousOptimizationResult(OptimizationResult):
    """An optimised trajectory in continuous time; everything that the discrete result has, and more.

    `x` (n+1, nx), `u` (n+1, nu), `K` (n+1, nu, nx) and `projection_gain` are samples at the times `t`,
    so input and gains have as many rows as the states.

    Attributes
    ----------
    t : ndarray (n+1,)
        Times of the samples (s): the ends of the trajectory's pieces.
    feedback : PiecewisePolynomial
        Gains (nu, nx) about it as a function of time, ``u = u_opt - K (x - x_opt)``.
    projection : PiecewisePolynomial
        The gains by which the trajectory was reached. Resuming needs them to go on exactly.
    over_time : OverTime
        The trajectory as a function of time, how it was integrated, and where that starts anew: `dense`, `accuracy` and
        `jumps` of the result.
    """

    t: Array
    feedback: PiecewisePolynomial
    projection: PiecewisePolynomial
    over_time: OverTime

    @property
    def dense(self) -> DenseTrajectory:
        """The states and inputs as functions of time."""
        return self.over_time.dense

    @property
    def accuracy(self) -> Accuracy:
        """How the run integrated."""
        return self.over_time.accuracy

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times (s) where integrations start anew."""
        return self.over_time.jumps

    def own_dataset(self) -> Dataset:
        return dataset_of(self, ContinuousContent.of(self), steps=TIME, prefix="common.")
