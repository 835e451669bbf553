"""Where a motion begins: with hanging strings, an earlier run, or what a search finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

from leastaction.errors import ProjectionError
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import bars_of, held_strings, tie_strings
from leastaction.optimal import OptimizationResult
from leastaction_marionette.tracking import tying
from leastaction_marionette.tracking.found import Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import FIRST_KINDS, KINDS
from leastaction_marionette.tracking.motors import search
from leastaction_marionette.tracking.parts import found_in_parts
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM
from leastaction_marionette.tracking.tracker import PATIENCE, Curve, Tracker, improved, slower

_LOST: Final = 2.0  # share of the cost with longer steps that a motion costs with its own where feedback has lost it

Search = Callable[[Tracker], Tracker]


def begun(
    tracker: Tracker, resume: TrackingRun | TrackingSearch | None, *, planned: bool
) -> tuple[Tracker, Search | None]:
    """Return a tracker where it begins: with what hanging strings do, where a run was, or with what a search finds.

    And how a first trajectory is sought if a puppet that is held still, with which it is to begin, leads nowhere.
    """
    if isinstance(resume, TrackingRun):
        return _gone_on(tracker, resume), None
    hanging = tracker.problem.hang() if resume is None and not planned else None
    return _sought(tracker, resume) if hanging is None else (replace(tracker, start=hanging, patience=PATIENCE), None)


def on_one_bar(mechanism: Mechanism) -> bool:
    """Whether all strings are tied to one bar.

    What strings of any lengths make is far from what the six numbers of its pose do, and no way leads from there.
    """
    return len(bars_of(mechanism)) == 1 and not held_strings(mechanism)


def _gone_on(tracker: Tracker, run: TrackingRun) -> Tracker:
    """Return a tracker where a run was."""
    effort = run.effort or Effort().plus(run.plan or run.result)
    tracker = replace(tracker, kinds=run.kinds, effort=effort, earlier=run.unfinished or run.result, grows=False)
    if run.embedded and run.unfinished is None:
        tracker = replace(tracker.planned(), earlier=run.plan)
        if tracker.ties is not None:
            tracker = tracker.tied(FIRM[-2], firm=True)
        if run.plan is not None and run.plan.limits is None:  # a puppet that is held still: no search has known any
            tracker = replace(tracker, start=run.plan, earlier=None)
    return replace(tracker, patience=PATIENCE - (0 if tracker.earlier is None else tracker.earlier.iterations))


def _sought(tracker: Tracker, cut_short: TrackingSearch | None) -> tuple[Tracker, Search | None]:
    """Seek a first trajectory with motors, or go on with a search that was cut short; see `begun`."""
    if cut_short is not None and cut_short.firmness is not None:
        return tying.gone_on(tracker, cut_short), None
    if cut_short is None:
        tracker = replace(tracker, mechanism=tie_strings(tracker.mechanism, tracker.problem.reference))
    tracker = tracker.planned()
    if cut_short is not None:
        tracker = replace(tracker, effort=cut_short.effort, kinds=cut_short.kinds)
    if tracker.ties is None and (cut_short is None or cut_short.parts is not None):
        tracker, joined = found_in_parts(tracker, _followed, cut_short)
        if joined is not None:
            tracker.say("the parts are joined")
            kinds = tracker.kinds | FIRST_KINDS | tracker.broken(joined[0])
            return replace(tracker, start=joined, shooting="multiple", kinds=kinds), None
        cut_short = None
    if cut_short is None and on_one_bar(tracker.mechanism):
        return tracker, partial(_with_motors, cut_short=None)
    return _with_motors(tracker, cut_short), None


def _with_motors(tracker: Tracker, cut_short: TrackingSearch | None) -> Tracker:
    """Return a tracker with what motors on all joints lead to, or where a search with them was."""
    plan = tracker.plan
    assert plan is not None
    stage, before = (0, None) if cut_short is None else (cut_short.stage, cut_short.result)
    slow = slower(tracker.motion)
    coarse = plan if slow is tracker.motion else plan.following(slow)
    # A search that had to take the plan's own steps goes on with them.
    searched = plan if before is not None and len(before.u) == plan.system.N else coarse
    scale, keep = plan.system.N / searched.system.N, partial(_keep_search, tracker)
    x, u, effort = search(
        searched, tracker.say, stage=stage, result=before, effort=tracker.effort, scale=scale, keep=keep
    )
    tracker = replace(tracker, start=(x, u), effort=effort)
    if tracker.ties is not None and searched is not plan:
        # What is still to be tied is not worth short steps.
        tracker.say(f"strings on bars are tied with steps of {searched.dt:.3g} s at first")
        tracker = replace(tracker, slow=slow, plan=searched, problem=searched.problem)
    elif searched is not plan:
        fine = plan.finer(searched, x, u)
        expected = searched.cost().value(x, u) * scale
        start = plan.inside(*fine, expected)
        # What feedback cannot follow is begun with gaps between its steps.
        followed = start[0] is not fine[0] or _is_followed(plan, start, _LOST * expected)
        tracker = replace(tracker, start=start, shooting="single" if followed else "multiple")
    # What leads to strings that are tied had better lead to where they can be.
    broken = tracker.broken(tracker.start[0]) if isinstance(tracker.start, tuple) else frozenset[str]()
    return replace(tracker, kinds=frozenset(KINDS) if tracker.ties is not None else FIRST_KINDS | broken)


def _is_followed(plan: TrackingPlan, start: Curve, most: float) -> bool:
    """Whether feedback can follow a curve, to a motion that costs no more than that."""
    try:
        found = optimize(plan.system, plan.cost(), initial=start, shooting="single", max_iterations=0)
    except ProjectionError:
        return False
    return found.cost <= most


def _followed(part: Tracker) -> tuple[Tracker, OptimizationResult]:
    """Return what is found of a part of a motion."""
    part, _ = begun(part, None, planned=True)
    return improved(part)


def _keep_search(tracker: Tracker, stage: int, found: OptimizationResult, effort: Effort, at_once: bool) -> None:
    tracker.kept(
        lambda: TrackingSearch(
            mechanism=tracker.mechanism,
            motion=tracker.motion,
            stage=stage,
            result=found,
            follow=tracker.follow,
            effort=effort,
        ),
        at_once=at_once,
    )
