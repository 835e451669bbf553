"""Multiple shooting: a start whose steps need not meet, and iterates between which the gaps close.

Where no trajectory is known, or where the projection of a curve leads far away (unstable motions, long horizons), the
states themselves are unknowns. A curve (x, u) has the gaps ``d_k = f(x_k, u_k) - x_{k+1}``; the linear-quadratic
problem along it takes them as the drift of ``dx+ = A dx + B du + d``, so that a step of length a leaves ``(1 - a) d``
of them but for the dynamics' curvature, which is weighed with the problem's costates ``P dx + b``, the multipliers of
the dynamics (H. G. Bock and K. J. Plitt, A multiple shooting algorithm, 1984). No step is rolled out: what the motion
after it would amplify opens a gap instead.

How far to go is told by a filter (`gap_filter`). Where a full step opens gaps by the curvature of the dynamics, another
one closes these before it is refused.

Once the gaps are closed, the curve is projected onto a trajectory, and the iteration goes on over trajectories: it is
there that a minimum is certified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import changed
from leastaction.optimal.discrete.charts import read_at
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.descent import minimise_model
from leastaction.optimal.discrete.direction import AmongCurves, DiscreteDirection, Iterate
from leastaction.optimal.discrete.gap_filter import Filter, OpenCurve
from leastaction.optimal.discrete.hessians import shifted
from leastaction.optimal.discrete.linear_quadratic import (
    Feedforward,
    LinearQuadraticSolution,
    Workspace,
    feedforward_of_drift,
)
from leastaction.optimal.discrete.problem import DiscreteProblem, least_of
from leastaction.optimal.discrete.system import DiscreteSystem, given_start
from leastaction.optimal.discrete.trial import is_too_coarse
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.memory import Gaps, Memory, Place, Start
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.space import apart, moved_by, sizes_of
from leastaction.optimal.system import Linearization

Gapped = Literal["never", "where needed", "where lost", "at once"]
"""When steps may have gaps: never; where the start cannot be projected, or the loop asks for them; where its projection
would leave it; from the start."""

# Gap, in parts of the states' sizes, below which it is closed after a full step; iterations with gaps at the most; and
# those where they take the place of a search that was stuck.
_CLOSED, _LONGEST, _LONGEST_INSTEAD = 1e-6, 300, 100

# Distance, in parts of the states' sizes, by which the projection of a curve has left it.
_LEFT_BEHIND = 0.1

# Factor in cost by which a projection has lost a curve, and iterations after which a search from there is a long one.
_DEAR, _LONG_IF_LOST = 10.0, 100

# Part of the cost that is left to be gained where a stage with gaps is over.
_LOOSE = 1e-6

# Further steps that close the gaps which a full step opens, and the part of them that each may leave.
_CORRECTIONS, _LEFT = 4, 0.99


class ShootingProblem(DiscreteProblem):
    """A discrete system and its cost, begun with a curve whose gaps close on the way.

    ``gapped``: when steps may have gaps. ``open_curve``: the iterate; None where it is a trajectory, when all is as
    without.
    """

    # Whether gaps that begin later begin at the initial state, held still, where that alone was given.
    holds_state = False

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Options,
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
    ) -> None:
        super().__init__(system, cost, settings, free_start)
        self.gapped: Gapped = gapped
        self.open_curve: OpenCurve | None = None
        # The start, until gaps were tried from there.
        self.given: Start | None = None
        self.first: Start | None = None  # the trajectory that it began with
        self.size: Array
        self.costates: Array | None = None
        self.penalty = 0.0  # of the gaps, in the cost that the loop is told
        self.filter = Filter(1.0)
        self.longest = _LONGEST  # iterations with gaps
        self.earlier: Place | None = None  # where it stood before it began again
        self.spare = Workspace(system.N, system.ndx, system.nu)

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: tuple[ArrayLike, ArrayLike]) -> None:
        """Begin with a curve, or an initial state and inputs; by projection where a step of it cannot be made.

        If not at once, it is the other way round.
        """
        if self.gapped == "never":
            super().start(initial)
            return
        x, u = given_start(self.system, initial)
        self.given = Start(x, u)
        failure: ProjectionError | None = None
        if self.gapped != "at once":
            try:
                super().start((x, u))
                if not (self.gapped == "where lost" and self._has_left(x)):
                    lost = x.ndim == 2 and self.value > _DEAR * self.cost.value(x, u)
                    self.given = replace(self.given, is_lost=lost)
                    return
            except ProjectionError as error:
                failure = error
            self.forget()
        refusal = self._open(self.given)
        if refusal is not None:
            if failure is not None:
                raise failure
            self.note = f"projected at once, as {refusal.reason}"
            super().start((x, u))
        elif failure is not None:
            self.note = f"begins with gaps between its steps, as a projection is not possible ({failure})"

    def _has_left(self, x: Array) -> bool:
        """Whether the projection of a start has left the curve that it is."""
        if x.ndim == 1:
            return False
        return bool((np.abs(apart(self.space, self.x, x)).max(axis=0) > _LEFT_BEHIND * sizes_of(self.space, x)).any())

    def begin_with_gaps(self, *, brief: bool) -> bool:  # noqa: ARG002
        """Begin again with gaps between the steps, and return whether that can be done.

        If `brief`, they have to close soon: there are other ways.
        """
        if self.is_open or self.given is None:
            return False
        now, value = self.place(), self.value
        try:
            refused = self._open(self.given, still=self.holds_state) is not None
        except BaseException as error:  # an interruption too leaves it where it stood
            self.open_curve = None
            self.x, self.u, self.gain, self.worst_step, self.value = now.x, now.u, now.gain, now.worst_step, value
            if not isinstance(error, LeastActionError):
                raise
            refused = True
        if refused:
            self.given = None
            return False
        self.earlier = now
        self.forget()
        self.longest = _LONGEST_INSTEAD
        return True

    def _open(self, start: Start, *, still: bool = False) -> Refusal | None:
        """Stand at a curve with its gaps, or return why that is not possible.

        ``still``: whether an initial state alone is held, and not the motion that it leads to.
        """
        N, ndx, nu = self.system.N, self.system.ndx, self.system.nu
        x, u = start.x, start.u
        if x.ndim == 1 and still:
            x = np.tile(x, (N + 1, 1))
        elif x.ndim == 1:
            run = self.system.rollout(x, np.tile(x, (N + 1, 1)), u, np.zeros((N, nu, ndx)), 0, N)
            self.rollouts += 1
            # What leads to a step that cannot be made is too violent to begin with: it stands still instead.
            x = run.x if run.complete else np.tile(x, (N + 1, 1))
        self.size = sizes_of(self.space, x)
        curve = self._evaluate(x, u)
        if isinstance(curve, Refusal):
            return curve
        self.filter, self.penalty, self.costates = Filter(curve.theta), 0.0, None
        self.gain = np.zeros((N, nu, ndx))
        self.tells_saddles = False
        self._take(curve)
        return None

    def resume(self, result: OptimizationResult) -> None:
        memory = result.memory
        if self.gapped == "never" or memory is None or memory.gaps is None:
            super().resume(result)
            if memory is not None:
                self.recall(memory)
            return
        gaps = memory.gaps
        self.recall(memory)
        super().resume(replace(result, x=gaps.x, u=gaps.u, projection_gain=gaps.gain, gap=0.0))
        self.size, self.penalty, self.longest = gaps.size, gaps.penalty, gaps.longest
        self.filter = Filter(gaps.first, [(float(theta), float(cost)) for theta, cost in gaps.filter])
        self.costates = gaps.costates if len(gaps.costates) else None
        curve = self._evaluate(self.x, self.u)
        if isinstance(curve, Refusal):
            raise ArgumentError(f"resume: {curve.reason}; expected the result of a run with this system")
        self.tells_saddles = False
        self._take(curve._replace(length=gaps.length))

    def recall(self, memory: Memory) -> None:
        """Remember what an earlier run did of its way."""
        self.given, self.first, self.earlier = memory.start, memory.first, memory.earlier

    def memory(self) -> Memory:
        """Return what resuming needs beside the iterate."""
        gaps = None
        if self.open_curve is not None:
            costates = np.zeros((0, self.system.ndx)) if self.costates is None else self.costates
            pairs = np.array(self.filter.pairs).reshape(-1, 2)
            gaps = Gaps(
                self.x,
                self.u,
                self.gain.copy(),
                self.size,
                costates,
                pairs,
                self.filter.first,
                self.penalty,
                self.open_curve.length,
                self.longest,
            )
        return Memory(start=self.given, first=self.first, gaps=gaps, earlier=self.earlier)

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result at the current iterate; before there is a trajectory again, at the one before."""
        result, before = changed(super().result(summary), memory=self.memory(), gap=self.gap), self.earlier
        if not self.is_open or before is None:
            return result
        return self._of(before, result)

    def _of(self, place: Place, result: OptimizationResult) -> OptimizationResult:
        """Return a result with the trajectory of a place."""
        return replace(
            result, x=place.x, u=place.u, K=place.gain, projection_gain=place.gain,
            cost=self.cost.value(place.x, place.u), worst_step=place.worst_step, gap=0.0,
        )  # fmt: skip

    # ---- Where it stood before ------------------------------------------------------------------

    def place(self) -> Place:
        """Return where it stands."""
        # The gains lie in memory that is used again.
        return Place(self.x, self.u, self.gain.copy(), self.worst_step)

    def _go_to(self, place: Place) -> None:
        self.x, self.u, self.worst_step, self.gain = place.x, place.u, place.worst_step, place.gain.copy()
        self.value = self.cost.value(self.x, self.u)
        self.forget()

    def _asked_at(self, place: Place) -> float:
        """Return what is minimised in the end, somewhere else."""
        return self.cost.value(place.x, place.u) + self._guide(place.x, place.u)

    def _take(self, curve: OpenCurve) -> None:
        self.open_curve = curve
        self.x, self.u, self.worst_step = curve.x, curve.u, curve.worst_step
        self.value = curve.cost + self.penalty * curve.theta

    def _evaluate(self, x: Array, u: Array) -> OpenCurve | Refusal:
        """Return a curve with its gaps, or which step of it cannot be made."""
        made = self.system.step_each(x, u)
        if not made.complete:
            reason = f"a step of the curve failed: {made.failure}"
            return Refusal(reason, made.steps_done, failed=True, coarsest=made.worst_step)
        if self.open_curve is not None and is_too_coarse(made.worst_step, self.worst_step):
            assert made.worst_at is not None
            reason = f"{self.system.when(made.worst_at)} would be too coarse, {made.worst_step}"
            return Refusal(reason, made.worst_at, coarsest=made.worst_step)
        x, u = read_only(x), read_only(u)
        gaps = apart(self.space, made.x, x[1:])
        with np.errstate(over="ignore", invalid="ignore"):
            shown = self.cost.value(x, u)
        if not np.isfinite(shown):
            return Refusal("the cost is not finite")
        theta = float(np.sum(np.abs(gaps) / self.size))
        return OpenCurve(x, u, made.x, gaps, theta, shown + self._guide(x, u), made.worst_step, shown)

    def _guide(self, x: Array, u: Array) -> float:  # noqa: ARG002
        """Return what a curve costs beside its cost, only to guide the search."""
        return 0.0

    # ---- Stages ---------------------------------------------------------------------------------

    @property
    def gap(self) -> float:
        """The largest gap, in parts of the states' sizes; 0 of a trajectory."""
        return 0.0 if self.open_curve is None else float((np.abs(self.open_curve.gaps) / self.size).max())

    @property
    def is_open(self) -> bool:
        return self.open_curve is not None

    @property
    def shown(self) -> float:
        """The cost without the gaps' penalty."""
        return super().shown if self.open_curve is None else self.open_curve.shown

    @property
    def longest_stage(self) -> int | None:
        """Iterations after which the stage is over: at once where the gaps are closed."""
        if self.open_curve is None:
            return super().longest_stage
        if self.open_curve.length == 1.0 and self._are_closed():
            return 1
        return self.longest

    @property
    def patience(self) -> int:
        """Steps in a row that do not lower the cost: any number where they close gaps instead."""
        return super().patience if self.open_curve is None else _LONGEST

    @property
    def unfinished(self) -> str:
        """What is to be said of a run that ends with gaps."""
        if self.open_curve is None:
            return super().unfinished
        k = int((np.abs(self.open_curve.gaps) / self.size).max(axis=1).argmax())
        return (
            f"Gaps are still open, the largest of {self.gap:.2g} of the states' size at {self.system.when(k)}: what is "
            f"returned is {self._returned}."
        )

    @property
    def _returned(self) -> str:
        """What a run returns that ends with gaps."""
        return "no trajectory yet" if self.earlier is None else "the trajectory that it had come to before them"

    @property
    def tells_violence(self) -> bool:
        """Whether first steps that are cut short tell of a run that is likely to get lost."""
        return True

    @property
    def prefers_gaps(self) -> bool:
        """Whether gaps are more promising than an easier stage, where a run gets lost."""
        return False

    @property
    def long_run(self) -> int | None:
        """Iterations after which gaps may be the shorter way; None where they are none."""
        lost = self.given is not None and self.given.is_lost and not self.is_open
        return _LONG_IF_LOST if lost else None

    def tolerated(self, goal: float) -> float:
        if self.open_curve is None:
            return super().tolerated(goal)
        # Where nothing but gaps is left, closing them is expected to gain nothing.
        return max(goal, _LOOSE * abs(self.value)) if self._are_closed() else 0.0

    def next_stage(self, *, moved: bool = True) -> bool:
        """Go on over trajectories, where the gaps are closed or cannot be; then as without them."""
        if self.open_curve is None:
            return super().next_stage(moved=moved)
        closed = self._are_closed()
        self.open_curve = self.costates = None
        self.tells_saddles = self.system.has_curvature
        self.forget()
        try:
            self._project_curve()
            self.value = self.cost.value(self.x, self.u)
        except LeastActionError:
            closed = False
            if not self._begin_without_gaps():
                raise
        self.forget()
        return self._goes_on_from_gaps(closed=closed)

    def _begin_without_gaps(self) -> bool:
        """Leave a curve with gaps that cannot be projected; whether there is somewhere to go."""
        if self.earlier is not None:
            self.value = np.inf
            return True
        if self.given is None:
            return False
        super().start((self.given.x, self.given.u))
        return True

    def _goes_on_from_gaps(self, *, closed: bool) -> bool:
        """Leave the start behind, and go on where the gaps led, or back to where it stood before."""
        self.given = None
        # Only closed gaps are worth leaving a place that costs less.
        here = self.value + self._guide(self.x, self.u)
        earlier, self.earlier = self.earlier, None
        if closed or earlier is None or here < self._asked_at(earlier):
            return True
        self._go_to(earlier)
        return False

    def _are_closed(self) -> bool:
        return self.gap <= _CLOSED

    # ---- Directions -----------------------------------------------------------------------------

    def _linearize(self) -> Linearization:
        if self.open_curve is None:
            return super()._linearize()
        if self.linearization is None:
            with self.clock("linearize"):
                steps = self.system.linearize_each(self.x, self.u, self.open_curve.ends)
            if self.space is not None:
                steps = read_at(self.space, steps, self.open_curve.ends, self.x[1:])
            self.linearization = steps
        return self.linearization

    def _curvature_along(self, gradient: CostGradient) -> Array:
        if self.open_curve is None:
            return super()._curvature_along(gradient)
        if self.costates is None:
            # Nothing is known of them yet: those of a loop that is closed by some gains.
            self.gain = self._solve("quasi-newton", self.spare).K.copy()
            return super()._curvature_along(gradient)
        if self.curvature is None:
            linearization = self._linearize()
            with self.clock("curvature"):
                self.curvature = linearization.packed_curvature(self.costates)
        return self.curvature

    def _solve(
        self, method: str, workspace: Workspace, scale: float = 0.0, shift: float = 0.0
    ) -> LinearQuadraticSolution:
        if self.open_curve is None:
            return super()._solve(method, workspace, scale, shift)
        gradient, hessian = self._gradient(), self._hessian(scale if method == "newton" else 0.0)
        if shift > 0.0:
            hessian = shifted(hessian, shift)
        linearization = self._linearize()
        curvature = self._curvature_along(gradient) if method == "newton" else None
        with self.clock("lq"):
            return minimise_model(
                method, linearization, gradient, hessian, curvature, workspace, scale, self.open_curve.gaps
            )

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        """Return the direction of a model that has a minimum, and choose the penalty so that it is one of descent."""
        if self.open_curve is None:
            return super().direction(method, model, scale, shift)
        dx0 = self._start_step(model)
        dx, du = self._sweep(model, dx0, gaps=self.open_curve.gaps)
        assert model.P is not None
        assert model.factors is not None
        costates = np.einsum("kij,kj->ki", model.P, dx) + model.b
        q, r, q_final = self._gradient()
        fall = float(np.sum(q * dx[:-1]) + np.sum(r * du) + q_final @ dx[-1])
        least = least_of(model, dx0)
        theta = self.open_curve.theta
        rise = fall + max(least - fall, 0.0)
        if theta > 0.0 and rise > 0.5 * self.penalty * theta:
            self.penalty = 2.0 * rise / theta
            self.value = self.open_curve.cost + self.penalty * theta
        slope = min(2.0 * (least - self.penalty * theta), -np.finfo(np.float64).tiny)
        return DiscreteDirection(
            method, slope, scale, shift, gain=model.K, C=model.C, dx=dx, du=du, dx0=dx0,
            among=AmongCurves(costates, fall, least, model.P, model.factors),
        )  # fmt: skip

    # ---- Steps ----------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:  # noqa: ARG002
        """Return how far to go at first: beyond a full step gaps would open again."""
        return length if self.open_curve is None else min(length, 1.0)

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Iterate] | Refusal:
        """Return the curve at a step along the direction, its new gaps closed if need be, or why it is refused."""
        if self.open_curve is None:
            return super().simulate(direction, length, bound)
        curve, among = self.open_curve, direction.among
        assert among is not None
        assert direction.dx is not None
        assert direction.du is not None
        trial = self._moved(direction.dx, direction.du, length)
        outcome = self._judge(among.fall, length, trial)
        if isinstance(outcome, Trial) or isinstance(trial, Refusal) or length < 1.0 or trial.theta < curve.theta:
            return outcome
        missed, law = curve.gaps, Feedforward(direction.K, direction.C)
        for _ in range(_CORRECTIONS):
            # The full step missed by this much more than the linear dynamics say.
            law = self._closing(law, among, trial.gaps)
            missed, before = missed + trial.gaps, trial.theta
            trial = self._moved(*self._sweep(law, direction.dx0, gaps=missed), 1.0)
            if isinstance(trial, Refusal):
                break
            corrected = self._judge(among.fall, 1.0, trial)
            if isinstance(corrected, Trial):
                return corrected
            if trial.theta > _LEFT * before:
                break
        return outcome

    def _closing(self, law: Feedforward, among: AmongCurves, gaps: Array) -> Feedforward:
        """Return the law that closes some more gaps, as cheaply as the model of a direction says."""
        linearization = self._linearize()
        A, B = linearization
        with self.clock("lq"):
            more = feedforward_of_drift(A, B, law.K, among.P, among.factors, gaps, pattern=linearization.pattern)
        return law._replace(C=law.C + more)

    def _moved(self, dx: Array, du: Array, length: float) -> OpenCurve | Refusal:
        x, u = moved_by(self.space, self.x, length * dx), self.u + length * du
        if self.free_start is not False:
            try:
                x[0] = self.system.moved_start(self.x[0], length * dx[0])
            except LeastActionError as error:
                return Refusal(f"the initial state cannot move so far: {error}", 0, failed=True)
        moved = self._evaluate(x, u)
        return moved if isinstance(moved, Refusal) else moved._replace(length=length)

    def _judge(self, fall: float, length: float, trial: OpenCurve | Refusal) -> Trial[Iterate] | Refusal:
        """Return a trial, or why it is refused by the filter."""
        if isinstance(trial, Refusal):
            return trial
        assert self.open_curve is not None
        if not self.filter.takes(self.open_curve, trial, length, fall, self.noise, self.penalty):
            return Refusal(
                f"gaps of {trial.theta:.4g} in all and a cost of {trial.cost:.10g}, where there are "
                f"{self.open_curve.theta:.4g} and {self.open_curve.cost:.10g}"
            )
        return Trial(cast(Any, trial), trial.cost + self.penalty * trial.theta)

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        if self.open_curve is None:
            super().accept(direction, trial)
            return
        among = direction.among
        assert among is not None
        old, new = self.open_curve, cast(OpenCurve, trial.iterate)
        self.filter.follow(old, new, among.fall, self.noise)
        if self.costates is None:
            self.costates = among.costates
        else:
            self.costates = self.costates + new.length * (among.costates - self.costates)
        self.gain = direction.gain
        if direction.gain is self.free.K:
            self.free, self.held = self.held, self.free
        self._take(new)
        self.forget()
