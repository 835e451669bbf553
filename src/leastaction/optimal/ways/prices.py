"""Higher prices of what is asked at a single instant, where a motion whose duration is free was made too short."""

from __future__ import annotations

from leastaction.optimal.limits.problem import LimitedProblem
from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import Status


def _applies(run: Run, outcome: Outcome | None) -> bool:
    problem = run.problem
    if outcome is None or outcome.status not in (*STUCK, Status.INFEASIBLE) or "prices" in run.taken:
        return False
    return isinstance(problem, LimitedProblem) and problem.final_time is not None and problem.is_unmet


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, LimitedProblem)
    if not problem.begin_dearer():
        return False
    run.begin_again("prices", "began again, with higher prices of what is asked at a single instant")
    return True


PRICES = Way("prices", _applies, _begin)
