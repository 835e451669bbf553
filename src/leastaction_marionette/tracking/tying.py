"""How a motion whose strings on bars vary in length becomes one on which they keep it, optimisation by optimisation.

What `track` does of it, with its `Tracker`. `ties.py` has the price. On one bar for all strings it begins with a puppet
that is held still; on others where the motion found first cannot be tied.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError
from leastaction.io import Motion
from leastaction.optimal import OptimizationResult, Status
from leastaction_marionette.tracking.found import CUT_SHORT, STUCK, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import KINDS
from leastaction_marionette.tracking.poses import held_still
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM, LOOSE, Ties
from leastaction_marionette.tracking.tracker import Tracker

# Iterations in which strings on bars are tied loosely; firmly, but the last time.
_LEADING: Final = 60
_TYING: Final = 200
_TOO_LOOSE: Final = 0.04  # m, by which strings on bars may not vary any more where their lengths are fixed
_SETTLED: Final = 1e-4  # m, by which they may vary to be settled (`settle.py`)
_NEARLY: Final = 1e-3  # m, the same where they cannot be tied more firmly
_FIRST: Final = 2  # times that strings are tied, that say nothing of the next
_LONGEST: Final = 0.021  # s, of the steps with which a captured motion can be searched
_FEW: Final = 100  # steps, for which a search with longer ones is not worth it
_GROWS: Final = 4.0  # times what one adds to the cost does the next, where strings are not to be tied
_GAINS_NOTHING: Final = 1.01  # times its cost is at most that of a minimum found before
_NOT_TIED: Final = (
    "The best motion found could not be tied to bars: this is one near it on which strings keep their lengths."
)


def tied(tracker: Tracker, *, earlier: OptimizationResult | None = None) -> OptimizationResult:
    """Return what is found from where a tracker stands, with strings on bars that hardly vary.

    From a puppet at rest where that leads to none, or where nothing else was sought. ``earlier``: what the run had
    found that is gone on with.
    """
    if tracker.search is not None:
        search, tracker.search = tracker.search, None
        tracker.say("all strings are tied to one bar: it begins with a puppet that is held still")
        still = from_still(tracker, None, tracker.left)
        if still is not None:
            return still
        tracker.say("no motion is found from there: it is sought with motors")
        search()
    result = tracker.improve()
    if tracker.plan is None or not tracker.plan.varies:
        # Strings that are tied firmly make rounding look like negative curvature: what was a minimum still is.
        if earlier is None or not earlier.success or result.status not in STUCK:
            return result
        return earlier if earlier.cost <= _GAINS_NOTHING * result.cost else result
    left = tracker.left
    found = _tied_from(tracker, result, LOOSE, left, most=_of_still(tracker, result))
    if found.success or found.status in CUT_SHORT or tracker.left < 1:
        return found
    tracker.say("strings on bars cannot be tied on the motion found: it begins with a puppet that is held still")
    return from_still(tracker, found, left) or found


def from_still(tracker: Tracker, near: OptimizationResult | None, left: int) -> OptimizationResult | None:
    """Return what is found from a puppet that is held still, whose strings are tied firmly.

    ``near``, ``left``: as of `holds_still` and `_tied_from`. None where nothing holds it or strings still vary; then
    the tracker is as it was.
    """
    before = tracker.mechanism, tracker.problem, tracker.plan, tracker.kinds
    _take_longer_steps(tracker)
    with suppress(LeastActionError):
        still = holds_still(tracker, near or _hung(tracker))
        # Its strings keep their lengths: tied loosely it would go back to where it came from.
        found = _tied_from(tracker, still, FIRM[:1], left)
        lasts = tracker.plan is not None and not tracker.plan.varies
        if lasts or found.success or found.status in CUT_SHORT or tracker.left < 1:
            tracker.began_still = True
            return found
    tracker.slow = None
    tracker.mechanism, tracker.problem, tracker.plan, tracker.kinds = before
    return None


def _hung(tracker: Tracker) -> OptimizationResult:
    """Return the puppet's first pose for all time, which its strings do not hold, as if it had been found."""
    plan = tracker.plan
    assert plan is not None
    return optimize(plan.system, plan.cost(), initial=plan.hanging(), shooting="multiple", max_iterations=0)


def _tied_from(
    tracker: Tracker, result: OptimizationResult, weights: Sequence[float], left: int, *, most: float = np.inf
) -> OptimizationResult:
    """Return what is found from a motion, first with some weights and perhaps longer steps, then with the firm ones.

    ``left``: iterations of the last optimisation. ``most``: as of `_more_firmly`.
    """
    if tracker.slow is None:
        further = [weight for weight in sorted({*weights, *FIRM}) if weight > _ties(tracker).weight]
        return _more_firmly(tracker, result, further, left, most=most)
    further = [weight for weight in weights if weight > _ties(tracker).weight]
    result = _more_firmly(tracker, result, further, left, most=most)
    found = _with_its_own_steps(tracker, result)
    if result.status in CUT_SHORT or result.message == _NOT_TIED:
        return found
    return _more_firmly(tracker, found, FIRM, left)


