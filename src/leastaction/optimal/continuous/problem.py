"""A continuous system and its cost, as the optimiser's loop sees them (dissertation 6.4)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, as_array, require_finite
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial, approximate
from leastaction.numerics.time_functions import TimeFunctionLike
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.descent import escape
from leastaction.optimal.continuous.horizon import as_horizon
from leastaction.optimal.continuous.model import (
    SampledSystem,
    TangentModel,
    sample_model,
    with_curvature,
    with_identities,
)
from leastaction.optimal.continuous.own_projection import checked_gains, feedback_of, weights_as_cost
from leastaction.optimal.continuous.projection import Follower, roll_out
from leastaction.optimal.continuous.riccati import (
    ContinuousLinearQuadraticSolution,
    ModelSamples,
    continuous_adjoint,
    solve_samples,
)
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory, OverTime
from leastaction.optimal.initial import pair_of
from leastaction.optimal.line_search import Refusal, Trial, rounding_of
from leastaction.optimal.loop import Clock, Direction, OneStage, Problem, along_parabola
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult

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


class ContinuousProblem(Problem[ContinuousLinearQuadraticSolution, ContinuousDirection, DenseTrajectory]):
    """The current trajectory of a continuous system, and what was computed along it.

    ``horizon``: times (s), if what it starts from does not bring them.
    """

    rollouts: int = 0
    value: float = np.nan
    roughness: float = 0.0
    gap = 0.0
    worst_step = None
    sees_walls = False
    undetermined = ""

    # The Riccati equation is the stiffer the larger the weights, and it is integrated explicitly.
    largest_shift = 10.0

    def __init__(
        self,
        system: ContinuousSystem,
        cost: ContinuousCost,
        settings: Options,
        accuracy: Accuracy,
        horizon: tuple[float, float] | None = None,
    ) -> None:
        self._clock = Clock()
        # The noise of a cost is estimated, not known: a step that is lost in it may still have converged.
        self.stages = OneStage(patience=2)
        self.horizon = horizon
        self.system = system
        self.cost = cost
        self.accuracy = accuracy
        self.has_curvature = self.tells_saddles = system.has_curvature
        self.projection = settings.projection  # of a user
        self.own_regulator = settings.regulator == "lqr" or self.projection is not None
        self.jumps = tuple(sorted({*system.jumps, *cost.jumps}))

        # The current iterate, and the gains of the projection that led to it.
        self.trajectory: DenseTrajectory
        self.gain: PiecewisePolynomial
        # What was computed along it; None: not yet.
        self.model: TangentModel | None = None
        self.curvature: Array | None = None
        self.quasi_newton: ContinuousLinearQuadraticSolution | None = None
        self.feedback: PiecewisePolynomial | None = None

    @property
    def clock(self) -> Clock:
        return self._clock

    @property
    def shown(self) -> float:
        return self.value

    @property
    def magnitude(self) -> float:
        return self.value

    def note_roughness(self, off: float) -> None:
        self.roughness = off

    @property
    def noise(self) -> float:
        """What the cost may be off by the error of the integration."""
        return _ERROR_OF_COST * self.accuracy.rtol * abs(self.value) + rounding_of(self.value)

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: DenseTrajectory | tuple[TimeFunctionLike, TimeFunctionLike]) -> None:
        """Begin with a trajectory, a curve to be projected, or an initial state and inputs."""
        curve, is_curve = self.given(initial)
        if not is_curve:
            self.apply(curve)
            self.gain = self._regulate()
            return
        self.trajectory = curve
        self.gain = self._regulate()
        self._project(curve, self.gain)

    def given(
        self, initial: DenseTrajectory | tuple[TimeFunctionLike, TimeFunctionLike]
    ) -> tuple[DenseTrajectory, bool]:
        """Return the curve to begin with, and whether it is one: if not, its first state and its inputs are meant."""
        horizon = self.horizon
        nx, nu = self.system.nx, self.system.nu
        if isinstance(initial, DenseTrajectory):
            if horizon is not None and as_horizon(horizon) != (initial.t0, initial.tf):
                raise ArgumentError(
                    f"horizon: got {horizon}, expected that of the initial trajectory, "
                    f"({initial.t0:g}, {initial.tf:g}), or None."
                )
            if (initial.nx, initial.nu) != (nx, nu):
                raise ArgumentError(
                    f"initial: got a trajectory of {initial.nx} states and {initial.nu} inputs, expected {nx} and {nu}."
                )
            curve, is_curve = initial, True
        else:
            if horizon is None:
                raise ArgumentError("horizon: got None, expected (t0, tf) in seconds.")
            x, u = pair_of(initial)
            is_curve = isinstance(x, PiecewisePolynomial) or callable(x)
            if not is_curve:
                x = as_array(np.asarray(x), "initial x", (nx,), meaning="an initial state (nx,)")
            times = as_horizon(horizon)
            curve = DenseTrajectory.from_functions(x, u, horizon=times, nx=nx, nu=nu)
        self.cost.check(curve.t0, curve.tf, nx, nu)
        self.jumps = tuple(sorted({*self.jumps, *curve.xu.jumps()}))
        return curve, is_curve

    def apply(self, curve: DenseTrajectory) -> None:
        """Begin with what the inputs alone make of the first state, if they can."""
        nx, nu = self.system.nx, self.system.nu
        self._project(curve, PiecewisePolynomial.constant(np.zeros(nu * nx + nu), curve.t0, curve.tf))

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        assert isinstance(result, ContinuousOptimizationResult)
        trajectory, nx, nu = result.dense, self.system.nx, self.system.nu
        if (trajectory.nx, trajectory.nu) != (nx, nu):
            raise ArgumentError(
                f"resume: got a result of {trajectory.nx} states and {trajectory.nu} inputs, expected {nx} and {nu}."
            )
        self.cost.check(trajectory.t0, trajectory.tf, nx, nu)
        self.trajectory, self.gain = trajectory, result.projection
        self.jumps = tuple(sorted({*self.jumps, *result.jumps}))
        # Another cost may be asked for now, so the old one's value is taken only if it is this one's.
        mesh = Mesh(trajectory.t)
        x, u = trajectory.sample(mesh.t)
        rates = [self.cost.rate(*at) for at in zip(x, u, mesh.t.tolist(), strict=True)]
        x_final = trajectory.xu.flat(trajectory.tf)[:nx]
        self.value = float(mesh.weights @ rates) + self.cost.final_value(x_final, trajectory.tf)
        if abs(self.value - result.cost) <= 1e-5 * abs(result.cost):
            self.value = result.cost

    def _project(self, curve: DenseTrajectory, feedback: PiecewisePolynomial) -> None:
        scale = 0.0
        with self.clock("rollout"):
            for _ in range(2):
                rollout = roll_out(
                    self.system,
                    Follower(curve, feedback, 0.0),
                    accuracy=self.accuracy,
                    jumps=self.jumps,
                    cost=self.cost,
                    cost_scale=scale,
                )
                scale = abs(rollout.cost)
                # A small cost is lost in its absolute tolerance, until its size is known.
                if not 0.0 < self.accuracy.rtol * scale < self.accuracy.atol:
                    break
        self.rollouts += 1
        if rollout.trajectory is None:
            raise ArgumentError(
                f"initial: the integration failed at {rollout.failure}. Give a trajectory of the "
                "system (such as one it simulated), or a curve that stays closer to one."
            )
        if not np.isfinite(rollout.cost):
            raise ArgumentError(
                f"initial: the cost of the initial trajectory is {rollout.cost}, expected a finite "
                "number. Look at the cost's weights and wanted motion."
            )
        self.trajectory, self.value = rollout.trajectory, rollout.cost
        self.forget()

    def _regulate(self) -> PiecewisePolynomial:
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

    # ---- Directions -----------------------------------------------------------------------------

    def minimise_model(self, method: str, scale: float, shift: float = 0.0) -> ContinuousLinearQuadraticSolution:
        if self.own_regulator and self.feedback is None:
            self.gain = self.feedback = self._own_feedback()
        if method != "quasi-newton" or shift > 0.0:
            return self._solve(method, scale, shift)
        if self.quasi_newton is None:
            self.quasi_newton = self._solve(method, scale)
        return self.quasi_newton

    def direction(
        self, method: str, model: ContinuousLinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> ContinuousDirection:
        feedback = model.feedback
        if self.own_regulator:
            feedback = self._with_own_gain(model)
        else:
            self.feedback = feedback
        # With dx(t0) = 0 the model's minimum is half of its linear part.
        return ContinuousDirection(method, 2.0 * model.constant, scale, shift, feedback=feedback)

    def _with_own_gain(self, model: ContinuousLinearQuadraticSolution) -> PiecewisePolynomial:
        """Return the projection's own gains, with the feedforward that follows the direction.

        ``ubar - K (x - xbar)`` of ``(xbar, ubar) = xi + s dxi`` is ``u - s (Kd dx + C - K dx) - K (x - x_now)``,
        where ``du = -Kd dx - C`` is the direction's own law.
        """
        assert self.feedback is not None
        own = self.feedback
        nx, nu = self.system.nx, self.system.nu
        size = self._size()
        tangent = self._sweep(model)

        def law(t: Array) -> Array:
            K, dxdu = own(t)[:, : nu * nx], tangent.xu(t)
            fed_back = np.einsum("nij,nj->ni", K.reshape(-1, nu, nx), dxdu[:, :nx])
            return np.hstack([K, -dxdu[:, nx:] - fed_back])

        least = np.zeros(nu * (nx + 1))
        least[nu * nx :] = size[nx:]
        mesh, values = approximate(law, Mesh(own.breaks), self.accuracy.sampling, least)
        return mesh.fit(values, (values.shape[1],))

    def _size(self) -> Array:
        """Return the largest states and inputs of the current trajectory."""
        return np.asarray(np.abs(self.trajectory.xu(self._model().mesh.t)).max(axis=0))

    def _sweep(self, model: ContinuousLinearQuadraticSolution) -> DenseTrajectory:
        """Return the minimum ``(dx, du)`` of a model along the current trajectory."""
        along = self._model()
        zero = np.zeros(self.system.nx + self.system.nu)
        t0, tf = self.trajectory.t0, self.trajectory.tf
        with self.clock("lq"):
            swept = roll_out(
                SampledSystem(along.mesh, along.samples),
                Follower(
                    DenseTrajectory(PiecewisePolynomial.constant(zero, t0, tf), self.system.nx), model.feedback, 1.0
                ),
                accuracy=self.accuracy,
                jumps=self.jumps,
                least=self._size(),
            )
        if swept.trajectory is None:
            raise ArgumentError(f"direction: the linearised system failed at {swept.failure}.")
        return swept.trajectory

    def refined(self, direction: ContinuousDirection, *, holds: bool) -> ContinuousDirection:  # noqa: ARG002
        return direction

    def left_beside_rounding(self) -> float:
        return np.inf

    def where(self, direction: ContinuousDirection) -> str:  # noqa: ARG002
        return ""

    def negative_curvature(self, scale: float) -> ContinuousDirection | None:
        model = self._model()

        def solve(samples: ModelSamples) -> ContinuousLinearQuadraticSolution:
            return self._minimum(samples, model.Q_final, np.zeros(self.system.nx))

        found = escape(model, self._curvature_along(model), scale, self._size(), solve=solve, sweep=self._sweep)
        if found is None:
            return None
        length = min(np.sqrt(2.0 * _DECREASE * abs(self.value) / -found.bend), _REACH / found.reach)
        sign = -1.0 if found.slope > 0.0 else 1.0
        nx, nu = self.system.nx, self.system.nu
        factors = np.ones(nu * nx + nu)
        factors[nu * nx :] = sign * length / found.size
        mesh = Mesh(found.feedback.breaks)
        scaled = mesh.fit(found.feedback(mesh.t) * factors, factors.shape)
        return ContinuousDirection(
            "negative-curvature", -length * abs(found.slope), 1.0, bend=length**2 * found.bend, feedback=scaled
        )

    def _solve(self, method: str, scale: float, shift: float = 0.0) -> ContinuousLinearQuadraticSolution:
        model = self._model()
        samples, Q_final = model.samples, model.Q_final
        nx = samples.B.shape[1]
        if method == "steepest":
            samples = with_identities(samples)
            Q_final = np.eye(nx)
        elif method == "newton":
            samples = with_curvature(samples, scale * self._curvature_along(model))
        if shift > 0.0:
            nu = self.system.nu
            samples = samples._replace(Q=samples.Q + shift * np.eye(nx), R=samples.R + shift * np.eye(nu))
            Q_final = Q_final + shift * np.eye(nx)
        return self._minimum(samples, Q_final, model.q_final, escape=_SURELY if scale == 1.0 else _ESCAPE)

    def _minimum(
        self, samples: ModelSamples, Q_final: Array, q_final: Array, **options: float
    ) -> ContinuousLinearQuadraticSolution:
        """Return the solution of a model with other weights along the current curve."""
        mesh = self._model().mesh
        with self.clock("lq"):
            return solve_samples(mesh, samples, Q_final, q_final, accuracy=self.accuracy, jumps=self.jumps, **options)

    def _solve_regulator(self) -> ContinuousLinearQuadraticSolution:
        """Return the LQR about the current curve, with weights that were given or identities."""
        model = self._model()
        if self.projection is not None:
            return self._with_weights(model)
        samples = with_identities(model.samples)
        samples = samples._replace(q=np.zeros_like(samples.q), r=np.zeros_like(samples.r))
        nx = self.system.nx
        return self._minimum(samples, np.eye(nx), np.zeros(nx))

    def _with_weights(self, model: TangentModel) -> ContinuousLinearQuadraticSolution:
        samples, t, nx, nu = model.samples, model.mesh.t, self.system.nx, self.system.nu
        cost = weights_as_cost(self.projection, self.system, self.trajectory.t0, self.trajectory.tf)
        Q, R, _ = cost.hessian(np.zeros((len(t), nx)), np.zeros((len(t), nu)), t)
        samples = with_identities(samples)._replace(Q=Q, R=R, q=np.zeros_like(samples.q), r=np.zeros_like(samples.r))
        final = cost.final_hessian(np.zeros(nx), self.trajectory.tf)
        solution = self._minimum(samples, final, np.zeros(nx))
        if not solution.definite:
            raise ArgumentError(f"projection: there is no regulator with these weights: {solution.message}")
        return solution

    def _model(self) -> TangentModel:
        """Return linearisation and cost along the current curve."""
        if self.model is None:
            with self.clock("linearize"):
                self.model = sample_model(self.system, self.cost, self.trajectory, self.jumps, self.accuracy)
        return self.model

    def _curvature_along(self, model: TangentModel) -> Array:
        if self.curvature is None:
            nx, nu = self.system.nx, self.system.nu
            t = model.mesh.t
            with self.clock("lq"):
                z = continuous_adjoint(
                    model.mesh,
                    model.samples,
                    self.gain(t)[:, : nu * nx].reshape(-1, nu, nx),
                    model.q_final,
                    accuracy=self.accuracy,
                    jumps=self.jumps,
                )
            with self.clock("curvature"):
                self.curvature = self.system.curvatures(*self.trajectory.sample(t), t, z(t))
            require_finite(self.curvature, "curvature of the system")
        return self.curvature

    def forget(self) -> None:
        self.model = self.curvature = self.quasi_newton = self.feedback = None

    # ---- Steps ----------------------------------------------------------------------------------

    def first_step(self, direction: ContinuousDirection, length: float) -> float:  # noqa: ARG002
        return length

    def promised(self, direction: ContinuousDirection, length: float) -> float:
        return along_parabola(direction, length)

    def simulate(self, direction: ContinuousDirection, length: float, bound: float) -> Trial[DenseTrajectory] | Refusal:
        rollout = roll_out(
            self.system,
            Follower(self.trajectory, direction.feedback, length),
            accuracy=self.accuracy,
            jumps=self.jumps,
            cost=self.cost,
            cost_scale=abs(self.value),
            bound=bound,
        )
        if rollout.trajectory is None:
            return Refusal(f"the roll-out ended at {rollout.failure}", failed=True)
        if direction.bend < 0.0:
            # Along it short steps change the cost by less than the noise, which says nothing of where it falls.
            bound = min(bound, self.value - self.noise)
        # Not "cost > bound": a NaN is refused.
        if not rollout.cost <= bound:
            return Refusal(f"a cost of {rollout.cost:.10g}, where at most {bound:.10g} was wanted", cost=rollout.cost)
        return Trial(rollout.trajectory, rollout.cost)

    def accept(self, direction: ContinuousDirection, trial: Trial[DenseTrajectory]) -> None:
        self.trajectory, self.value = trial.iterate, trial.cost
        self.gain = direction.feedback
        self.forget()

    def keep_feedback(self, direction: ContinuousDirection) -> None:
        self.feedback = direction.feedback

    def following(self, *, moved: bool) -> ContinuousProblem | None:  # noqa: ARG002
        return None

    # ---- What is told ---------------------------------------------------------------------------

    def arrays(self) -> tuple[Array, Array]:
        """Return states and inputs at the ends of the trajectory's pieces."""
        return self.trajectory.sample(self.trajectory.t)

    def result(self, summary: dict[str, Any]) -> ContinuousOptimizationResult:
        nx, nu = self.system.nx, self.system.nu
        feedback = self.feedback if self.feedback is not None else self._final_feedback()
        gain = feedback.part(np.arange(nu * nx), (nu, nx))
        t = self.trajectory.t
        x, u = self.arrays()
        return ContinuousOptimizationResult(
            x=x,
            u=u,
            K=gain(t),
            projection_gain=self.gain(t)[:, : nu * nx].reshape(-1, nu, nx),
            t=t,
            feedback=gain,
            projection=self.gain,
            over_time=OverTime(self.trajectory, self.accuracy, self.jumps),
            state_names=self.system.state_names,
            input_names=self.system.input_names,
            system=self.system.told(),
            **summary,
        )

    def _final_feedback(self) -> PiecewisePolynomial:
        """Return gains about the last iterate, for a run that ended before it had any."""
        try:
            solution = self._solve("quasi-newton", 0.0)
            if not solution.definite:
                solution = self._solve_regulator()
        except LeastActionError:
            return self.gain
        return solution.feedback if solution.definite else self.gain
