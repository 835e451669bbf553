"""A discrete system and its cost, as the optimiser's loop sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError, StepError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.descent import escape, minimise_model
from leastaction.optimal.discrete.direction import DiscreteDirection, Iterate
from leastaction.optimal.discrete.hessians import ModelHessian, between, same, shifted
from leastaction.optimal.discrete.linear_quadratic import (
    Law,
    LinearQuadraticSolution,
    Workspace,
    adjoint,
    regulate,
    sweep_forward,
)
from leastaction.optimal.discrete.own_projection import own_projection
from leastaction.optimal.discrete.projection import linearize_along_curve
from leastaction.optimal.discrete.system import DiscreteSystem, Rollout, given_start, linearized, told_of
from leastaction.optimal.discrete.trial import SHORT, leap, try_projection
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Problem
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.space import apart, sizes_of
from leastaction.optimal.system import Linearization

# Factor in cost over that of its inputs alone by which a projection has lost a curve.
_DEAR = 10.0

# Second derivative by the initial state, in parts of the largest, that counts as none: little more than rounding, since
# a limit that is active in the end is stiffer than all else by ten orders of magnitude.
_FLAT = 1e-14


class DiscreteProblem(Problem[LinearQuadraticSolution, DiscreteDirection, Iterate]):
    """The current trajectory of a discrete system, and what was computed along it."""

    def __init__(
        self, system: DiscreteSystem, cost: Cost, settings: Options, free_start: bool | Sequence[str] = False
    ) -> None:
        super().__init__()
        self.system, self.space = system, system.charts()
        self.free_start = free_start
        self.cost = cost
        self.has_curvature = self.tells_saddles = system.has_curvature
        self.chunk = settings.chunk

        # The current iterate, and the gains of the projection that led to it.
        self.x: Array
        self.u: Array
        self.gain: Array
        # What was computed along it; None: not yet.
        self.linearization: Linearization | None = None
        self.exact: ModelHessian | None = None
        self.convex: ModelHessian | None = None
        self.curvature: Array | None = None
        self.quasi_newton: LinearQuadraticSolution | None = None
        self.feedback: Array | None = None
        self.start_directions: Array | None = None
        self._flat: list[str] = []  # unknown numbers of which the last model says nothing

        # Memory that is used again. The gains of the last projection (in `held`) outlive the next
        # linear-quadratic problem (solved in `free`), because the adjoint needs them.
        sizes = (system.N, system.ndx, system.nu)
        self.free, self.held = Workspace(*sizes), Workspace(*sizes)
        self.own_projection = own_projection(settings, system)
        self.lqr = None if self.own_projection is None else Workspace(*sizes)
        self.old_linearization: Linearization | None = None

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: tuple[ArrayLike, ArrayLike]) -> None:
        x, self.u = given_start(self.system, initial)
        N, ndx, nu = self.system.N, self.system.ndx, self.system.nu
        made: Rollout | None = None
        if x.ndim == 1:
            made = self._project(np.tile(x, (N + 1, 1)), self.u, np.zeros((N, nu, ndx)))
            x = made.x
        self.x = read_only(x)
        self._project_curve(made)
        self.value = self.cost.value(self.x, self.u)
        if not np.isfinite(self.value):
            raise ProjectionError(
                f"initial: the cost of the initial trajectory is {self.value}, expected a finite "
                "number. Look at the cost's weights and wanted motion."
            )

    def _project_curve(self, made: Rollout | None = None) -> None:
        """Put a trajectory in the place of the curve where the iterate is to be.

        A trajectory is its own projection, and what was computed along it stays valid. Of a curve that is none, the
        gains of the cost's regulator may lead far away or nowhere: then the cheapest of several projections is taken.
        ``made``: the roll-out that the curve is, if it is known to be one.
        """
        x, u = self.x, self.u
        N, ndx, nu = self.system.N, self.system.ndx, self.system.nu
        found: list[tuple[float, Rollout, Array]] = []
        failure = ""

        def follow(choose: Callable[[], Array]) -> None:
            nonlocal failure
            try:
                gain = choose()
                projected = made or self._project(x, u, gain)
            except LeastActionError as error:
                failure = str(error)
                return
            with np.errstate(over="ignore", invalid="ignore"):
                value = self.cost.value(projected.x, projected.u)
            found.append((value if np.isfinite(value) else np.inf, projected, gain))

        def regulator() -> Array:
            if self.own_projection is not None and self.own_projection.is_users:
                return self.own_projection.gains(linearize_along_curve(self.system, x, u), Workspace(N, ndx, nu))
            self.quasi_newton = self._solve("quasi-newton", self.held)
            return self.quasi_newton.K if self.quasi_newton.definite else regulate(*self._linearize())

        follow(regulator)
        off = float(np.abs(apart(self.space, found[0][1].x, x)).max()) if found else np.inf
        if off <= 1e-8 * (1.0 + float(np.abs(x).max())):
            self.gain, self.worst_step = found[0][2], found[0][1].worst_step
            return
        self.forget()
        follow(lambda: np.zeros((N, nu, ndx)))
        if not found or found[0][0] > _DEAR * found[-1][0]:
            # The regulator above may not even exist where the curve's next states are no ends of steps.
            along = linearize_along_curve(self.system, x, u)
            Q, R, _, Q_final = self.cost.convex_hessian(x, u)
            follow(lambda: regulate(*along, Q=Q, R=R, Q_final=Q_final))
            follow(lambda: regulate(*along))
        elif found:
            del found[1:]
        if not found:
            raise ProjectionError(f"initial: {failure.removeprefix('initial: ')}")
        _, projected, self.gain = min(found, key=lambda each: each[0])
        self.x, self.u = read_only(projected.x), read_only(projected.u)
        self.worst_step = projected.worst_step

    def resume(self, result: OptimizationResult) -> None:
        N, nx, ndx, nu = self.system.N, self.system.nx, self.system.ndx, self.system.nu
        if result.gap > 0.0:
            raise ArgumentError(
                f"resume: got a result with open gaps (of {result.gap:.2g}), expected a trajectory: give "
                "shooting='multiple', or initial=(result.x, result.u), which is projected"
            )
        self.x = read_only(as_array(result.x, "resume.x", (N + 1, nx), meaning="(N+1, nx)"))
        self.u = read_only(as_array(result.u, "resume.u", (N, nu), meaning="(N, nu)"))
        self.gain = as_array(result.projection_gain, "resume.projection_gain", (N, nu, ndx), meaning="(N, nu, nx)")
        self.value = self.cost.value(self.x, self.u)
        self.worst_step = result.worst_step

    def _project(self, xbar: Array, ubar: Array, gain: Array) -> Rollout:
        with self.clock("rollout"):
            rollout = self.system.rollout(xbar[0], xbar, ubar, gain, 0, self.system.N)
        self.rollouts += 1
        if not rollout.complete:
            raise ProjectionError(
                f"initial: the roll-out failed after {rollout.steps_done} of {self.system.N} steps: "
                f"{self._why(rollout, xbar, ubar, gain)}. Give a trajectory of the system (such as one it simulated), "
                "or a curve that stays closer to one."
            )
        return rollout

    def _why(self, rollout: Rollout, xbar: Array, ubar: Array, gain: Array) -> str | None:
        """Return why a roll-out ended, in the words of the step if it has some: it looks closer than a roll-out."""
        k = rollout.steps_done
        x = rollout.x[k]
        try:
            self.system.f(x, ubar[k] - gain[k] @ self.system.difference(x, xbar[k]), k)
        except StepError as error:
            return str(error).removesuffix(".")
        except ArithmeticError:  # told by the roll-out already
            pass
        return rollout.failure

    # ---- Directions -----------------------------------------------------------------------------

    def minimise_model(self, method: str, scale: float, shift: float = 0.0) -> LinearQuadraticSolution:
        self._own_gain()
        if method == "quasi-newton" and shift == 0.0 and self.quasi_newton is not None:
            return self._with_start(self.quasi_newton, lambda: self._hessian(0.0))
        model = self._solve(method, self.free, scale, shift)
        return self._with_start(model, lambda: self._hessian(scale if method == "newton" else 0.0))

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        own_gain = self._own_gain()
        dx = du = None
        dx0 = self._start_step(model)
        if own_gain is not None:
            dx, du = self._sweep(model, dx0)
        self.feedback = model.K if own_gain is None else own_gain
        # The model's minimum is half of its linear part.
        slope = 2.0 * least_of(model, dx0)
        return DiscreteDirection(method, slope, scale, shift, gain=self.feedback, C=model.C, dx=dx, du=du, dx0=dx0)

    def _sweep(self, law: Law, dx0: Array | None, *, gaps: Array | None = None) -> tuple[Array, Array]:
        """Return the motion of the linear dynamics under a law, which closes gaps."""
        linearization = self._linearize()
        A, B = linearization
        return sweep_forward(A, B, law, dx0, c=gaps, pattern=linearization.pattern)

    def motion(self, direction: DiscreteDirection) -> tuple[Array, Array]:
        """Return the changes of states and inputs along a direction."""
        if direction.dx is None or direction.du is None:
            return self._sweep(direction, direction.dx0)
        return direction.dx, direction.du

    def _directions_of_start(self) -> Array:
        """Return the directions (ndx, n) in which the initial state may move."""
        if self.start_directions is None:
            free = None if isinstance(self.free_start, bool) else self.free_start
            self.start_directions = self.system.start_directions(self.x[0], free)
        return self.start_directions

    def _start_step(self, model: LinearQuadraticSolution) -> Array | None:
        """Return the change of the initial state at the model's minimum (dissertation 6.3.2.1); None if it is fixed."""
        if self.free_start is False:
            return None
        from scipy.linalg.lapack import dposv  # slow to import, and not needed by most

        Z = self._directions_of_start()
        if not Z.size:
            return np.zeros(len(Z))
        _, step, _ = dposv(Z.T @ model.P0 @ Z, Z.T @ model.b[0])
        return np.asarray(-Z @ step)

    def _with_start(
        self, model: LinearQuadraticSolution, hessian: Callable[[], ModelHessian]
    ) -> LinearQuadraticSolution:
        """Return the model, without a minimum if it has none over the initial state.

        ``hessian``: gives the model's weights, which are asked for where it may have none.
        """
        self._flat = []
        if self.free_start is False or not model.definite:
            return model
        Z = self._directions_of_start()
        bend = Z.T @ model.P0 @ Z
        if not len(bend):
            return model
        little = _FLAT * float(np.abs(bend).max())
        if _is_definite(bend, little):
            return model
        # What a limit at the start itself weighs is added last, so no rounding of the rest is as large as that.
        little = _FLAT * float(np.abs(bend - Z.T @ hessian().of_first_state @ Z).max())
        if _is_definite(bend, little):
            return model
        values, vectors = np.linalg.eigh(bend)
        least = float(values[0])
        if least >= -little:
            self._flat = self.system.unknowns_along(np.abs(Z @ vectors[:, values <= little]).max(axis=1))
        message = f"P is not positive definite over the free initial state (smallest eigenvalue {least:.3g})."
        return replace(model, definite=False, stage=0, message=message)

    @property
    def undetermined(self) -> str:
        if not self._flat:
            return ""
        names = " and ".join(repr(name) for name in self._flat)
        return (
            f"The cost does not depend on {names} along this motion, neither to first nor to second order, so that "
            "cannot be found. Start from a motion on which it has an effect, give it a price or a `weight` (what is "
            "known of it), or leave it out of the unknowns."
        )

    def negative_curvature(self, scale: float) -> DiscreteDirection | None:
        """Return a direction of negative curvature, where the undamped Newton model has one."""
        gradient = self._gradient()
        found = escape(
            self._linearize(),
            gradient,
            self._hessian,
            self._curvature_along(gradient),
            self.free,
            scale,
        )
        if found is None:
            return None
        dx, du, slope, bend = found
        # A step that is expected to lower the cost by a tenth, but goes no further than a model may hold.
        length = np.sqrt(0.2 * abs(self.value) / -bend)
        reach = np.abs(dx).max(axis=0) / sizes_of(self.space, self.x)
        length = min(length, 0.3 / float(reach.max()))
        return DiscreteDirection(
            "negative-curvature",
            length * slope,
            1.0,
            bend=length**2 * bend,
            gain=self.gain,  # with which the curvature was computed
            C=du,
            dx=length * dx,
            du=length * du,
        )

    def _solve(
        self, method: str, workspace: Workspace, scale: float = 0.0, shift: float = 0.0
    ) -> LinearQuadraticSolution:
        gradient = self._gradient()
        hessian = self._hessian(scale if method == "newton" else 0.0)
        if shift > 0.0:
            hessian = shifted(hessian, shift)
        linearization = self._linearize()
        curvature = self._curvature_along(gradient) if method == "newton" else None
        with self.clock("lq"):
            return minimise_model(method, linearization, gradient, hessian, curvature, workspace, scale)

    def _gradient(self) -> CostGradient:
        """Return the first derivatives of what is minimised."""
        return self.cost.gradient(self.x, self.u)

    def _hessian(self, share: float = 1.0) -> ModelHessian:
        """Return the second derivatives of what is minimised, without the dynamics' part.

        Of what bends downwards only a share is in it, as of the curvature of the dynamics.
        """
        if self.exact is None:
            self.exact = self._second_derivatives(convex=False)
        if share == 1.0:
            return self.exact
        if self.convex is None:
            self.convex = self._second_derivatives(convex=True)
        return between(self.convex, self.exact, share)

    def _second_derivatives(self, *, convex: bool) -> ModelHessian:
        """Return them with all of what bends downwards, or with none."""
        found = self.cost.model_hessian(self.x, self.u, convex=convex)
        return self.exact if convex and self.exact is not None and same(found, self.exact) else found

    def _linearize(self) -> Linearization:
        if self.linearization is None:
            with self.clock("linearize"):
                self.linearization = linearized(self.system, self.x, self.u, self.old_linearization)
            self.old_linearization = self.linearization
        return self.linearization

    def _curvature_along(self, gradient: CostGradient) -> Array:
        if self.curvature is None:
            linearization = self._linearize()
            with self.clock("lq"):
                A, B = linearization
                z = adjoint(A, B, self.gain, *gradient, pattern=linearization.pattern)
            with self.clock("curvature"):
                self.curvature = linearization.packed_curvature(z)
        return self.curvature

    def _own_gain(self) -> Array | None:
        """Return the projection's own gains about the current iterate, if it has any."""
        if self.own_projection is None or self.lqr is None:
            return None
        if self.feedback is None:
            with self.clock("lq"):
                self.gain = self.feedback = self.own_projection.gains(self._linearize(), self.lqr)
        return self.gain

    def forget(self) -> None:
        self.linearization = self.start_directions = None
        self._forget_cost()

    def _forget_cost(self) -> None:
        """Forget what the cost had a part in."""
        self.exact = self.convex = self.curvature = self.quasi_newton = self.feedback = None

    # ---- Steps ----------------------------------------------------------------------------------

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Iterate] | Refusal:
        xbar, ubar = direction.curve(self.space, self.x, self.u, length)
        x0 = xbar[0]
        if direction.dx0 is not None:
            try:
                x0 = self.system.moved_start(self.x[0], length * direction.dx0)
            except LeastActionError as error:
                return Refusal(f"the initial state cannot move so far: {error}", 0, failed=True)
        return try_projection(
            self.system,
            self.cost,
            (xbar, ubar, direction.gain),
            x0,
            bound=bound,
            worst=self.worst_step,
            chunk=self.chunk,
            explain=lambda x, refusal: self._look_for_leap(direction, length, x, refusal),
        )

    def _look_for_leap(self, direction: DiscreteDirection, length: float, x: Array, refusal: Refusal) -> Refusal:
        """Return the refusal of a trial, the better explained if one step of time leapt to another solution.

        ``x``: its states, up to where it ended.
        """
        if length > SHORT and direction.shift == 0.0:
            return refusal
        dx = direction.dx
        if dx is None:
            dx = self._sweep(direction, direction.dx0)[0]
        leapt = leap(self.system, self.x, length * dx, x, length)
        return refusal if leapt is None else replace(leapt, coarsest=refusal.coarsest)

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        x, u, self.worst_step = trial.iterate
        self.x, self.u = read_only(x), read_only(u)
        self.value, self.gain = trial.cost, direction.gain
        if direction.gain is self.free.K:
            self.free, self.held = self.held, self.free
        self.forget()

    def where(self, direction: DiscreteDirection) -> str:
        A, B = self._linearize()
        gradient = self._gradient()
        z = adjoint(A, B, direction.gain, *gradient)
        feedforward = -direction.C
        if direction.dx is not None and direction.du is not None:
            feedforward = direction.du + np.einsum("kux,kx->ku", direction.gain, direction.dx[:-1])
        # By the gains of the direction, its slope is that of the feedforward alone.
        shares = feedforward * (gradient.r + np.einsum("kxu,kx->ku", B, z[1:]))
        k, i = np.unravel_index(np.argmin(shares), shares.shape)
        return f"{self.system.input_name(int(i))!r} around {self.system.when(int(k))}"

    def keep_feedback(self, direction: DiscreteDirection) -> None:
        self.feedback = direction.gain

    # ---- What is told ---------------------------------------------------------------------------

    def arrays(self) -> tuple[Array, Array]:
        return self.x, self.u

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        feedback = self.feedback
        if feedback is None:
            feedback = self._final_feedback()
        return OptimizationResult(
            x=self.x, u=self.u, K=feedback, projection_gain=self.gain, **summary, **told_of(self.system)
        )

    def _final_feedback(self) -> Array:
        """Return gains about the last iterate, for a run that ended before it had any."""
        try:
            solution = self._solve("quasi-newton", self.free)
            return solution.K if solution.definite else regulate(*self._linearize())
        except LeastActionError:
            return self.gain


def least_of(model: LinearQuadraticSolution, dx0: Array | None) -> float:
    """Return the value of a model at its minimum: that for ``dx_0 = 0``, and what its dx_0 adds, where that is free."""
    return model.constant if dx0 is None else model.constant + 0.5 * float(model.b[0] @ dx0)


def _is_definite(matrix: Array, least: float) -> bool:
    """Whether all eigenvalues of a symmetric matrix are larger than some number."""
    from scipy.linalg.lapack import dpotrf  # slow to import, and not needed by most

    lowered = matrix.copy()
    lowered.flat[:: len(matrix) + 1] -= least
    return int(dpotrf(lowered)[1]) == 0
