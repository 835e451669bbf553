"""Quadratic models along a trajectory in continuous time (dissertation 6.4)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, require_finite
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.descent import escape
from leastaction.optimal.continuous.model import SampledSystem, TangentModel, sample_model
from leastaction.optimal.continuous.own_projection import checked_gains, feedback_of, weights_as_cost
from leastaction.optimal.continuous.projection import Follower, roll_out
from leastaction.optimal.continuous.riccati import (
    ContinuousLinearQuadraticSolution,
    continuous_adjoint,
    solve_samples,
)
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.line_search import rounding_of
from leastaction.optimal.loop import Clock, DescentModels, Direction
from leastaction.optimal.options import Options

# What a cost is off, in units of the relative error allowed in one step of the integration. Measured on
# swing-ups of a cart-pendulum of 4 and 10 s, tolerances from 1e-6 to 1e-12: 0.004 to 0.6, of which a
# hundredth to a half changes from one trial to the next.
_ERROR_OF_COST = 1.0

# A Newton model with a P so much more negative than the weights is as good as one without a minimum: its
# direction leads far out of where it holds. Waiting for P to grow on costs as much as the rest.
_ESCAPE = 1e4
# Of the whole Newton model, which also tells a minimum from a saddle, it takes more.
_SURELY = 1e6

# Expected of a step along a direction of negative curvature, and how far it goes, relative to the sizes of the states.
_DECREASE, _REACH = 0.1, 0.3


@dataclass(frozen=True)
class ContinuousDirection(Direction):
    """A descent direction, as the feedback along which it is followed.

    At the step length s the input is ``u_now - s C - K (x - x_now)``.

    ``feedback``: ``[K (row by row); C]`` in one vector.
    """

    feedback: PiecewisePolynomial = field(kw_only=True)


class DenseHere:
    """Where a search in continuous time stands.

    ``trajectory``: the iterate. ``gain``: of the projection that led there. ``value``: its cost. ``roughness``: what
    that was seen to be off by, beyond its noise. ``rtol``: of the integration.
    """

    trajectory: DenseTrajectory
    gain: PiecewisePolynomial
    gap = 0.0
    worst_step: StepQuality | None = None

    def __init__(self, rtol: float) -> None:
        self.rtol, self.value, self.roughness = rtol, np.nan, 0.0

    @property
    def noise(self) -> float:
        """What the cost may be off by the error of the integration."""
        return _ERROR_OF_COST * self.rtol * abs(self.value) + rounding_of(self.value)


class ContinuousModels(DescentModels[ContinuousLinearQuadraticSolution, ContinuousDirection]):
    """Quadratic models of a cost along the trajectory where a search stands, and what was computed for them.

    ``projection``: of a user. ``jumps``: times (s) at which something jumps. ``feedback``: gains about the iterate, if
    these are known.
    """

    # The Riccati equation is the stiffer the larger the weights, and it is integrated explicitly.
    largest_shift = 10.0

    knows_longest_step = False

    def __init__(
        self,
        system: ContinuousSystem,
        cost: ContinuousCost,
        settings: Options,
        accuracy: Accuracy,
        here: DenseHere,
        clock: Clock,
    ) -> None:
        self.system, self.cost, self.accuracy, self.here, self.clock = system, cost, accuracy, here, clock
        self.has_curvature = self.tells_saddles = system.has_curvature
        self.projection = settings.projection
        self.own_regulator = settings.regulator == "lqr" or self.projection is not None
        self.jumps = tuple(sorted({*system.jumps, *cost.jumps}))
        # What was computed along the iterate; None: not yet.
        self.model: TangentModel | None = None
        self.curvature: Array | None = None
        self.quasi_newton: ContinuousLinearQuadraticSolution | None = None
        self.feedback: PiecewisePolynomial | None = None

    @property
    def magnitude(self) -> float:
        return self.here.value

    def minimise(self, method: str, scale: float, shift: float = 0.0) -> ContinuousLinearQuadraticSolution:
        if self.own_regulator and self.feedback is None:
            self.here.gain = self.feedback = self._own_feedback()
        if method != "quasi-newton" or shift > 0.0:
            return self._solve(method, scale, shift)
        if self.quasi_newton is None:
            self.quasi_newton = self._solve(method, scale)
        return self.quasi_newton

    def refined(self, direction: ContinuousDirection, *, holds: bool) -> ContinuousDirection:  # noqa: ARG002
        return direction

    def remaining_decrease(self) -> float:
        return np.inf

    def negative_curvature(self, scale: float) -> ContinuousDirection | None:
        model = self.tangent()
        found = escape(model, self._curvature_along(model), scale, self.size(), solve=self._minimum, sweep=self.sweep)
        if found is None:
            return None
        length = min(np.sqrt(2.0 * _DECREASE * abs(self.here.value) / -found.bend), _REACH / found.reach)
        sign = -1.0 if found.slope > 0.0 else 1.0
        nx, nu = self.system.nx, self.system.nu
        factors = np.ones(nu * nx + nu)
        factors[nu * nx :] = sign * length / found.size
        mesh = Mesh(found.feedback.breaks)
        scaled = mesh.fit(found.feedback(mesh.t) * factors, factors.shape)
        return ContinuousDirection(
            "negative-curvature", -length * abs(found.slope), 1.0, bend=length**2 * found.bend, feedback=scaled
        )

    def keep_feedback(self, direction: ContinuousDirection) -> None:
        self.feedback = direction.feedback

    def forget(self) -> None:
        self.model = self.curvature = self.quasi_newton = self.feedback = None

    # ---- Gains and motions ------------------------------------------------------------------------

    def regulate(self) -> PiecewisePolynomial:
        """Return gains about the current curve: of the cost's own regulator, if it has one."""
        if self.projection is not None:
            return self._own_feedback()
        solution = self._solve("quasi-newton", 0.0)
        if not solution.definite:
            solution = self._solve_regulator()
        else:
            self.quasi_newton = solution
        return solution.feedback

    def _own_feedback(self) -> PiecewisePolynomial:
        """Return the projection's own gains, as they were given or of a regulator with its own weights."""
        gains = None if self.projection is None else checked_gains(self.projection, self.system)
        return self._solve_regulator().feedback if gains is None else feedback_of(gains)

    def size(self) -> Array:
        """Return the largest states and inputs of the current trajectory."""
        return np.asarray(np.abs(self.here.trajectory.xu(self.tangent().mesh.t)).max(axis=0))

    def sweep(self, model: ContinuousLinearQuadraticSolution) -> DenseTrajectory:
        """Return the minimum ``(dx, du)`` of a model along the current trajectory."""
        along = self.tangent()
        zero = np.zeros(self.system.nx + self.system.nu)
        t0, tf = self.here.trajectory.t0, self.here.trajectory.tf
        with self.clock.lq:
            swept = roll_out(
                SampledSystem(along.mesh, along.samples),
                Follower(
                    DenseTrajectory(PiecewisePolynomial.constant(zero, t0, tf), self.system.nx), model.feedback, 1.0
                ),
                accuracy=self.accuracy,
                jumps=self.jumps,
                least=self.size(),
            )
        if swept.trajectory is None:
            raise ArgumentError(f"direction: the linearised system failed at {swept.failure}.")
        return swept.trajectory

    # ---- Linear-quadratic problems ----------------------------------------------------------------

    def _solve(self, method: str, scale: float, shift: float = 0.0) -> ContinuousLinearQuadraticSolution:
        model = self.tangent()
        if method == "steepest":
            model = model.with_identities()
        elif method == "newton":
            model = model.with_curvature(scale * self._curvature_along(model))
        if shift > 0.0:
            nx, nu = self.system.nx, self.system.nu
            model = model.with_curvature(shift * np.eye(nx + nu)[None])
            model = replace(model, Q_final=model.Q_final + shift * np.eye(nx))
        return self._minimum(model, escape=_SURELY if scale == 1.0 else _ESCAPE)

    def _minimum(self, model: TangentModel, **options: float) -> ContinuousLinearQuadraticSolution:
        """Return the solution of a model along the current curve."""
        with self.clock.lq:
            return solve_samples(model, accuracy=self.accuracy, jumps=self.jumps, **options)

    def _solve_regulator(self) -> ContinuousLinearQuadraticSolution:
        """Return the LQR about the current curve, with weights that were given or identities."""
        model = self.tangent().with_identities()
        model = model.driven_by(np.zeros_like(model.samples.r))
        if self.projection is None:
            return self._minimum(model)
        t, nx, nu, trajectory = model.mesh.t, self.system.nx, self.system.nu, self.here.trajectory
        cost = weights_as_cost(self.projection, self.system, trajectory.t0, trajectory.tf)
        Q, R, _ = cost.hessian(np.zeros((len(t), nx)), np.zeros((len(t), nu)), t)
        final = cost.final_hessian(np.zeros(nx), trajectory.tf)
        solution = self._minimum(replace(model, samples=model.samples._replace(Q=Q, R=R), Q_final=final))
        if not solution.definite:
            raise ArgumentError(f"projection: there is no regulator with these weights: {solution.message}")
        return solution

    def tangent(self) -> TangentModel:
        """Return linearisation and cost along the current curve."""
        if self.model is None:
            with self.clock.linearize:
                self.model = sample_model(self.system, self.cost, self.here.trajectory, self.jumps, self.accuracy)
        return self.model

    def _curvature_along(self, model: TangentModel) -> Array:
        if self.curvature is None:
            nx, nu = self.system.nx, self.system.nu
            t = model.mesh.t
            with self.clock.lq:
                K = self.here.gain(t)[:, : nu * nx].reshape(-1, nu, nx)
                z = continuous_adjoint(model, K, accuracy=self.accuracy, jumps=self.jumps)
            with self.clock.curvature:
                self.curvature = self.system.curvatures(*self.here.trajectory.sample(t), t, z(t))
            require_finite(self.curvature, "curvature of the system")
        return self.curvature

    def final_feedback(self) -> PiecewisePolynomial:
        """Return gains about the last iterate, for a run that ended before it had any."""
        try:
            solution = self._solve("quasi-newton", 0.0)
            if not solution.definite:
                solution = self._solve_regulator()
        except LeastActionError:
            return self.here.gain
        return solution.feedback if solution.definite else self.here.gain
