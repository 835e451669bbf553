"""From one stage of a problem to the next, and other ways to begin where a run is stuck."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction.numerics.frozen import changed
from leastaction.optimal.loop.ending import STUCK, Outcome, coarse_step
from leastaction.optimal.loop.run import Run
from leastaction.optimal.result import Status
from leastaction.optimal.schedule import NewtonSchedule

# A run within limits has got nowhere where so many first steps were all shorter than that.
_FEW, _VERY_SHORT = 6, 0.2

# Where the last way to begin again may lead: that before it was better.
_ASTRAY = (Status.NO_DIRECTION, Status.DERIVATIVES_FAILED)

# Where a stage of the problem may be followed by the next.
_ENDS = (Status.CONVERGED, Status.STALLED)


class Stages:
    """The stages of a run: all but the first are tried for the automatic choice of a method only."""

    def __init__(self, run: Run) -> None:
        self.run = run

    def look(self) -> None:
        """Leave a stage that has lasted too long, or a run that is about to get lost.

        Looked at before each iteration, so that one which is resumed does as well.
        """
        run = self.run
        if run.schedule.spent >= (run.problem.longest_stage or np.inf) or run.foresees_end:
            self._next()
        elif run.history.iterations == _FEW and max(run.history.step_lengths) < _VERY_SHORT:
            self._begin_freely()
        elif run.has_just_begun and run.was_violent and run.problem.tells_violence:
            if not self._begin_with_gaps():
                self._begin_again()
        elif run.history.iterations == run.problem.long_run and not (run.schedule.again or run.creeps):
            self._begin_with_gaps()

    def go_on(self, outcome: Outcome) -> bool:
        """Return whether the problem has more to do where a stage ended so."""
        run, problem = self.run, self.run.problem
        stuck = outcome.status in STUCK or (run.schedule.newton and outcome.status in _ASTRAY)
        if (outcome.status in _ENDS or (stuck and problem.longest_stage is not None)) and self._next():
            return True
        if outcome.status in _ENDS:
            problem.arrive()
            return False
        # Stages that end at steps of time that are too coarse lead there again, however they are made.
        if stuck and run.schedule.again and self._begin_finer(outcome):
            return True
        if stuck and not run.schedule.newton and problem.retry_stage():
            self._set_out_again(
                "what led nowhere is made again, from where a stage had ended well or with other prices"
            )
            return True
        if stuck and ((problem.prefers_gaps and self._begin_with_gaps()) or self._begin_again()):
            return True
        if stuck and self._begin_plainly():
            return True
        if stuck and problem.fall_back():
            self._set_out_again("the way before it began again had led further: it goes on there")
            return True
        return stuck and self._begin_finer(outcome)

    def verdict(self, outcome: Outcome) -> Outcome:
        """Return another outcome than that of the last stage's minimum, if the problem has one."""
        verdict = self.run.problem.verdict() if outcome.status in _ENDS else None
        return outcome if verdict is None else Outcome(*verdict, expected=outcome.expected)

    def _next(self) -> bool:
        """Go on to the problem's next stage, if it has one."""
        run = self.run
        was_open = run.problem.is_open
        if run.problem.next_stage(moved=run.schedule.spent > 0):
            # How short steps among curves had to be says nothing of those among trajectories.
            shift = 0.0 if was_open and not run.problem.is_open else run.schedule.shift
            run.set_out(changed(run.schedule, scale=1.0, expected=np.nan, full=False, shift=shift))
            return True
        if not was_open:
            return False
        again = NewtonSchedule(again=run.schedule.again, finer=run.schedule.finer)
        run.set_out(again, "the gaps did not close, back to where it stood")
        if run.was_violent and run.problem.tells_violence:
            self._begin_again()
        return True

    def _begin_with_gaps(self) -> bool:
        """Begin again with gaps between the steps, for the automatic choice only."""
        run = self.run
        if not run.is_automatic or not run.problem.begin_with_gaps(brief=run.was_violent):
            return False
        schedule = NewtonSchedule(again=run.schedule.again, finer=run.schedule.finer)
        run.set_out(schedule, "began again, with gaps between the steps")
        return True

    def _begin_freely(self) -> bool:
        """Begin again from the minimum without limits."""
        return self._begin_once(self.run.problem.begin_freely, "from the minimum without limits")

    def _begin_again(self) -> bool:
        """Begin again with an easier stage."""
        return self._begin_once(self.run.problem.begin_again, "where searches would lead nowhere")

    def _begin_once(self, begin: Callable[[], bool], why: str) -> bool:
        """Begin again in another way, if none was taken before and for the automatic choice only."""
        run = self.run
        if run.schedule.again or not run.is_automatic or not begin():
            return False
        self._set_out_again(f"began again, {why}")
        return True

    def _begin_finer(self, outcome: Outcome) -> bool:
        """Begin again from what shorter steps of time lead to, once and for the automatic choice only."""
        run = self.run
        if run.schedule.finer or not run.is_automatic or coarse_step(run.problem, outcome) is None:
            return False
        if not run.problem.begin_finer():
            return False
        run.set_out(NewtonSchedule(again=True, finer=True), "began again, from a minimum with half the steps of time")
        return True

    def _begin_plainly(self) -> bool:
        """Begin again where it began, by Newton's method in every iteration; once and for the automatic choice only.

        The ways to begin again are good guesses, and this is what they may have led away from.
        """
        run = self.run
        if not (run.is_automatic and run.problem.has_curvature and run.problem.begin_plainly()):
            return False
        schedule = NewtonSchedule(wait=0, again=True, finer=run.schedule.finer, newton=True)
        run.set_out(schedule, "began again where it had begun, by Newton's method")
        return True

    def _set_out_again(self, why: str) -> None:
        """Set out as one that has begun again."""
        self.run.set_out(NewtonSchedule(again=True, finer=self.run.schedule.finer), why)
