"""What steps of time resolve, as a limit: no angle turns by more than some part of a radian within one.

Where a run ends without a minimum because its cost falls towards motions that the steps of time cannot follow, it
begins again from its first trajectory, with that limit beside its own. If the limit is not active at the minimum, it is
dropped, and the run goes on from there. If it is, the run ends with `Status.RESOLVED`: a minimum among motions that
these steps of time resolve.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.limit import Bound
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.loop.ending import STUCK, Outcome, coarse_step
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.state import Resolved, SearchState

_ENOUGH = 0.35  # largest angle of a step (rad) where steps of time are short enough for a motion
_NAMED = 3  # most instants that a message names


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where steps of time are too coarse for a minimum, once; and where the search within that limit ended."""
    if outcome is None:
        return False
    if run.resolved is not None:
        return True
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if "resolved" in run.state.taken or outcome.status not in (*STUCK, Status.DERIVATIVES_FAILED):
        return False
    return not problem.parts.here.is_open and (outcome.barred or coarse_step(problem, outcome) is not None)


def _begin(run: Run, outcome: Outcome | None) -> bool:
    assert outcome is not None
    return _set_out(run, outcome) if run.resolved is None else _drop(run, outcome)


def _set_out(run: Run, outcome: Outcome) -> bool:
    """Begin again within the limit; return whether that is possible."""
    asked = run.problem
    assert isinstance(asked, DiscreteProblem)
    run.take("resolved")
    within = within_resolved(asked)
    if within is None:
        return False
    # From the first trajectory, whose steps are not too coarse yet; from the last one if that is not possible.
    first, here = asked.beginning.begun.first, (asked.parts.x, asked.parts.u)
    starts = [here] if first is None else [(first.x, first.u), here]
    if not any(_can_start(within, start) for start in starts):
        return False
    steps = [step.angle for step in (asked.here.worst_step, outcome.refused) if step is not None]
    run.remember(resolved=Resolved(asked.parts.place(), max(steps, default=0.0)))
    run.problem, run.asked_problem = within, asked
    run.begin_again("", "began again, among motions that the steps of time resolve")
    return True


def _can_start(within: DiscreteProblem, start: tuple[Array, Array]) -> bool:
    try:
        within.start(start)
    except LeastActionError:
        return False
    return True


def _drop(run: Run, outcome: Outcome) -> bool:
    """Go on without the limit, where it is not active; or from the end without it, if the cost is lower there."""
    within, asked, state = run.problem, run.asked_problem, run.resolved
    assert isinstance(within, DiscreteProblem)
    assert isinstance(asked, DiscreteProblem)
    assert state is not None
    report = within.parts.report()
    if outcome.status in (Status.CONVERGED, Status.STALLED):
        if _active(report).size:
            return False
        onward = within.parts.x, within.parts.u, of_asked(asked, report)
        why = "the steps of time resolve the motion: it goes on without that limit"
    else:
        before = state.before
        cheaper = within.report.shown <= asked.parts.asked.value(before.x, before.u)
        if outcome.status is not Status.INFEASIBLE and cheaper:
            return False
        onward = before.x, before.u, None
        why = "what the steps of time resolve led nowhere: back to where it stood"
    try:
        asked.beginning.go_on_from(*onward)
    except LeastActionError:  # near where a step has no derivatives no regulator may follow it: it ends within
        return False
    asked.parts.work.count_on(within.parts.work)
    run.remember(resolved=None)
    run.problem = asked
    run.begin_again("", why)
    return True


def of_asked(asked: DiscreteProblem, report: LimitReport | None) -> LimitReport | None:
    """Return the part of a report that is of the original limits: they come first."""
    if report is None or asked.parts.barrier is None:
        return None
    # Both sides of an equation are one there.
    count = sum(not (rows.equal and rows.sign < 0.0) for rows in asked.parts.rows)
    return LimitReport(report.sides[:count], report.mu, report.excess)


def _active(report: LimitReport) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the steps at which the limit is active."""
    active = np.any([side.active.any(axis=1) for side in report.sides[-2:]], axis=0)
    return np.flatnonzero(active)


def resolved_rows(asked: DiscreteProblem) -> list[Rows] | None:
    """Return the rates that the steps of time of a problem resolve, as limits; None where they are not known."""
    resolved = asked.parts.system.resolved_rates()
    if resolved is None:
        return None
    names, rates = resolved
    first = 0 if asked.parts.free_start is not False else 1
    return Bound(names, -rates, rates, of="rate").rows(asked.parts.system, first)


def within_resolved(asked: DiscreteProblem) -> DiscreteProblem | None:
    """Return a problem with the rates that its steps of time resolve as limits beside its own; None where not known."""
    more = resolved_rows(asked)
    if more is None:
        return None
    # A start that no roll-out can follow opens with gaps, where gaps are allowed.
    gapped: Gapped = "never" if asked.beginning.gapped == "never" else "where needed"
    within = asked.related([*asked.parts.rows, *more], gapped=gapped)
    within.parts.work.count_on(asked.parts.work)
    return within


def resumed(run: Run, result: OptimizationResult, state: SearchState) -> None:
    """Put a run to where an earlier one ended within the limit."""
    asked = run.problem
    assert isinstance(asked, DiscreteProblem)
    within = within_resolved(asked)
    assert within is not None
    asked.beginning.recall(state.begun)
    within.resume(result)
    run.problem, run.asked_problem = within, asked
    run.recall(state.run)


def _judge(run: Run, outcome: Outcome) -> Outcome:
    """Return the end of a run at a minimum with the limit active, with how much shorter steps of time have to be."""
    within, state = run.problem, run.resolved
    if state is None or outcome.status not in (Status.CONVERGED, Status.STALLED):
        return outcome
    assert isinstance(within, DiscreteProblem)
    at = _active(within.parts.report())
    if not at.size:
        return outcome
    system = within.parts.system
    where = ", ".join(system.when(int(k)) for k in at[:_NAMED])
    more = f" and {at.size - _NAMED} more" if at.size > _NAMED else ""
    names = [
        name
        for j, name in enumerate(within.parts.rows[-1].quantity.names)
        if any(side.active[:, j].any() for side in within.parts.report().sides[-2:])
    ]
    shorter = max(2, int(np.ceil(state.angle / _ENOUGH)))
    detail = (
        f"{' and '.join(map(repr, names[:_NAMED]))} would turn further within {where}{more}: take steps of time "
        f"{shorter} times shorter, or weigh inputs (R) or rates (Q) more"
    )
    return Outcome(Status.RESOLVED, detail, outcome.expected)


RESOLVED = Way("resolved", _applies, _begin, judge=_judge)
