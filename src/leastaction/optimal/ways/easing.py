"""An easier cost first: inputs that are much dearer, from the motion of least effort, and ever less so."""

from __future__ import annotations

from leastaction.optimal.discrete.easing import EasedProblem
from leastaction.optimal.limits.problem import LimitedProblem
from leastaction.optimal.loop.ending import LOST, STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way

_WITHIN = "easing among resolved motions"  # its name among the ways that were taken


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where the first steps had to be cut short, and where a run is stuck; once, and once among resolved motions."""
    problem = run.problem
    if not isinstance(problem, (EasedProblem, LimitedProblem)):
        return False
    if run.resolved is not None:
        return outcome is not None and outcome.status in STUCK and _WITHIN not in run.taken
    if run.began_again:
        return False
    if isinstance(problem, LimitedProblem) and problem.final_time is not None:
        return False
    if outcome is None:
        return run.has_just_begun and run.was_violent and problem.tells_violence
    return outcome is LOST or outcome.status in STUCK


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, (EasedProblem, LimitedProblem))
    if not problem.begin_with_ease():
        return False
    run.begin_again("easing" if run.resolved is None else _WITHIN, "began again, where searches would lead nowhere")
    return True


EASING = Way("easing", _applies, _begin)
