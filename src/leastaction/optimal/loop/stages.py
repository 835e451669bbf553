"""From one stage of a problem to the next, and to other ways to begin where a run is stuck."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.frozen import changed
from leastaction.optimal.loop.ending import LOST, STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import Status
from leastaction.optimal.schedule import NewtonSchedule

# Where a stage of the problem may be followed by the next.
_ENDS = (Status.CONVERGED, Status.STALLED)

# How a run ends that is cut off wherever it stands.
_CUT_OFF = (Status.ITERATION_LIMIT, Status.STOPPED_BY_CALLBACK)


class StageSequence:
    """The stages of a run, and the ways to begin again: in their order, each once, for the automatic choice only."""

    def __init__(self, run: Run, ways: Sequence[Way] = ()) -> None:
        self.run, self.ways = run, tuple(ways)

    def look(self) -> None:
        """Leave a stage that has lasted too long, or a run that is about to get lost.

        Looked at before each iteration, so that one which is resumed does as well.
        """
        run = self.run
        if run.schedule.spent >= (run.problem.stages.longest or np.inf) or run.foresees_end:
            self._next()
        elif self.run.is_automatic and (ahead := [way for way in self.ways if run.history.iterations in way.ahead]):
            self._begin(None, ahead)

    def go_on(self, outcome: Outcome) -> bool:
        """Return whether there is more to do where a stage ended so."""
        stages = self.run.problem.stages
        stuck = outcome.status in STUCK
        if (outcome.status in _ENDS or (stuck and stages.longest is not None)) and self._next():
            return True
        if outcome.status in _ENDS and stages.violates_limits:
            outcome = Outcome(Status.INFEASIBLE, expected=outcome.expected)
        elif stuck and stages.loosen():
            self.run.set_out(NewtonSchedule(), "what led nowhere is made again, with other prices or without leeway")
            return True
        return outcome.status not in _CUT_OFF and self._begin(outcome, self.ways)

    def verdict(self, outcome: Outcome) -> Outcome:
        """Return another outcome than that of the last stage's minimum, if the problem or a way has one."""
        verdict = self.run.problem.stages.verdict() if outcome.status in _ENDS else None
        if verdict is not None:
            return Outcome(*verdict, expected=outcome.expected)
        for way in self.ways:
            outcome = way.judge(self.run, outcome)
        return outcome

    def _begin(self, outcome: Outcome | None, ways: Sequence[Way]) -> bool:
        """Begin again by the first of some ways that applies; whether there is one."""
        run = self.run
        if not (run.is_automatic and run.problem.begins_again):
            return False
        return any(way.applies(run, outcome) and way.begin(run, outcome) for way in ways)

    def _next(self) -> bool:
        """Go on to the problem's next stage, if it has one."""
        run = self.run
        was_open = run.problem.stages.is_open
        following = run.problem.following(moved=run.schedule.spent > 0)
        if following is not None:
            run.problem = following
            # How short steps among curves had to be says nothing of those among trajectories.
            shift = 0.0 if was_open and not following.stages.is_open else run.schedule.shift
            run.set_out(changed(run.schedule, scale=1.0, expected=np.nan, full=False, shift=shift))
            return True
        if not was_open or run.problem.stages.is_open:
            return False
        run.set_out(NewtonSchedule(), "the gaps did not close, back to where it stood")
        if run.began_with_short_steps and not run.problem.models.knows_longest_step:
            self._begin(LOST, self.ways)
        return True
