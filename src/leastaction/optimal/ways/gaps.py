"""Gaps between the steps (multiple shooting), from the start that was given."""

from __future__ import annotations

from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import FIRST_STEPS, Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.optimal.search.problem import DiscreteProblem

_LONG, _LONG_IF_LOST = 200, 100  # iterations after which a run is long; and where its start was lost when projected
_BRIEF = 40  # iterations with gaps at the most where most of the first steps had to be cut short: there are other ways


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where the first steps had to be cut short, where a run is long, and where it is stuck and they are preferred."""
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if outcome is not None:
        return outcome.status in STUCK and _are_preferred(problem)
    # Where barriers cut steps short it tells nothing.
    if run.history.iterations == FIRST_STEPS:
        return run.was_violent and problem.parts.barrier is None
    return run.history.iterations == _long_run(problem) and not (run.began_again or run.creeps)


def _are_preferred(problem: DiscreteProblem) -> bool:
    """Whether gaps are more promising than an easier stage: within limits, and where the projection lost the start."""
    given = problem.beginning.begun.given
    if problem.parts.barrier is not None:
        return given is not None and problem.beginning.final_time is None
    return given is not None and given.is_lost


def _long_run(problem: DiscreteProblem) -> int | None:
    """Return the iterations after which gaps may be the shorter way; None where they are none."""
    given = problem.beginning.begun.given
    if given is None or problem.parts.here.is_open or problem.parts.ease != 1.0:
        return None
    if given.is_lost:
        return _LONG_IF_LOST
    return _LONG if problem.parts.barrier is None else None


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    given = problem.beginning.begun.given
    brief = run.was_violent and problem.parts.barrier is None and given is not None and not given.is_lost
    if not problem.beginning.begin_with_gaps(_BRIEF if brief else None):
        return False
    run.set_out(NewtonSchedule(), "began again, with gaps between the steps")
    return True


GAPS = Way("gaps", _applies, _begin, ahead=(FIRST_STEPS, _LONG_IF_LOST, _LONG))
