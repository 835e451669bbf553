"""How a motion whose strings on bars vary in length becomes one on which they keep it, optimisation by optimisation.

What `track` does of it, from one `Tracker` to the next. `ties.py` has the price. On one bar for all strings it begins
with a puppet that is held still; on others where the motion found first cannot be tied.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError
from leastaction.optimal import OptimizationResult, Status
from leastaction_marionette.tracking.found import CUT_SHORT, STUCK, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import KINDS
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import held_still
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM, LOOSE, Ties
from leastaction_marionette.tracking.tracker import Tracker, improved, slower

# Iterations in which strings on bars are tied loosely; firmly, but the last time.
_LEADING: Final = 60
_TYING: Final = 200
_TOO_LOOSE: Final = 0.04  # m, by which strings on bars may not vary any more where their lengths are fixed
_SETTLED: Final = 1e-4  # m, by which they may vary to be settled (`settle.py`)
_NEARLY: Final = 1e-3  # m, the same where they cannot be tied more firmly
_FIRST: Final = 2  # times that strings are tied, that say nothing of the next
_GROWS: Final = 4.0  # times what one adds to the cost does the next, where strings are not to be tied
_GAINS_NOTHING: Final = 1.01  # times its cost is at most that of a minimum found before
_NOT_TIED: Final = (
    "The best motion found could not be tied to bars: this is one near it on which strings keep their lengths."
)


Found = tuple[Tracker, OptimizationResult]


def tied(
    tracker: Tracker,
    search: Callable[[Tracker], Tracker] | None = None,
    *,
    earlier: OptimizationResult | None = None,
) -> Found:
    """Return what is found from where a tracker stands, with strings on bars that hardly vary.

    From a puppet at rest where that leads to none, or where nothing else was sought: then ``search`` is how it is
    sought where that leads nowhere. ``earlier``: what the run had found that is gone on with.
    """
    if search is not None:
        tracker.say("all strings are tied to one bar: it begins with a puppet that is held still")
        tracker, still = from_still(tracker, None, tracker.left)
        if still is not None:
            return tracker, still
        tracker.say("no motion is found from there: it is sought with motors")
        tracker = search(tracker)
    tracker, result = improved(tracker)
    if not tracker.varies:
        # Strings that are tied firmly make rounding look like negative curvature: what was a minimum still is.
        if earlier is None or not earlier.success or result.status not in STUCK:
            return tracker, result
        return tracker, earlier if earlier.cost <= _GAINS_NOTHING * result.cost else result
    left = tracker.left
    tracker, found = _tied_from(tracker, result, LOOSE, left, most=_of_still(tracker, result))
    if found.success or found.status in CUT_SHORT or tracker.left < 1:
        return tracker, found
    tracker.say("strings on bars cannot be tied on the motion found: it begins with a puppet that is held still")
    tracker, still = from_still(tracker, found, left)
    return tracker, still or found


def from_still(
    tracker: Tracker, near: OptimizationResult | None, left: int
) -> tuple[Tracker, OptimizationResult | None]:
    """Return what is found from a puppet that is held still, whose strings are tied firmly.

    ``near``, ``left``: as of `held` and `_tied_from`. None where nothing holds it or strings still vary: with the
    tracker as it was, but for what was spent.
    """
    spent = tracker
    with suppress(LeastActionError):
        spent, still = held(_with_longer_steps(tracker), near)
        # Its strings keep their lengths: tied loosely it would go back to where it came from.
        spent, found = _tied_from(spent, still, FIRM[:1], left)
        lasts = spent.plan is not None and not spent.varies
        if lasts or found.success or found.status in CUT_SHORT or spent.left < 1:
            return replace(spent, began_still=True), found
    return replace(tracker, slow=None, effort=spent.effort, left=spent.left), None


def held(tracker: Tracker, near: OptimizationResult | None) -> Found:
    """Return the puppet at rest, with strings on bars tied as they are there.

    ``near``: what was found instead; None for nothing. Raises `ArgumentError`: it is held nowhere.
    """
    assert tracker.plan is not None
    still = held_still(tracker.plan, near or _hung(tracker.plan))
    tracker = replace(with_lengths_of(tracker, still), kinds=frozenset(KINDS))
    assert tracker.plan is not None
    return tracker, replace(still, cost=tracker.plan.cost().value(still.x, still.u))


def or_still(tracker: Tracker, run: TrackingRun) -> TrackingRun:
    """Return a run on bars that is no minimum, or the puppet held still where that is nearer to what is wanted."""
    assert run.plan is not None
    try:
        tracker, found = held(tracker, run.plan)
        still = tracker.run_of(found)
    except ArgumentError:
        return run
    return run if run.off <= still.off else still


def with_lengths_of(tracker: Tracker, result: OptimizationResult) -> Tracker:
    """Return a tracker whose strings on bars have the lengths that suit a motion of its plan."""
    ties = _ties(tracker)
    lengths = ties.distances(result.x).mean(axis=0)
    named = dict(zip(ties.names, map(float, lengths), strict=True))
    return replace(tracker, mechanism=tracker.mechanism.with_parameters(named)).planned()


def gone_on(tracker: Tracker, search: TrackingSearch) -> Tracker:
    """Return a tracker where a search was that tied strings on bars."""
    assert search.firmness is not None
    tracker = replace(
        tracker, mechanism=search.mechanism, effort=search.effort, kinds=search.kinds, earlier=search.result
    ).planned()
    assert tracker.plan is not None
    if len(search.result.u) < tracker.plan.system.N:
        tracker = _with_longer_steps(tracker)
    if tracker.ties is None:
        raise ArgumentError("resume: its strings are tied to bars, and those of the mechanism are not")
    return tracker.tied(search.firmness)


def _hung(plan: TrackingPlan) -> OptimizationResult:
    """Return the puppet's first pose for all time, which its strings do not hold, as if it had been found."""
    return optimize(plan.system, plan.cost(), initial=plan.hanging(), shooting="multiple", max_iterations=0)


