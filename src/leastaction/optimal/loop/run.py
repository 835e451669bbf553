"""How far an optimisation has come: what its parts share, and remember from one iteration to the next."""

from __future__ import annotations

from typing import Any

from leastaction.numerics.frozen import changed, made
from leastaction.optimal.line_search import SearchStep
from leastaction.optimal.loop.problem import Direction, Problem
from leastaction.optimal.options import Options
from leastaction.optimal.result import HistoryBuilder, OptimizationResult
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.optimal.state import NOT_RUN, Resolved, RunState, SearchState

FIRST_STEPS = 14
"""First steps by which a run is judged."""
_MOST, _CUT = 10, 0.3  # first steps that are cut short where a run is likely to get lost; and the length below which

# Part of the cost below which an expected decrease is that of a run that creeps towards its end: it is not lost.
_CREEPING = 1e-4

# Part of the cost below which an expected decrease may be that near a saddle, where a model has no minimum.
_LITTLE = 1e-2

# Error of the foretold decrease, in parts of it, below which a model holds.
_HOLDS = 0.1

# Part of an expected decrease that is left at most after a step of Newton's method, or of another without damping whose
# model holds; and the length of a step that is all but full.
_AFTER, _FULL = 0.1, 0.9


class Run:
    """How far an optimisation has come.

    ``problem``: standing at its current iterate. ``history``: of all iterations. ``limit``: how many there may be.
    ``schedule``: what the choice of a direction remembers. ``state``: what else goes with the result.
    ``asked_problem``: the problem to go on with after a search among motions that the steps of time resolve.
    ``stalled``: whether too many steps in a row have lowered the cost by no more than its noise. ``searched``:
    roll-outs of searches.
    """

    def __init__(
        self,
        problem: Problem[Any, Direction, Any],
        settings: Options,
        resume: OptimizationResult | None,
    ) -> None:
        self.problem: Problem[Any, Any, Any] = problem
        self.settings = settings
        self.state = NOT_RUN
        self.asked_problem: Problem[Any, Any, Any] = problem
        self.searched = 0
        self.stalled = False
        if resume is None:
            self.history = HistoryBuilder()
            self.limit = settings.max_iterations
            self.schedule = made(NewtonSchedule, holds=problem.begins_at_minimum)
        else:
            self.history = HistoryBuilder(resume.history)
            self.limit = settings.max_iterations + resume.iterations
            self.schedule = resume.schedule
            if resume.state is not None:
                self.recall(resume.state.run)

    def recall(self, state: RunState) -> None:
        """Go on from what an earlier run remembers."""
        self.state = state
        self.problem.here.roughness = state.roughness
        if state.tells_saddles is not None:
            self.problem.models.tells_saddles = state.tells_saddles
        self.stalled = state.still >= self.problem.stages.patience

    def remembered(self, state: SearchState | None) -> SearchState:
        """Return what resuming needs, given what it needs of the problem."""
        here, models = self.problem.here, self.problem.models
        run = changed(self.state, roughness=here.roughness, tells_saddles=models.tells_saddles)
        return changed(state or SearchState(), run=run)

    @property
    def resolved(self) -> Resolved | None:
        """What a search among motions that the steps of time resolve remembers; None elsewhere."""
        return self.state.resolved

    def remember(self, **values: Any) -> None:
        """Remember something else of its state."""
        self.state = changed(self.state, **values)

    @property
    def is_automatic(self) -> bool:
        """Whether the method is chosen here."""
        return self.settings.method == "auto"

    @property
    def asked(self) -> float:
        """The expected decrease that is small enough in the end."""
        return self.settings.tolerance * abs(self.problem.models.magnitude) + self.settings.absolute_tolerance

    @property
    def goal(self) -> float:
        """The expected decrease that is small enough at this stage."""
        return self.problem.stages.tolerated(self.asked)

    @property
    def trusts_its_start(self) -> bool:
        """Whether the model is trusted because of where it begins: for one trial, before there was any."""
        return self.schedule.holds and self.history.iterations == 0

    @property
    def began_with_short_steps(self) -> bool:
        """Whether most of the first steps had to be short: such a search is likely to end at no minimum."""
        return sum(length < _CUT for length in self.history.step_lengths[:FIRST_STEPS]) >= _MOST

    @property
    def creeps(self) -> bool:
        """Whether so little is left to be gained that no other way is likely to be the shorter one."""
        return self.schedule.expected <= _CREEPING * abs(self.problem.here.value)

    @property
    def foresees_end(self) -> bool:
        """Whether the next direction would end a stage that only leads to another: it need not be found."""
        last = self.schedule
        return (
            (last.method == "newton" or (last.method == "quasi-newton" and last.holds))
            and last.length >= _FULL
            and self.problem.stages.is_passing
            and _AFTER * last.expected <= self.goal
        )

    def set_out(self, schedule: NewtonSchedule, why: str = "") -> None:
        """Begin a stage of the problem; the note of the next iteration says why."""
        self.schedule, self.stalled = changed(schedule, spent=0), False
        remark = "; ".join(part for part in (self.state.remark, why, self.problem.stages.remark) if part)
        self.remember(still=0, remark=remark)

    @property
    def began_again(self) -> bool:
        """Whether it has begun again, but for gaps."""
        return bool(self.state.taken)

    def take(self, way: str) -> None:
        """Remember that a way was taken."""
        if way and way not in self.state.taken:
            self.remember(taken=(*self.state.taken, way))

    def begin_again(self, way: str, why: str) -> None:
        """Set out as one that has begun again by a way."""
        self.take(way)
        self.set_out(NewtonSchedule(), why)

    def note_failure(self, method: str) -> None:
        """Remember that a direction of a method could not be found or followed."""
        if method.startswith("newton"):
            self.schedule = self.schedule.after_failure()

    def note_indefinite(self, scale: float) -> None:
        """Remember that a Newton model had no minimum; this part of the curvature is tried next."""
        wary = self.schedule.expected <= _LITTLE * abs(self.problem.models.magnitude)
        self.schedule = self.schedule.after_indefinite(scale, wary=wary)

    def set_shift(self, shift: float) -> None:
        """Take a shift of the weights for that of the iterations to come."""
        if shift != self.schedule.shift:
            self.schedule = changed(self.schedule, shift=shift)

    def note_step(
        self, direction: Direction, step: SearchStep[Any], decrease: float, agreement: float, cost: float, share: float
    ) -> None:
        """Remember a step that is to be accepted.

        ``decrease``: by how much it lowers the cost. ``agreement``: that in parts of what the model promised. ``cost``:
        that after it. ``share``: the decrease in parts of what the model had foretold of that length.
        """
        still = self.state.still + 1 if decrease <= self.problem.here.noise else 0
        # Whether that is at a minimum or at a saddle is looked at before the next step.
        self.stalled = still >= self.problem.stages.patience
        if still != self.state.still:
            self.remember(still=still)
        self.schedule = self.schedule.after_step(
            direction.method, direction.curvature_scale, step.length, agreement, -direction.slope, cost,
            held=abs(share - 1.0) < _HOLDS, free=step.rollouts == 1 and self.problem.models.knows_longest_step,
        )  # fmt: skip

    def doubt_model(self) -> None:
        """Remember that a model does not hold."""
        self.schedule = changed(self.schedule, holds=False)

    def remarks(self) -> list[str]:
        """Return what is to be said of the stage that an iteration begins."""
        remark = self.state.remark
        if not remark:
            return []
        self.remember(remark="")
        return [remark]
