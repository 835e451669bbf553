"""A continuous system and its cost, as the optimiser's loop sees them (dissertation 6.4)."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial
from leastaction.numerics.time_functions import TimeFunctionLike
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.horizon import as_horizon
from leastaction.optimal.continuous.models import ContinuousDirection, ContinuousModels, DenseHere
from leastaction.optimal.continuous.projection import Follower, roll_out
from leastaction.optimal.continuous.riccati import ContinuousLinearQuadraticSolution
from leastaction.optimal.continuous.steps import ContinuousSteps
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory, OverTime
from leastaction.optimal.initial import pair_of
from leastaction.optimal.loop import Clock, OneStage, Problem, SearchReport, Steps
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult


class ContinuousReport(SearchReport[ContinuousDirection]):
    """What is told of a search in continuous time. ``rollouts``: beside those of line searches."""

    rollouts: int = 0
    note = undetermined = ""

    def __init__(self, models: ContinuousModels) -> None:
        self.models, self.here = models, models.here

    @property
    def clock(self) -> Clock:
        return self.models.clock

    @property
    def shown(self) -> float:
        return self.here.value

    def where(self, direction: ContinuousDirection) -> str:  # noqa: ARG002
        return ""

    def arrays(self) -> tuple[Array, Array]:
        """Return states and inputs at the ends of the trajectory's pieces."""
        return self.here.trajectory.sample(self.here.trajectory.t)

    def result(self, summary: dict[str, Any]) -> ContinuousOptimizationResult:
        nx, nu = self.models.system.nx, self.models.system.nu
        feedback = self.models.feedback if self.models.feedback is not None else self.models.final_feedback()
        gain = feedback.part(np.arange(nu * nx), (nu, nx))
        t = self.here.trajectory.t
        x, u = self.arrays()
        return ContinuousOptimizationResult(
            x=x,
            u=u,
            K=gain(t),
            projection_gain=self.here.gain(t)[:, : nu * nx].reshape(-1, nu, nx),
            t=t,
            feedback=gain,
            projection=self.here.gain,
            over_time=OverTime(self.here.trajectory, self.models.accuracy, self.models.jumps),
            state_names=self.models.system.state_names,
            input_names=self.models.system.input_names,
            system=self.models.system.told(),
            **summary,
        )


class ContinuousProblem(Problem[ContinuousLinearQuadraticSolution, ContinuousDirection, DenseTrajectory]):
    """The current trajectory of a continuous system, and the parts of a search from it.

    ``horizon``: times (s), if what it starts from does not bring them.
    """

    here: DenseHere
    models: ContinuousModels
    report: ContinuousReport

    def __init__(
        self,
        system: ContinuousSystem,
        cost: ContinuousCost,
        settings: Options,
        accuracy: Accuracy,
        horizon: tuple[float, float] | None = None,
    ) -> None:
        self.system, self.cost, self.accuracy, self.horizon = system, cost, accuracy, horizon
        # The noise of a cost is estimated, not known: a step that is lost in it may still have converged.
        self.stages = OneStage(patience=2)
        self.here = DenseHere(accuracy.rtol)
        self.models = ContinuousModels(system, cost, settings, accuracy, self.here, Clock())
        self.report = ContinuousReport(self.models)
        self._steps = ContinuousSteps(self.models)

    @property
    def steps(self) -> Steps[ContinuousLinearQuadraticSolution, ContinuousDirection, DenseTrajectory]:
        return self._steps

    def following(self, *, moved: bool) -> ContinuousProblem | None:  # noqa: ARG002
        return None

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: DenseTrajectory | tuple[TimeFunctionLike, TimeFunctionLike]) -> None:
        """Begin with a trajectory, a curve to be projected, or an initial state and inputs."""
        curve, is_curve = self.given(initial)
        if not is_curve:
            self.apply(curve)
            self.here.gain = self.models.regulate()
            return
        self.here.trajectory = curve
        self.here.gain = self.models.regulate()
        self._project(curve, self.here.gain)

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
        self.models.jumps = tuple(sorted({*self.models.jumps, *curve.xu.jumps()}))
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
        self.here.trajectory, self.here.gain = trajectory, result.projection
        self.models.jumps = tuple(sorted({*self.models.jumps, *result.jumps}))
        # Another cost may be asked for now, so the old one's value is taken only if it is this one's.
        mesh = Mesh(trajectory.t)
        x, u = trajectory.sample(mesh.t)
        rates = [self.cost.rate(*at) for at in zip(x, u, mesh.t.tolist(), strict=True)]
        x_final = trajectory.xu.flat(trajectory.tf)[:nx]
        self.here.value = float(mesh.weights @ rates) + self.cost.final_value(x_final, trajectory.tf)
        if abs(self.here.value - result.cost) <= 1e-5 * abs(result.cost):
            self.here.value = result.cost

    def _project(self, curve: DenseTrajectory, feedback: PiecewisePolynomial) -> None:
        scale = 0.0
        with self.report.clock.rollout:
            for _ in range(2):
                rollout = roll_out(
                    self.system,
                    Follower(curve, feedback, 0.0, self.system.charts()),
                    accuracy=self.accuracy,
                    jumps=self.models.jumps,
                    cost=self.cost,
                    cost_scale=scale,
                )
                scale = abs(rollout.cost)
                # A small cost is lost in its absolute tolerance, until its size is known.
                if not 0.0 < self.accuracy.rtol * scale < self.accuracy.atol:
                    break
        self.report.rollouts += 1
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
        self.here.trajectory, self.here.value = rollout.trajectory, rollout.cost
        self.models.forget()
