"""The minimum without limits, where the first steps among limits are all very short."""

from __future__ import annotations

from leastaction.optimal.loop.ending import Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.search.problem import DiscreteProblem

# Number of first steps within limits, and the length below which all of them are too short to go on.
_FEW, _VERY_SHORT = 6, 0.2

# Iterations that the minimum without limits may take, and a tolerance that will do for it.
_SOON, _ROUGHLY = 30, 1e-3


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Whether the first steps are very short; not with equations, limits of the user's own, or an earlier result."""
    problem = run.problem
    if outcome is not None or max(run.history.step_lengths) >= _VERY_SHORT:
        return False
    assert isinstance(problem, DiscreteProblem)
    parts, beginning = problem.parts, problem.beginning
    if run.began_again or parts.barrier is None:
        return False
    own, given = any(rows.equal or rows.is_own for rows in parts.rows), beginning.begun.given
    return not (parts.here.is_open or own or given is None or given.was_found or beginning.final_time is not None)


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    found = problem.found_with([], _SOON, tolerance=_ROUGHLY)
    if found is None or not found.success or not problem.beginning.begin_at(found.x, found.u):
        return False
    run.begin_again("freely", "began again, from the minimum without limits")
    return True


FREELY = Way("freely", _applies, _begin, ahead=(_FEW,))
