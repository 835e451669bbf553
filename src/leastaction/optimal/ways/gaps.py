"""Multiple shooting: gaps between the steps, from the start that was given."""

from __future__ import annotations

from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import FIRST_STEPS, Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.optimal.search.problem import DiscreteProblem

_LONG, _LONG_IF_LOST = 200, 100  # iterations after which a run is long; the second, where the projected start diverged
_BRIEF = 40  # most iterations with gaps where most of the first steps had to be shortened: other ways are left


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where first steps had to be shortened, where a run is long, and where it ends and gaps are preferred."""
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if outcome is not None:
        return outcome.status in STUCK and _are_preferred(problem)
    # Steps that barriers shorten are no sign of a violent motion.
    if run.history.iterations == FIRST_STEPS:
        return run.was_violent and problem.parts.barrier is None
    return run.history.iterations == _long_run(problem) and not (run.began_again or run.creeps)


def _are_preferred(problem: DiscreteProblem) -> bool:
    """Whether gaps come before an easier cost: within limits, and where the projection of the start diverged."""
    given = problem.beginning.begun.given
    if problem.parts.barrier is not None:
        return given is not None and problem.beginning.final_time is None
    return given is not None and given.is_lost


def _long_run(problem: DiscreteProblem) -> int | None:
    """Return the number of iterations after which gaps are tried; None where they are not."""
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
