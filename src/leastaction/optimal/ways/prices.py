"""Higher prices of limits at single instants, where these are violated at the end: prices may have been too low.

A motion whose duration is free may become ever shorter, and one whose start is free may violate its bounds there, if
the cost falls by more elsewhere. Where higher prices do not help either, the result is the end that violated limits
less.
"""

from __future__ import annotations

import numpy as np

from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import Status
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.state import Nearer, Place

_NAME = "prices"
_DEARER_AGAIN = 10.0  # factor by which the price of a violated limit at a single instant is raised


def _applies(run: Run, outcome: Outcome | None) -> bool:
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if outcome is None or not problem.stages.is_unmet:
        return False
    if outcome.status is Status.INFEASIBLE and run.state.nearer is not None:
        return True
    if _NAME in run.state.taken or problem.beginning.begun.given is None:
        return False
    if problem.beginning.final_time is not None:
        return outcome.status in (*STUCK, Status.INFEASIBLE)
    return outcome.status is Status.INFEASIBLE and _misses_an_instant(problem)


def _misses_an_instant(problem: DiscreteProblem) -> bool:
    """Whether an equation, or a limit at a single instant, is violated."""
    limits = problem.parts.limits
    assert limits is not None
    sides = zip(limits.duals.sides, limits.asked(), limits.duals.scale, strict=True)
    return any((side.equal or len(c) == 1) and bool((-c > limits.stages.met * scale).any()) for side, c, scale in sides)


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if run.state.nearer is not None:
        nearer = run.state.nearer
        run.remember(nearer=None)
        if not _go_to_the_nearer(problem, nearer.place, nearer.limits):
            return False
        run.begin_again(_NAME, "higher prices led to nothing that is nearer: back to where it stood")
        return True
    given = problem.beginning.begun.given
    problem.beginning.remember(given=None)
    limits = problem.parts.limits
    if given is None or limits is None:
        return False
    nearer = Nearer(problem.parts.place(), problem.parts.report())
    problem.beginning.begin_anew(given)
    limits.stages.make_dearer(_DEARER_AGAIN)
    problem.beginning.put_limits_in()
    run.remember(nearer=nearer)
    run.begin_again(_NAME, "began again, with higher prices of what is asked at a single instant")
    return True


def _go_to_the_nearer(problem: DiscreteProblem, place: Place, report: LimitReport) -> bool:
    """Go back to an earlier end with its duals, if that violated limits less; return whether it did."""
    limits = problem.parts.limits
    assert limits is not None
    asked, scales = limits.limited.asked(place.x, place.u).flat, limits.duals.scales
    off, now = (float((np.maximum(-c, 0.0) / scales).sum()) for c in (asked, limits.asked().flat))
    if off >= now:
        return False
    problem.parts.go_back(place)
    limits.stages.take(report, resumed=True)
    problem.parts.set_out()
    return True


PRICES = Way(_NAME, _applies, _begin)
