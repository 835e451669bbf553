"""How an optimisation ended, or will end, in words."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf, log, nan
from typing import Any

from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.loop.problem import Direction, Problem
from leastaction.optimal.loop.run import Run
from leastaction.optimal.result import Status

STUCK = (Status.STALLED, Status.LINE_SEARCH_FAILED, Status.SADDLE)
"""How a stage ends that another way may lead out of."""

# How a run ends whose minimum is no motion that the steps of time resolve: they do where angles move by less (rad).
_COARSE = (
    "The cost falls towards motions that the steps of time cannot follow, and the search ended where the next steps "
    "have no solution."
)
_BARRED = "The cost falls towards motions in which a step of time has no solution, and the search ended before one."
_RESOLVED = 0.5

# Iterations by which the speed of a run is told, at most and at least; the part of the expected decrease that each of a
# fast one leaves.
_LOOKED_BACK, _TELLING, _FAST = 10, 3, 0.9

# Times the first cost, and one, below zero: a cost that falls that far has no minimum; and where limits are violated,
# which may yet become dearer, before squares are infinite.
_BOTTOMLESS, _ABYSS = 1e15, 1e100


@dataclass(frozen=True)
class Outcome:
    """How a stage ended: the status, its particulars in words, and the expected decrease there.

    ``barred``: whether the search ended because steps of time had no solution. ``refused``: the coarsest step of time
    of what it tried last and refused for it; None where that is not known.
    """

    status: Status
    detail: str = ""
    expected: float = nan
    barred: bool = False
    refused: StepQuality | None = None


LOST = Outcome(Status.ITERATION_LIMIT, "the gaps did not close")
"""How gaps end that do not close, where the run had begun violently: it is not stuck, but likely to get lost."""


class EndFound(Exception):
    """The search for a direction has come to an end of the optimisation."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.detail)
        self.outcome = outcome


def bottomless(run: Run) -> bool:
    """Whether the cost falls so far below zero that it will have no minimum.

    What falls where limits are violated may be caught by these, when they are dearer.
    """
    return _is_deep(run, _BOTTOMLESS) and (not run.problem.stages.violated or _is_deep(run, _ABYSS))


def _is_deep(run: Run, times: float) -> bool:
    first, last = run.history.cost[0], run.history.cost[-1]
    return last < -times * max(1.0, abs(first))


def unless_bottomless(run: Run, outcome: Outcome) -> Outcome:
    """Return the end of a run; of one that was stuck where its cost had no bottom, that it has none."""
    stuck = outcome.status in (*STUCK, Status.NO_DIRECTION, Status.DERIVATIVES_FAILED)
    return Outcome(Status.UNBOUNDED, expected=outcome.expected) if stuck and _is_deep(run, _BOTTOMLESS) else outcome


def message(problem: Problem[Any, Any, Any], outcome: Outcome) -> str:
    """Return how it ended in words; of an end that is no proper one, with the instant at which time is coarsest."""
    status, worst = outcome.status, problem.here.worst_step
    detail = outcome.detail and outcome.detail.removesuffix(".") + "."
    parts = [status.value, detail, problem.stages.unfinished]
    if status in (Status.SADDLE, Status.NO_DIRECTION) and problem.report.undetermined:
        parts = [problem.report.undetermined]
    if status is not Status.INFEASIBLE:
        parts.append(problem.stages.violated)
    if worst is not None and status in (*STUCK, Status.NO_DIRECTION):
        parts.append(f"Along the last iterate {worst}.")
        coarse = coarse_step(problem, outcome)
        if coarse is not None and status is not Status.STALLED:
            tried = [] if coarse is worst else [f"In what was tried last {coarse}."]
            parts = [_COARSE, *_what_helps(coarse), *parts[1:], *tried]
        elif outcome.barred:
            parts = [_BARRED, *_what_helps(worst), *parts[1:]]
    return " ".join(part for part in parts if part)


def coarse_step(problem: Problem[Any, Any, Any], outcome: Outcome) -> StepQuality | None:
    """Return the step of time that is too long where a run has ended, or in what it tried last; None if none is."""
    steps = (problem.here.worst_step, outcome.refused)
    return next((step for step in steps if step is not None and step.is_coarse), None)


def _what_helps(worst: StepQuality) -> list[str]:
    """Return what to try where the coarsest step is too long."""
    shorter = max(2, ceil(worst.angle / _RESOLVED))
    thrown = f", so that {worst.variable!r} is not thrown that fast" * bool(worst.variable)
    return [f"Take steps of time {shorter} times shorter, or weigh inputs (R) or rates (Q) more{thrown}."]


def outlook(run: Run, direction: Direction) -> str:
    """Return what a run that is cut off was about to do, how fast it was, and what may help."""
    if run.problem.stages.unfinished:
        return ""
    expected, goal = -direction.slope, run.goal
    begins = f"The expected decrease is still {expected:.2g}, where {goal:.2g} is asked for"
    costs = run.history.cost[-1 - _LOOKED_BACK :]
    count = len(costs) - 1
    if count < _TELLING:
        return f"{begins}."
    where = run.problem.report.where(direction)
    begins += f"; most of it is that of {where}." if where else "."
    fall = (costs[0] - costs[-1]) / max(abs(costs[-1]), 1e-300)
    if not fall > 0.0:
        return begins
    before = run.history.expected_decreases[-count]
    # Among barriers a refined direction may be expected to gain nothing, and lower the cost all the same.
    rate = (expected / before) ** (1.0 / count) if expected > 0.0 < before else inf
    if rate >= _FAST:
        ends = (
            "; it creeps along a flat valley. Weigh in the cost what moves there, which determines the minimum "
            f"better (a larger R for that input), take a tolerance above {expected / abs(costs[-1]):.1g}, or start "
            "elsewhere."
        )
    elif goal > 0.0:
        ends = f"; at their rate some {ceil(log(goal / expected) / log(rate))} more are needed."
    else:
        ends = "."
    return f"{begins} The last {count} iterations lowered the cost by {fall:.2g} of itself{ends}"
