"""Where a motion begins: with hanging strings, an earlier run, or what a search finds.

And where else, if that leads nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import bars_of, held_strings, tie_strings
from leastaction.optimal import OptimizationResult
from leastaction_marionette.tracking import tying
from leastaction_marionette.tracking.found import Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.gaps import closed
from leastaction_marionette.tracking.growing import grown
from leastaction_marionette.tracking.limits import FIRST_KINDS, KINDS
from leastaction_marionette.tracking.motors import search
from leastaction_marionette.tracking.parts import found_in_parts
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import hanging
from leastaction_marionette.tracking.problem import below_strings
from leastaction_marionette.tracking.ties import FIRM
from leastaction_marionette.tracking.tracker import AGAIN, GAPS, LOST, PATIENCE, Curve, Tracker
from leastaction_marionette.tracking.weights import GENTLE

_WHOLE: Final = "the parts cannot be joined: the search begins again with all of the motion"
_GROWING: Final = "the motion found cannot be followed: ever larger parts of the wanted one are"
_HANGING: Final = "the motion found cannot be followed: it begins with a puppet that hangs still"


def begin(tracker: Tracker, resume: TrackingRun | TrackingSearch | None, *, planned: bool) -> None:
    """Find where to begin: what hanging strings do, where a run was, or what a search finds."""
    tracker.motion, lowered = below_strings(tracker.mechanism, tracker.motion)
    if lowered > 0.0:
        tracker.say(f"the motion rises above the plane of the strings: lowered there, by up to {lowered:.2g} m")
    tracker.problem = tracker.problem_with(GENTLE)
    tracker.patience = PATIENCE
    if isinstance(resume, TrackingRun):
        _go_on(tracker, resume)
        return
    hanging = tracker.problem.hang() if resume is None and not planned else None
    if hanging is None:
        _search(tracker, resume)
    else:
        tracker.start = hanging


def on_one_bar(mechanism: Mechanism) -> bool:
    """Whether all strings are tied to one bar.

    What strings of any lengths make is far from what the six numbers of its pose do, and no way leads from there.
    """
    return len(bars_of(mechanism)) == 1 and not held_strings(mechanism)


def _go_on(tracker: Tracker, run: TrackingRun) -> None:
    """Begin where a run was."""
    tracker.kinds = run.kinds
    tracker.effort = run.effort or Effort().plus(run.plan or run.result)
    tracker.earlier = run.unfinished or run.result
    if run.embedded and run.unfinished is None:
        tracker.plan, tracker.earlier = tracker.planned(), run.plan
        if tracker.plan.ties is not None:
            tracker.plan.ties.weight, tracker.plan.ties.firm = FIRM[-2], True
        if run.plan is not None and run.plan.limits is None:  # a puppet that is held still: no search has known any
            tracker.start, tracker.earlier = run.plan, None
    tracker.patience = PATIENCE - (0 if tracker.earlier is None else tracker.earlier.iterations)


def _search(tracker: Tracker, cut_short: TrackingSearch | None) -> None:
    """Seek a first trajectory with motors, or go on with a search that was cut short."""
    if cut_short is not None and cut_short.firmness is not None:
        tying.go_on(tracker, cut_short)
        return
    if cut_short is None:
        tracker.mechanism = tie_strings(tracker.mechanism, tracker.problem.reference)
    tracker.plan = plan = tracker.planned()
    if cut_short is not None:
        tracker.effort, tracker.kinds = cut_short.effort, cut_short.kinds
    if plan.ties is None and (cut_short is None or cut_short.parts is not None):
        joined = found_in_parts(tracker, _followed, cut_short)
        if joined is not None:
            tracker.kinds |= FIRST_KINDS | tracker.broken(joined[0])
            tracker.say("the parts are joined")
            tracker.start = closed(tracker, joined)
            tracker.most = LOST * plan.cost().value(*tracker.start)
            tracker.others = [(_WHOLE, partial(_searched_by, tracker, plan)), *_elsewhere(tracker)]
            return
        cut_short = None
    if cut_short is None and on_one_bar(tracker.mechanism):
        tracker.search = partial(_search_with_motors, tracker, plan, None)
    else:
        _search_with_motors(tracker, plan, cut_short)


def _search_with_motors(tracker: Tracker, plan: TrackingPlan, cut_short: TrackingSearch | None) -> None:
    """Begin with what motors on all joints lead to, or where a search with them was."""
    stage, before = (0, None) if cut_short is None else (cut_short.stage, cut_short.result)
    coarse, slow = coarser(plan, tracker.motion)
    # A search that had to take the plan's own steps goes on with them.
    searched = plan if before is not None and len(before.u) == plan.system.N else coarse
    found = _searched_by(tracker, searched, stage=stage, result=before)
    tracker.start = found
    if plan.ties is not None and searched is not plan:
        # What is still to be tied is not worth short steps.
        tracker.say(f"strings on bars are tied with steps of {searched.dt:.3g} s at first")
        tracker.slow, tracker.plan = slow, searched
        tracker.problem = searched.problem
    elif searched is not plan:
        expected = searched.cost().value(*found) * plan.system.N / searched.system.N
        fine = plan.finer(searched, *found)
        tracker.start, tracker.most = plan.inside(*fine, expected), LOST * expected
        tracker.others += [(GAPS, partial(closed, tracker, fine)), (AGAIN, partial(_searched_by, tracker, plan))]
    tracker.others += _elsewhere(tracker)
    # What leads to strings that are tied had better lead to where they can be.
    tracker.kinds = frozenset(KINDS) if plan.ties is not None else FIRST_KINDS | tracker.broken(tracker.start[0])


def _followed(part: Tracker) -> OptimizationResult:
    """Return what is found of a part of a motion."""
    begin(part, None, planned=True)
    return part.improve()


def _elsewhere(tracker: Tracker) -> list[tuple[str, Callable[[], Curve]]]:
    """Return where else a motion may begin, with what is said of it."""
    return [(_GROWING, partial(_grown, tracker)), (_HANGING, partial(_hanging, tracker))]


def _searched_by(
    tracker: Tracker, plan: TrackingPlan, *, stage: int = 0, result: OptimizationResult | None = None
) -> Curve:
    assert tracker.plan is not None
    scale = tracker.plan.system.N / plan.system.N
    return search(
        plan,
        tracker.say,
        stage=stage,
        result=result,
        keep=partial(_keep_search, tracker),
        count=lambda found, motors: tracker.spend(found, None if motors else scale),
    )


def _grown(tracker: Tracker) -> Curve:
    """Return what following ever larger parts of the motion leads to; all limits are stated on that way."""
    assert tracker.plan is not None
    tracker.kinds = frozenset(KINDS)
    return grown(tracker.plan, *coarser(tracker.plan, tracker.stepped), tracker.say, tracker.spend)


def _keep_search(tracker: Tracker, stage: int, found: OptimizationResult, at_once: bool) -> None:
    tracker.kept(
        lambda: TrackingSearch(
            mechanism=tracker.mechanism,
            motion=tracker.motion,
            stage=stage,
            result=found,
            follow=tracker.follow,
            effort=tracker.effort,
        ),
        at_once=at_once,
    )


def _hanging(tracker: Tracker) -> Curve:
    assert tracker.plan is not None
    return hanging(tracker.plan)


def coarser(plan: TrackingPlan, motion: Motion) -> tuple[TrackingPlan, Motion]:
    """Return a plan with steps of twice the length, and its motion; those given where it has few, or long ones."""
    slow = tying.slower(motion)
    return (plan, motion) if slow is motion else (plan.following(slow), slow)