def _tied_from(
    tracker: Tracker, result: OptimizationResult, weights: Sequence[float], left: int, *, most: float = np.inf
) -> Found:
    """Return what is found from a motion, first with some weights and perhaps longer steps, then with the firm ones.

    ``left``: iterations of the last optimisation. ``most``: as of `_more_firmly`.
    """
    if tracker.slow is None:
        further = [weight for weight in sorted({*weights, *FIRM}) if weight > _ties(tracker).weight]
        return _more_firmly(tracker, result, further, left, most=most)
    further = [weight for weight in weights if weight > _ties(tracker).weight]
    tracker, result = _more_firmly(tracker, result, further, left, most=most)
    tracker, found = _with_its_own_steps(tracker, result)
    if result.status in CUT_SHORT or result.message == _NOT_TIED:
        return tracker, found
    return _more_firmly(tracker, found, FIRM, left)


def _with_longer_steps(tracker: Tracker) -> Tracker:
    """Return a tracker with steps of twice the length, where the motion has many."""
    longer = slower(tracker.motion)
    return replace(tracker, slow=None if longer is tracker.motion else longer).planned()


def _with_its_own_steps(tracker: Tracker, result: OptimizationResult) -> Found:
    """Return what was tied with longer steps than the motion's own as a motion with these, which is no minimum yet."""
    coarse = tracker.plan
    tracker = replace(tracker, slow=None).planned().tied(_ties(tracker).weight)
    plan = tracker.plan
    assert coarse is not None
    assert plan is not None
    N = plan.system.N
    x, u = plan.inside(*plan.finer(coarse, result.x, result.u), result.cost * N / coarse.system.N)
    none = np.zeros((N, plan.system.nu, plan.system.ndx))
    cost, status = plan.cost().value(x, u), Status.ITERATION_LIMIT if result.success else result.status
    found = replace(result, x=x, u=u, K=none, projection_gain=none, cost=cost, limits=None, status=status, state=None)
    return tracker, found


def _of_still(tracker: Tracker, near: OptimizationResult) -> float:
    """Return what a puppet that is held still costs, whose strings keep any lengths; infinity if there is none."""
    assert tracker.plan is not None
    try:
        still = held_still(tracker.plan, near)
    except ArgumentError:
        return np.inf
    return tracker.plan.untied_cost().value(still.x, still.u)


def _more_firmly(
    tracker: Tracker, result: OptimizationResult, weights: Sequence[float], left: int, *, most: float = np.inf
) -> Found:
    """Return what is found where each optimisation ties strings on bars more firmly than the last.

    ``left``: iterations of the firmest. ``most``: that the last of them may cost, as far as that can be foretold.
    """
    tracker = replace(tracker, left=left)
    costs, offs = [result.cost], list[float]()
    for weight in weights:
        if result.status in CUT_SHORT or left < 1:
            return tracker, result
        not_tied = replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        if _foretold(costs, sum(each >= weight for each in (*LOOSE, *FIRM))) > most:
            return replace(tracker, left=left), not_tied
        if weight <= FIRM[0]:
            tracker = with_lengths_of(tracker, result)
        off = float(np.abs(_ties(tracker).off(result.x)).max())
        offs.append(off)
        if _expected(offs, sum(weight <= each for each in LOOSE)) > _TOO_LOOSE:
            return replace(tracker, left=left), not_tied
        if weight > FIRM[0] and off < _SETTLED and result.success:
            break
        tracker.say(f"strings on bars vary by {1e3 * off:.2g} mm: tied more firmly")
        iterations = left if weight == FIRM[-1] else _LEADING if weight in LOOSE else _TYING
        tracker = replace(tracker.tied(weight), start=result, earlier=None, left=iterations)
        try:
            tracker, firmer = improved(tracker)
        except ProjectionError as error:
            tracker.say(f"strings cannot be tied more firmly: {error}")
            return replace(tracker, left=left), not_tied
        if result.success and weight > FIRM[0] and off < _NEARLY and firmer.status in STUCK:
            break  # so firmly that rounding of what lengths cost looks like negative curvature
        result = firmer
        costs.append(result.cost)
    return tracker.tied(_ties(tracker).weight, firm=result.success), result


def _expected(offs: Sequence[float], remaining: int) -> float:
    """Return by how much strings will vary after they were tied some more times, given by how much they did.

    Where that is less each time it goes on so, but for the first times, when their lengths are still sought.
    """
    if not remaining:
        return offs[-1]
    return offs[-1] * min(offs[-1] / offs[-2], 1.0) ** remaining if len(offs) > _FIRST else 0.0


def _foretold(costs: Sequence[float], remaining: int) -> float:
    """Return what is to be paid after some more optimisations, by what the earlier ones have cost.

    Near a motion on which strings keep their lengths each soon adds less than the one before. Where it adds several
    times as much there is none near, and the next ones add no less.
    """
    added = np.diff(costs)
    grows = len(added) > 1 and added[-1] > _GROWS * max(added[-2], 0.0)
    return float(costs[-1] + (remaining * added[-1] if grows else 0.0))


def _ties(tracker: Tracker) -> Ties:
    assert tracker.ties is not None
    return tracker.ties
