"""What steps of time resolve, as a limit: no angle turns by more than some part of a radian within one.

Where a run is stuck because its cost falls towards motions that the steps of time cannot follow, it begins again from
its first trajectory, with that limit beside those that were asked for. At the minimum the limit is dropped where it
holds nothing back: then the run goes on as it was asked for, from there. Where it does, that is how the run ends:
`Status.RESOLVED`, a minimum among motions that these steps of time resolve.
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
from leastaction.optimal.memory import Memory, Resolved
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.search.problem import DiscreteProblem

_ENOUGH = 0.35  # angle (rad) that a step may turn by where steps of time are short enough for a motion
_NAMED = 3  # instants that are named in a message


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where it is stuck at steps of time that are too coarse, once; and where the search within that limit ended."""
    if outcome is None:
        return False
    if run.resolved is not None:
        return True
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if "resolved" in run.taken or outcome.status not in STUCK:
        return False
    return not problem.parts.here.is_open and (outcome.barred or coarse_step(problem, outcome) is not None)


def _begin(run: Run, outcome: Outcome | None) -> bool:
    assert outcome is not None
    return _set_out(run, outcome) if run.resolved is None else _drop(run, outcome)


def _set_out(run: Run, outcome: Outcome) -> bool:
    """Begin again within the limit; whether that can be done."""
    asked = run.problem
    assert isinstance(asked, DiscreteProblem)
    run.taken = (*run.taken, "resolved")
    within = within_resolved(asked)
    if within is None:
        return False
    # From the first trajectory, which has not come to coarse steps yet; from where it stands if that cannot be.
    first, here = asked.beginning.begun.first, (asked.parts.x, asked.parts.u)
    starts = [here] if first is None else [(first.x, first.u), here]
    if not any(_can_start(within, start) for start in starts):
        return False
    steps = [step.angle for step in (asked.worst_step, outcome.refused) if step is not None]
    run.resolved, run.problem, run.asked_problem = Resolved(asked.parts.place(), max(steps, default=0.0)), within, asked
    run.begin_again("", "began again, among motions that the steps of time resolve")
    return True


def _can_start(within: DiscreteProblem, start: tuple[Array, Array]) -> bool:
    try:
        within.start(start)
    except LeastActionError:
        return False
    return True


def _drop(run: Run, outcome: Outcome) -> bool:
    """Go on without the limit, where it holds nothing back; or back to where the run was stuck, if that is cheaper."""
    within, asked, state = run.problem, run.asked_problem, run.resolved
    assert isinstance(within, DiscreteProblem)
    assert isinstance(asked, DiscreteProblem)
    assert state is not None
    report = within.parts.report()
    if outcome.status in (Status.CONVERGED, Status.STALLED):
        if _active(report).size:
            return False
        asked.beginning.go_on_from(within.parts.x, within.parts.u, of_asked(asked, report))
        why = "the steps of time resolve the motion: it goes on without that limit"
    else:
        before = state.before
        if outcome.status is not Status.INFEASIBLE and within.shown <= asked.parts.asked.value(before.x, before.u):
            return False
        asked.beginning.go_on_from(before.x, before.u, None)
        why = "what the steps of time resolve led nowhere: back to where it stood"
    asked.parts.work.count_on(within.parts.work)
    run.resolved, run.problem = None, asked
    run.begin_again("", why)
    return True


def of_asked(asked: DiscreteProblem, report: LimitReport | None) -> LimitReport | None:
    """Return what is told of the limits that were asked for: they come first."""
    if report is None or asked.parts.barrier is None:
        return None
    # Both sides of an equation are one there.
    count = sum(not (rows.equal and rows.sign < 0.0) for rows in asked.parts.rows)
    return LimitReport(report.sides[:count], report.mu, report.excess)


def _active(report: LimitReport) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the steps at which the limit holds the motion back."""
    active = np.any([side.active.any(axis=1) for side in report.sides[-2:]], axis=0)
    return np.flatnonzero(active)


def resolved_rows(asked: DiscreteProblem) -> list[Rows] | None:
    """Return what the steps of time of a problem resolve, as limits; None where nothing is known."""
    resolved = asked.parts.system.resolved_rates()
    if resolved is None:
        return None
    names, rates = resolved
    first = 0 if asked.parts.free_start is not False else 1
    return Bound(names, -rates, rates, of="rate").rows(asked.parts.system, first)


def within_resolved(asked: DiscreteProblem) -> DiscreteProblem | None:
    """Return a problem with what its steps of time resolve as a limit beside its own; None where nothing is known."""
    more = resolved_rows(asked)
    if more is None:
        return None
    rows = [*asked.parts.rows, *more]
    # A start that no roll-out can follow opens with gaps, where gaps are allowed.
    gapped: Gapped = "never" if asked.beginning.gapped == "never" else "where needed"
    parts = asked.parts
    within = DiscreteProblem(parts.system, parts.asked, asked.settings, rows, parts.free_start, gapped)
    within.parts.work.count_on(parts.work)
    return within


def resumed(run: Run, result: OptimizationResult, memory: Memory) -> None:
    """Have a run stand where an earlier one ended within the limit."""
    asked = run.problem
    assert isinstance(asked, DiscreteProblem)
    within = within_resolved(asked)
    assert within is not None
    asked.beginning.recall(memory)
    within.resume(result)
    run.problem, run.asked_problem = within, asked
    run.recall(memory)


def _judge(run: Run, outcome: Outcome) -> Outcome:
    """Return that it is a minimum of motions that the steps of time resolve, and how much shorter they have to be."""
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
