"""Higher prices of what is asked at a single instant, where that was not met: it may have been too cheap.

A motion whose duration is free may be made ever shorter, and one whose start is free may leave its bounds there, for
what is gained elsewhere. Where higher prices come to nothing either, the end that was nearer to what is asked is told.
"""

from __future__ import annotations

from leastaction.optimal.limits.problem import LimitedProblem
from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.memory import Nearer
from leastaction.optimal.result import Status

_NAME = "prices"


def _applies(run: Run, outcome: Outcome | None) -> bool:
    problem = run.problem
    if outcome is None or not isinstance(problem, LimitedProblem) or not problem.is_unmet:
        return False
    if outcome.status is Status.INFEASIBLE and run.nearer is not None:
        return True
    if _NAME in run.taken or problem.given is None:
        return False
    if problem.final_time is not None:
        return outcome.status in (*STUCK, Status.INFEASIBLE)
    return outcome.status is Status.INFEASIBLE and problem.misses_an_instant()


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, LimitedProblem)
    if run.nearer is not None:
        nearer, run.nearer = run.nearer, None
        if not problem.go_to_the_nearer(nearer.place, nearer.limits):
            return False
        run.begin_again(_NAME, "higher prices led to nothing that is nearer: back to where it stood")
        return True
    nearer = Nearer(problem.place(), problem.report())
    if not problem.begin_dearer():
        return False
    run.nearer = nearer
    run.begin_again(_NAME, "began again, with higher prices of what is asked at a single instant")
    return True


PRICES = Way(_NAME, _applies, _begin)
