"""The minimum without obstacles, where these cannot be met from the start: it may pass them on another side."""

from __future__ import annotations

from leastaction.optimal.limits.leeway import may_be_obstacle
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.loop.ending import Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import Status
from leastaction.optimal.search.problem import DiscreteProblem

_PAST = 200  # iterations that the minimum without obstacles may take


def _applies(run: Run, outcome: Outcome | None) -> bool:
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if outcome is None or outcome.status is not Status.INFEASIBLE:
        return False
    return "obstacles" not in run.taken and len(_others(problem)) < len(problem.parts.rows)


def _others(problem: DiscreteProblem) -> list[Rows]:
    """Return the limits that are no obstacles."""
    return [rows for rows in problem.parts.rows if not may_be_obstacle(rows, problem.parts.x, problem.parts.u)]


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    found = problem.found_with(_others(problem), _PAST)
    run.taken = (*run.taken, "obstacles")
    if found is None or not found.success or not problem.beginning.begin_at(found.x, found.u):
        return False
    run.begin_again("obstacles", "began again, from the minimum without obstacles")
    return True


OBSTACLES = Way("obstacles", _applies, _begin)
