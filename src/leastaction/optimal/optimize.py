"""Trajectory optimisation by the projection operator (dissertation Alg. 1 to 3).

``minimise h(x, u) over trajectories of x+ = f(x, u, k) from a fixed initial state``

Every iterate is a trajectory. An iteration linearises along it, minimises a quadratic model over the
tangent trajectories (a linear-quadratic problem), and follows the projection of that direction as far
as the cost falls enough.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.optimal._arrays import Floats, as_count, as_floats, as_number
from leastaction.optimal.costs import Cost, CostGradient
from leastaction.optimal.descent import Direction, minimise_model
from leastaction.optimal.line_search import LineSearch, Step, rounding_of
from leastaction.optimal.linear_quadratic import (
    LinearQuadraticSolution,
    Workspace,
    adjoint,
    regulate,
    sweep_forward,
)
from leastaction.optimal.protocol import DiscreteSystem, Linearization, Rollout
from leastaction.optimal.result import (
    HistoryBuilder,
    IterationRecord,
    NewtonSchedule,
    OptimizationResult,
    Settings,
    Status,
)

__all__ = ["Callback", "optimize"]

Callback = Callable[[IterationRecord], object]

METHODS = ("auto", "steepest", "quasi-newton", "newton")
REGULATORS = ("descent", "lqr")

# Methods in the order in which they replace one another when a direction cannot be followed.
_CHAIN = ("newton", "quasi-newton", "steepest")

# Less of the dynamics' curvature than this is not worth having.
_LEAST_CURVATURE = 1.0 / 128.0


def optimize(
    system: DiscreteSystem,
    cost: Cost,
    *,
    initial: tuple[ArrayLike, ArrayLike] | None = None,
    resume: OptimizationResult | None = None,
    method: Literal["auto", "steepest", "quasi-newton", "newton"] = "auto",
    regulator: Literal["descent", "lqr"] = "descent",
    max_iterations: int = 100,
    tolerance: float = 1e-9,
    absolute_tolerance: float = 1e-14,
    alpha: float = 1e-4,
    beta: float = 0.5,
    max_backtracks: int = 20,
    chunk: int = 64,
    callback: Callback | None = None,
) -> OptimizationResult:
    """Minimise a cost over the trajectories of a system; the initial state stays as it is.

    Parameters
    ----------
    system : DiscreteSystem
        What is steered.
    cost : Cost
        What is minimised, such as a `QuadraticCost`.
    initial : (x, u)
        Where to start: x (N+1, nx) and u (N, nu). If x is not a trajectory of the system, the
        projection of (x, u) is taken. x (nx,) is an initial state alone: u is then applied to it.
    resume : OptimizationResult
        Go on from an earlier result instead of `initial`. The iterates are those of a run that was
        never stopped, if method, regulator, cost and system are the same.
    method : {"auto", "steepest", "quasi-newton", "newton"}
        The model of the descent direction. "auto" starts with quasi-Newton, stays with it while it
        foretells the cost well, and goes to Newton otherwise. A Newton model without a minimum is
        damped; a method whose direction cannot be followed is replaced, for that iteration, by the
        next simpler one. The history and the table show which was used.
    regulator : {"descent", "lqr"}
        Gains of the projection: those of the descent direction's own linear-quadratic problem, which
        cost nothing more, or an LQR with identities as weights (dissertation 6.3.1).
    max_iterations : int
        Limit on the iterations of this run.
    tolerance, absolute_tolerance : float
        Stop when the expected decrease ``-Dg . dxi`` is at most
        ``tolerance * |cost| + absolute_tolerance``.
    alpha, beta : float
        Armijo's: fraction of the linear decrease that is asked for, and factor between trial steps.
    max_backtracks : int
        Shorter steps tried along one direction.
    chunk : int
        Time steps simulated between two looks at the cost of a trial.
    callback : callable, optional
        Called with an `IterationRecord` after every iteration, and once with the initial trajectory;
        a true answer stops the optimisation. `IterationTable` is one.

    Returns
    -------
    OptimizationResult
        Frozen; `status` says how it ended. Ctrl-C gives the last iterate.

    Raises
    ------
    ArgumentError
        Settings, shapes or values that are wrong, or an initial curve that cannot be projected.
    """
    settings = _check_settings(
        system,
        method=method,
        regulator=regulator,
        max_iterations=max_iterations,
        tolerance=tolerance,
        absolute_tolerance=absolute_tolerance,
        alpha=alpha,
        beta=beta,
        max_backtracks=max_backtracks,
        chunk=chunk,
    )
    cost.check_shapes(system.N, system.nx, system.nu)
    if (initial is None) == (resume is None):
        raise ArgumentError(
            f"initial, resume: got {'neither' if initial is None else 'both'}, expected one of them."
        )
    run = _Run(system, cost, settings, callback)
    if resume is not None:
        run.resume(resume)
    elif initial is not None:
        run.start(*initial)
    return run.iterate()


class _Run:
    """One call of `optimize`: its buffers, its current iterate and its history."""

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Settings,
        callback: Callback | None,
    ) -> None:
        self.system = system
        self.cost = cost
        self.settings = settings
        self.callback = callback
        self.line_search = LineSearch(settings.alpha, settings.beta, settings.chunk)
        self.began = time.perf_counter()
        self.timings = dict.fromkeys(("linearize", "curvature", "lq", "rollout"), 0.0)
        self.history = HistoryBuilder()
        self.limit = settings.max_iterations
        self.rollouts = 0
        self.schedule = NewtonSchedule()

        # The current iterate, its cost, and the gains of the projection that led to it.
        self.x: Floats
        self.u: Floats
        self.value: float
        self.gain: Floats
        # What was computed along it; None: not yet.
        self.linearization: Linearization | None = None
        self.curvature: Floats | None = None
        self.quasi_newton: LinearQuadraticSolution | None = None
        self.feedback: Floats | None = None

        # Memory that is used again. The gains of the last projection (in `held`) outlive the next
        # linear-quadratic problem (solved in `free`), because the adjoint needs them.
        sizes = (system.N, system.nx, system.nu)
        self.free, self.held = Workspace(*sizes), Workspace(*sizes)
        self.lqr = Workspace(*sizes) if settings.regulator == "lqr" else None
        self.old_linearization: Linearization | None = None
        self.old_curvature: Floats | None = None

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, x: ArrayLike, u: ArrayLike) -> None:
        """Begin with a trajectory, a curve to be projected, or an initial state and inputs."""
        N, nx, nu = self.system.N, self.system.nx, self.system.nu
        u = as_floats("initial u", u, (N, nu), what="(N, nu)")
        x = as_floats(
            "initial x", x, (N + 1, nx), (nx,), what="(N+1, nx) or an initial state (nx,)"
        )
        if x.ndim == 1:
            x = self._project(np.tile(x, (N + 1, 1)), u, np.zeros((N, nu, nx))).x
        self.x, self.u = x, u
        self.quasi_newton = self._solve("quasi-newton", self.held)
        self.gain = self.quasi_newton.K
        if not self.quasi_newton.definite:
            self.gain = regulate(*self._linearize())
        projected = self._project(x, u, self.gain)
        # A trajectory is its own projection; then what was computed along it stays valid.
        if float(np.abs(projected.x - x).max()) > 1e-8 * (1.0 + float(np.abs(x).max())):
            self.x, self.u = projected.x, projected.u
            self._forget()
        self.value = self.cost.value(self.x, self.u)
        if not np.isfinite(self.value):
            raise ArgumentError(
                f"initial: the cost of the initial trajectory is {self.value}, expected a finite "
                "number. Look at the cost's weights and wanted motion."
            )

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        N, nx, nu = self.system.N, self.system.nx, self.system.nu
        self.x = as_floats("resume.x", result.x, (N + 1, nx), what="(N+1, nx)")
        self.u = as_floats("resume.u", result.u, (N, nu), what="(N, nu)")
        self.gain = as_floats(
            "resume.projection_gain", result.projection_gain, (N, nu, nx), what="(N, nu, nx)"
        )
        self.value = self.cost.value(self.x, self.u)
        self.schedule = result.schedule
        self.history = HistoryBuilder(result.history)
        self.limit += result.iterations

    def _project(self, xbar: Floats, ubar: Floats, gain: Floats) -> Rollout:
        with self._clock("rollout"):
            rollout = self.system.rollout(xbar[0], xbar, ubar, gain, 0, self.system.N)
        self.rollouts += 1
        if not rollout.complete:
            raise ArgumentError(
                f"initial: the roll-out failed after {rollout.steps_done} of {self.system.N} steps: "
                f"{rollout.failure}. Give a trajectory of the system (such as one it simulated), or "
                "a curve that stays closer to one."
            )
        return rollout

    # ---- The loop -------------------------------------------------------------------------------

    def iterate(self) -> OptimizationResult:
        """Run until there is a reason to stop."""
        try:
            outcome = None
            if not self.history.cost:
                outcome = self._tell("start", None, None, "")
            while outcome is None:
                outcome = self._advance()
        except KeyboardInterrupt:
            # A solution may have been left half written; none of it belongs to the iterate.
            self._forget()
            outcome = _Outcome(Status.INTERRUPTED)
        return self._finish(outcome)

    def _advance(self) -> _Outcome | None:
        """Make one iteration; the outcome if it was the last."""
        note = ""
        expected = np.nan
        for method in self._methods():
            try:
                direction = self._direction(method)
            except LeastActionError as error:
                return _Outcome(Status.DERIVATIVES_FAILED, str(error))
            if isinstance(direction, str):
                note = f"{method}: {direction}"
                self._note_failure(method)
                continue
            expected = -direction.slope
            goal = self.settings.tolerance * abs(self.value) + self.settings.absolute_tolerance
            if expected <= goal:
                return _Outcome(Status.CONVERGED, expected=expected)
            if self.history.iterations >= self.limit:
                return _Outcome(Status.ITERATION_LIMIT, expected=expected)
            step = self._search(direction)
            self.rollouts += step.rollouts
            if step.length > 0.0:
                return self._accept(direction, step, note)
            note = f"{direction.method}: no step was short enough, {step.failure}"
            self._note_failure(method)
        if np.isnan(expected):
            return _Outcome(Status.NO_DIRECTION, note)
        status = Status.STALLED if expected < 1e-10 * abs(self.value) else Status.LINE_SEARCH_FAILED
        return _Outcome(status, note, expected)

    def _note_failure(self, method: str) -> None:
        if method == "newton":
            self.schedule = self.schedule.after_failure()

    def _methods(self) -> tuple[str, ...]:
        """Return the methods for this iteration: each replaces the one before if that fails."""
        first = self.settings.method
        if first == "auto":
            newton = self.system.has_curvature and self.schedule.wait == 0
            first = "newton" if newton else "quasi-newton"
        return _CHAIN[_CHAIN.index(first) :]

    def _accept(self, direction: Direction, step: Step, note: str) -> _Outcome | None:
        decrease = self.value - step.cost
        stalled = decrease <= rounding_of(self.value)
        agreement = decrease / (-0.5 * direction.slope)
        self.schedule = self.schedule.after_step(direction.curvature_scale, agreement)
        self.x, self.u, self.value, self.gain = step.x, step.u, step.cost, direction.gain
        if direction.gain is self.free.K:
            self.free, self.held = self.held, self.free
        self._forget()
        outcome = self._tell(direction.method, direction, step, note)
        return outcome or (_Outcome(Status.STALLED, expected=-direction.slope) if stalled else None)

    def _search(self, direction: Direction) -> Step:
        backtracks = self.settings.max_backtracks
        if direction.method.startswith("newton"):
            # A simpler method takes over, so very short steps are not worth their roll-outs.
            backtracks = min(backtracks, 4)
        with self._clock("rollout"):
            return self.line_search(
                self.system, self.cost, self.x, self.u, self.value, direction, backtracks
            )

    # ---- Directions -----------------------------------------------------------------------------

    def _direction(self, method: str) -> Direction | str:
        """Return the direction of a method, or why there is none."""
        own_gain = self._lqr_gain()
        if method == "quasi-newton" and self.quasi_newton is not None:
            solution, scale = self.quasi_newton, 0.0
        else:
            solution, scale = self._solve_damped(method)
        if not solution.definite:
            return f"the model has no minimum, {solution.message}"
        # With dx_0 = 0 the model's minimum is half of its linear part.
        slope = 2.0 * solution.constant
        self.feedback = solution.K if own_gain is None else own_gain
        name = f"{method}-damped" if 0.0 < scale < 1.0 else method
        dx = du = None
        if own_gain is not None:
            dx, du = sweep_forward(*self._linearize(), solution)
        return Direction(name, self.feedback, slope, scale, solution.C, dx, du)

    def _solve_damped(self, method: str) -> tuple[LinearQuadraticSolution, float]:
        """Solve a method's model, with as much of the curvature as leaves it a minimum."""
        if method != "newton":
            return self._solve(method, self.free), 0.0
        scale = self.schedule.scale
        solution = self._solve(method, self.free, scale)
        while not solution.definite and scale > _LEAST_CURVATURE:
            scale *= 0.5
            solution = self._solve(method, self.free, scale)
        return solution, scale

    def _solve(
        self, method: str, workspace: Workspace, scale: float = 1.0
    ) -> LinearQuadraticSolution:
        gradient = self.cost.gradient(self.x, self.u)
        hessian = self.cost.hessian(self.x, self.u)
        linearization = self._linearize()
        curvature = self._curvature_along(gradient) if method == "newton" else None
        with self._clock("lq"):
            return minimise_model(
                method, linearization, gradient, hessian, curvature, workspace, scale
            )

    def _linearize(self) -> Linearization:
        if self.linearization is None:
            with self._clock("linearize"):
                self.linearization = self.system.linearize(self.x, self.u, self.old_linearization)
            self.old_linearization = self.linearization
        return self.linearization

    def _curvature_along(self, gradient: CostGradient) -> Floats:
        if self.curvature is None:
            with self._clock("lq"):
                z = adjoint(*self._linearize(), self.gain, *gradient)
            with self._clock("curvature"):
                self.curvature = self.system.curvatures(self.x, self.u, z, self.old_curvature)
            self.old_curvature = self.curvature
        return self.curvature

    def _lqr_gain(self) -> Floats | None:
        """Return the projection's own gains about the current iterate, if it has any."""
        if self.lqr is None:
            return None
        if self.feedback is None:
            with self._clock("lq"):
                self.gain = regulate(*self._linearize(), workspace=self.lqr)
        return self.gain

    def _forget(self) -> None:
        self.linearization = self.curvature = self.quasi_newton = self.feedback = None

    # ---- Telling and finishing ------------------------------------------------------------------

    def _tell(
        self, method: str, direction: Direction | None, step: Step | None, note: str
    ) -> _Outcome | None:
        record = IterationRecord(
            iteration=self.history.iterations + (step is not None),
            method=method,
            cost=self.value,
            expected_decrease=np.nan if direction is None else -direction.slope,
            step_length=np.nan if step is None else step.length,
            rollouts=self.rollouts if step is None else step.rollouts,
            curvature_scale=0.0 if direction is None else direction.curvature_scale,
            note=note,
            seconds=time.perf_counter() - self.began,
            x=self.x,
            u=self.u,
        )
        self.history.add(record)
        if self.callback is not None and self.callback(record):
            return _Outcome(Status.STOPPED_BY_CALLBACK)
        return None

    def _finish(self, outcome: _Outcome) -> OptimizationResult:
        feedback = self.feedback
        if feedback is None:
            feedback = self._final_feedback()
        self.timings["total"] = time.perf_counter() - self.began
        return OptimizationResult(
            status=outcome.status,
            message=f"{outcome.status.value} {outcome.detail}".strip(),
            x=self.x,
            u=self.u,
            K=feedback,
            cost=self.value,
            expected_decrease=outcome.expected,
            history=self.history.build(),
            timings=MappingProxyType(dict(self.timings)),
            rollouts=self.rollouts,
            settings=self.settings,
            projection_gain=self.gain,
            schedule=self.schedule,
        )

    def _final_feedback(self) -> Floats:
        """Return gains about the last iterate, for a run that ended before it had any."""
        try:
            solution = self._solve("quasi-newton", self.free)
            return solution.K if solution.definite else regulate(*self._linearize())
        except LeastActionError:
            return self.gain

    @contextmanager
    def _clock(self, part: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self.timings[part] += time.perf_counter() - began


@dataclass(frozen=True)
class _Outcome:
    status: Status
    detail: str = ""
    expected: float = np.nan


def _check_settings(
    system: DiscreteSystem,
    *,
    method: str,
    regulator: str,
    max_iterations: int,
    tolerance: float,
    absolute_tolerance: float,
    alpha: float,
    beta: float,
    max_backtracks: int,
    chunk: int,
) -> Settings:
    for name, value, allowed in (("method", method, METHODS), ("regulator", regulator, REGULATORS)):
        if value not in allowed:
            raise ArgumentError(f"{name}: got {value!r}, expected one of {', '.join(allowed)}.")
    if method == "newton" and not system.has_curvature:
        raise ArgumentError(
            f"method: got 'newton', but {type(system).__name__} has no second derivative. Give it a "
            "`curvature`, or use 'auto' or 'quasi-newton'."
        )
    return Settings(
        method=method,
        regulator=regulator,
        max_iterations=as_count("max_iterations", max_iterations, minimum=0),
        tolerance=as_number("tolerance", tolerance, above=-1e-300),
        absolute_tolerance=as_number("absolute_tolerance", absolute_tolerance, above=-1e-300),
        alpha=as_number("alpha", alpha, above=0.0, below=0.5),
        beta=as_number("beta", beta, above=0.0, below=1.0),
        max_backtracks=as_count("max_backtracks", max_backtracks, minimum=0),
        chunk=as_count("chunk", chunk, minimum=1),
    )
