"""The loop: one iteration after the other, until there is a reason to stop.

An iteration (`Loop._advance`)::

    for direction in Directions.each():             # of the best model that has a minimum first, then simpler, shorter
        is so little expected of it that it ends?   # at a minimum, a saddle, a limit of iterations
        step = Search(direction)                    # as long a step as lowers what is minimised enough
        a step was found?  accept it, and tell of it: the iteration is over
    no direction could be followed:  the stage ends stalled, or with a line search that failed

Where it ends, `StageSequence.go_on` has the problem's next stage, or another way to begin, or nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf, nan
from types import MappingProxyType
from typing import Any

from leastaction.errors import LeastActionError
from leastaction.numerics.frozen import changed, made
from leastaction.optimal.line_search import SearchStep, Trial
from leastaction.optimal.loop.directions import Directions
from leastaction.optimal.loop.ending import EndFound, Outcome, bottomless, message, outlook, unless_bottomless
from leastaction.optimal.loop.problem import Direction, Problem
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.search import Search
from leastaction.optimal.loop.stages import StageSequence
from leastaction.optimal.loop.way import Way
from leastaction.optimal.options import Options
from leastaction.optimal.result import IterationRecord, OptimizationResult, Status

# Least decrease, in times the noise that was seen, that is found again in it by steps as short as searches make.
_LOST = 50.0

Callback = Callable[[IterationRecord], object]


class Loop:
    """One optimisation.

    ``problem``: standing at its first iterate. ``callback``: told of every iteration; a true answer ends it.
    ``resume``: the result whose history goes on. ``ways``: to begin again, in the order in which they are tried.
    """

    def __init__(
        self,
        problem: Problem[Any, Any, Any],
        settings: Options,
        callback: Callback | None = None,
        resume: OptimizationResult | None = None,
        ways: Sequence[Way] = (),
    ) -> None:
        self.callback = callback
        self.progress = Run(problem, settings, resume)
        self.stages = StageSequence(self.progress, ways)
        self.directions = Directions(self.progress)
        self.search = Search(self.progress)

    def run(self) -> OptimizationResult:
        """Iterate until there is a reason to stop."""
        try:
            outcome = None
            if not self.progress.history.cost:
                outcome = self._tell(None, None, nan, self.progress.problem.report.note)
            while outcome is None or self.stages.go_on(outcome):
                self.stages.look()
                outcome = self._advance()
            outcome = unless_bottomless(self.progress, self.stages.verdict(outcome))
        except KeyboardInterrupt:
            # A solution may have been left half written; none of it belongs to the iterate.
            self.progress.problem.models.forget()
            outcome = Outcome(Status.INTERRUPTED)
        return self._finish(outcome)

    def _advance(self) -> Outcome | None:
        """Make one iteration; the outcome if it was the last."""
        run = self.progress
        notes: list[str] = []
        expected, promised = nan, -inf
        shifted = run.schedule.shift > 0.0
        refusal = None
        try:
            for direction in self.directions.each(notes):
                expected = -direction.slope
                # Of ever larger shifts little can be expected, wherever it stands; of the identity as a model, all.
                if direction.method != "steepest" or promised == -inf:
                    promised = max(promised, expected)
                if run.history.iterations >= run.limit:
                    return Outcome(Status.ITERATION_LIMIT, outlook(run, direction), expected)
                direction = run.problem.models.refined(direction, holds=run.schedule.holds)
                step = self.search(direction)
                if step.trial is not None:
                    return self._accept(direction, step, step.trial, "; ".join([*run.remarks(), *notes]))
                if run.trusts_its_start:
                    run.doubt_model()
                    return None
                refusal = step.refusal
                assert refusal is not None
                notes.append(f"{direction.method}: no step was short enough, {refusal.reason}")
                if self.search.sees_noise(direction):
                    # The same search among costs that are known to be so.
                    return None
                run.note_failure(direction.method)
                if direction.bend < 0.0:
                    ended = f"The search along it ended: {refusal.reason}."
                    return Outcome(Status.SADDLE, ended, expected, refused=refusal.coarsest)
                if refusal.hopeless and direction.shift > 0.0:
                    break
        except EndFound as found:
            return found.outcome
        except LeastActionError as error:
            return Outcome(Status.DERIVATIVES_FAILED, str(error))
        if refusal is None:
            return Outcome(Status.NO_DIRECTION, "; ".join(notes))
        here = run.problem.here
        if promised < max(1e-10 * abs(here.value), here.noise, _LOST * here.roughness):
            if shifted:
                run.set_shift(0.0)  # what is to be gained is told by a model without
                return None
            return Outcome(Status.STALLED, notes[-1], expected)
        return Outcome(Status.LINE_SEARCH_FAILED, notes[-1], expected, refusal.failed, refusal.coarsest)

    def _accept(self, direction: Direction, step: SearchStep[Any], trial: Trial[Any], note: str) -> Outcome | None:
        run, problem = self.progress, self.progress.problem
        decrease, expected = problem.here.value - trial.cost, -direction.slope
        agreement = decrease / max(0.5 * expected, 1e-300)
        before = run.schedule
        share = decrease / max(problem.steps.promised(direction, step.length), 1e-300)  # NaN where nothing was promised
        run.note_step(direction, step, decrease, agreement, trial.cost, share)
        foretold = None
        if not (run.stalled or before.wary) and step.length == 1.0 and direction.method == "newton":
            foretold = self.directions.foretold(before, expected, share)
        problem.steps.accept(direction, trial)
        if foretold is not None:
            problem.models.keep_feedback(direction)
        told = self._tell(direction, step, decrease, note) or foretold
        return Outcome(Status.UNBOUNDED) if told is None and bottomless(run) else told

    def _tell(
        self, direction: Direction | None, step: SearchStep[Any] | None, decrease: float, note: str
    ) -> Outcome | None:
        """Tell the history and the callback of an iteration, or of where it all starts."""
        run, problem = self.progress, self.progress.problem
        x, u = problem.report.arrays()
        cut = None if step is None or step.refusal is None else step.refusal.step
        record = made(
            IterationRecord,
            iteration=run.history.iterations + (direction is not None),
            method="start" if direction is None else direction.method,
            cost=problem.report.shown,
            expected_decrease=nan if direction is None else -direction.slope,
            step_length=nan if step is None else step.length,
            rollouts=problem.report.rollouts if step is None else step.rollouts,
            curvature_scale=0.0 if direction is None else direction.curvature_scale,
            note=note,
            seconds=problem.report.clock.seconds,
            x=x,
            u=u,
            snapshot=self._snapshot,
            decrease=decrease,
            shift=0.0 if direction is None else direction.shift,
            cut_at=-1 if cut is None else cut,
            worst_step=problem.here.worst_step,
            gap=problem.here.gap,
        )
        run.history.add(record)
        if self.callback is not None and self.callback(record):
            return Outcome(Status.STOPPED_BY_CALLBACK)
        return None

    def _snapshot(self) -> OptimizationResult:
        result = self._finish(Outcome(Status.STOPPED_BY_CALLBACK))
        # The run goes on in the memory of these.
        return replace(result, K=result.K.copy(), projection_gain=result.projection_gain.copy())

    def _finish(self, outcome: Outcome) -> OptimizationResult:
        run, problem = self.progress, self.progress.problem
        # The last feedback may still have to be computed: its time belongs to the total.
        clock = problem.report.clock
        timings = clock.timings
        result = problem.report.result(
            {
                "status": outcome.status,
                "message": message(problem, outcome),
                "cost": problem.report.shown,
                "expected_decrease": outcome.expected,
                "history": run.history.build(),
                "timings": MappingProxyType(timings),
                "rollouts": problem.report.rollouts + run.searched,
                "settings": run.settings,
                "schedule": run.schedule,
                "worst_step": problem.here.worst_step,
            }
        )
        timings["total"] = clock.seconds
        return changed(result, state=run.remembered(result.state))