def _take_longer_steps(tracker: Tracker) -> None:
    """Go on with steps of twice the length, where the motion has many."""
    longer = slower(tracker.motion)
    tracker.slow = None if longer is tracker.motion else longer
    tracker.plan = tracker.planned()


def _with_its_own_steps(tracker: Tracker, result: OptimizationResult) -> OptimizationResult:
    """Return what was tied with longer steps than the motion's own as a motion with these, which is no minimum yet."""
    coarse = tracker.plan
    assert coarse is not None
    weight, tracker.slow = _ties(tracker).weight, None
    tracker.plan = plan = tracker.planned()
    _ties(tracker).weight = weight
    N = plan.system.N
    x, u = plan.inside(*plan.finer(coarse, result.x, result.u), result.cost * N / coarse.system.N)
    none = np.zeros((N, plan.system.nu, plan.system.nx))
    cost, status = plan.cost().value(x, u), Status.ITERATION_LIMIT if result.success else result.status
    return replace(result, x=x, u=u, K=none, projection_gain=none, cost=cost, limits=None, status=status, memory=None)


def holds_still(tracker: Tracker, near: OptimizationResult) -> OptimizationResult:
    """Return the puppet at rest, with strings on bars tied as they are there; ``near``: what was found instead."""
    assert tracker.plan is not None
    still = held_still(tracker.plan, near)
    tie(tracker, still)
    tracker.kinds = frozenset(KINDS)
    return replace(still, cost=tracker.plan.cost().value(still.x, still.u))


def or_still(tracker: Tracker, run: TrackingRun) -> TrackingRun:
    """Return a run on bars that is no minimum, or the puppet held still where that is nearer to what is wanted."""
    assert run.plan is not None
    try:
        still = tracker.run_of(holds_still(tracker, run.plan))
    except ArgumentError:
        return run
    return run if run.off <= still.off else still


def tie(tracker: Tracker, result: OptimizationResult) -> None:
    """Give strings on bars the lengths that suit a motion of the plan."""
    ties = _ties(tracker)
    lengths = ties.distances(result.x).mean(axis=0)
    named = dict(zip(ties.names, map(float, lengths), strict=True))
    tracker.mechanism = tracker.mechanism.with_parameters(named)
    tracker.plan = tracker.planned()


def go_on(tracker: Tracker, search: TrackingSearch) -> None:
    """Begin where a search was that tied strings on bars."""
    assert search.firmness is not None
    tracker.mechanism, tracker.effort = search.mechanism, search.effort
    tracker.kinds, tracker.earlier = search.kinds, search.result
    tracker.plan = tracker.planned()
    if len(search.result.u) < tracker.plan.system.N:
        _take_longer_steps(tracker)
    if tracker.plan.ties is None:
        raise ArgumentError("resume: its strings are tied to bars, and those of the mechanism are not")
    tracker.plan.ties.weight = search.firmness


def slower(motion: Motion) -> Motion:
    """Return a motion with steps of twice the length; that given where it has few, or long ones."""
    steps, dt = len(motion.t) - 1, float(motion.t[1] - motion.t[0])
    if steps < _FEW or 2.0 * dt > _LONGEST:
        return motion
    return motion.resample(motion.duration / (steps // 2), duration=motion.duration)


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
) -> OptimizationResult:
    """Return what is found where each optimisation ties strings on bars more firmly than the last.

    ``left``: iterations of the firmest. ``most``: that the last of them may cost, as far as that can be foretold.
    """
    tracker.left = left
    tracker.others = []  # they are where strings are tied loosely
    costs, offs = [result.cost], list[float]()
    for weight in weights:
        if result.status in CUT_SHORT or left < 1:
            return result
        if _foretold(costs, sum(each >= weight for each in (*LOOSE, *FIRM))) > most:
            tracker.left = left
            return replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        if weight <= FIRM[0]:
            tie(tracker, result)
        off = float(np.abs(_ties(tracker).off(result.x)).max())
        offs.append(off)
        if _expected(offs, sum(weight <= each for each in LOOSE)) > _TOO_LOOSE:
            tracker.left = left
            return replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        if weight > FIRM[0] and off < _SETTLED and result.success:
            break
        _ties(tracker).weight = weight
        tracker.say(f"strings on bars vary by {1e3 * off:.2g} mm: tied more firmly")
        tracker.start, tracker.earlier = result, None
        tracker.left = left if weight == FIRM[-1] else _LEADING if weight in LOOSE else _TYING
        try:
            firmer = tracker.improve()
        except ProjectionError as error:
            tracker.say(f"strings cannot be tied more firmly: {error}")
            tracker.left = left
            return replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        if result.success and weight > FIRM[0] and off < _NEARLY and firmer.status in STUCK:
            break  # so firmly that rounding of what lengths cost looks like negative curvature
        result = firmer
        costs.append(result.cost)
    _ties(tracker).firm = result.success
    return result


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
    assert tracker.plan is not None
    assert tracker.plan.ties is not None
    return tracker.plan.ties
