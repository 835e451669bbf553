"""Gaps between the steps (multiple shooting), from the start that was given."""

from __future__ import annotations

from leastaction.optimal.discrete.shooting import ShootingProblem
from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.schedule import NewtonSchedule


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where the first steps had to be cut short, where a run is long, and where it is stuck and they are preferred."""
    problem = run.problem
    if not isinstance(problem, ShootingProblem):
        return False
    if outcome is not None:
        return outcome.status in STUCK and problem.prefers_gaps
    if run.has_just_begun and run.was_violent and problem.tells_violence:
        return True
    return run.history.iterations == problem.long_run and not (run.began_again or run.creeps)


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, ShootingProblem)
    if not problem.begin_with_gaps(brief=run.was_violent):
        return False
    run.set_out(NewtonSchedule(), "began again, with gaps between the steps")
    return True


GAPS = Way("gaps", _applies, _begin)
