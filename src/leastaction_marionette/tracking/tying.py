"""How a motion whose strings on bars vary in length becomes one on which they keep it, optimisation by optimisation.

What `track` does of it, from one `Tracker` to the next; `ties.py` has the price. There are two ways: from what motors
lead to, with strings that are tied loosely at first, and from a puppet that is held still, whose strings are firm. On
one bar for all strings, whose six numbers are far from what strings of any lengths make, the second is tried first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import bars_of, held_strings
from leastaction.optimal import OptimizationResult, Status
from leastaction_marionette.tracking.found import CUT_SHORT, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.poses import held_still
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM, Ties
from leastaction_marionette.tracking.tracker import Tracker, improved

_TOO_LOOSE: Final = 0.04  # m, by which strings on bars may not vary any more where their lengths are fixed
_NOT_TIED: Final = (
    "The best motion found could not be tied to bars: this is one near it on which strings keep their lengths."
)

Found = tuple[Tracker, OptimizationResult]
Way = Callable[[Tracker], Found]


def on_one_bar(mechanism: Mechanism) -> bool:
    """Whether all strings are tied to one bar."""
    return len(bars_of(mechanism)) == 1 and not held_strings(mechanism)


def followed_on_bars(tracker: Tracker, search: Callable[[Tracker], Tracker], *, begun: bool) -> TrackingRun:
    """Return what is found on bars by the first way that leads to a motion.

    ``search``: how motors lead to one; ``begun``: whether they have begun to.
    """

    def from_motors(tracker: Tracker) -> Found:
        return more_firmly(*improved(search(tracker)))

    motors = "it is sought with motors", from_motors
    if on_one_bar(tracker.mechanism) and not begun:
        return _by_ways(tracker, (_STILL, motors), why="all strings are tied to one bar")
    return _by_ways(tracker, (motors, _STILL))


def gone_on(tracker: Tracker, found: TrackingRun | TrackingSearch) -> TrackingRun:
    """Return what is found from where a run on bars was, or a search that tied strings."""
    if isinstance(found, TrackingRun):
        return _by_ways(tracker.tied(FIRM, firm=True), (("it goes on", improved), _STILL))
    if tracker.ties is None:
        raise ArgumentError("resume: its strings are tied to bars, and those of the mechanism are not")
    assert found.firmness is not None
    if len(found.result.u) < tracker.plan.system.N:
        tracker = tracker.with_longer_steps()

    def from_there(tracker: Tracker) -> Found:
        return more_firmly(*improved(tracker))

    return _by_ways(tracker.tied(found.firmness), (("it goes on", from_there), _STILL))


def _by_ways(tracker: Tracker, ways: Sequence[tuple[str, Way]], *, why: str = "") -> TrackingRun:
    """Return the motion on strings of fixed lengths that one way after the other leads to.

    Where none does, one near what could not be tied, or a puppet held still, whichever is nearer to what is wanted.
    ``ways``: each with what is said where it begins; ``why``: it is the first.
    """
    left, untied, runs = tracker.left, list[Found](), list[TrackingRun]()
    for words, way in ways:
        if why:
            tracker.say(f"{why}: {words}")
        begun, found, why = replace(tracker, left=left), None, "no motion is found from there"
        with suppress(LeastActionError):
            begun, found = way(begun)
            if not begun.varies or found.status in CUT_SHORT or begun.left < 1:
                why = "strings on bars: no motion in which all of them pull is near to what was found"
                return _on_rods(begun, found)
            why = "strings on bars cannot be tied on the motion found"
            untied.append((begun, found))
        if found is not None and found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt  # what is kept is worth more than a puppet held still
        tracker = replace(tracker, effort=begun.effort)
    tracker.say(f"{why}: it is held still")
    for each in untied:
        with suppress(LeastActionError):
            runs.append(_on_rods(*each))
    try:
        tracker, still = held(replace(tracker, slow=None).planned(), untied[0][1] if untied else None)
        runs.append(tracker.run_of(still))
    except LeastActionError:
        if not runs:
            raise
    return min(runs, key=lambda run: run.off)


def _on_rods(tracker: Tracker, found: OptimizationResult) -> TrackingRun:
    """Return what was found with strings of fixed lengths: where they are still sought, those that suit it."""
    if tracker.slow is not None:
        tracker, found = _with_its_own_steps(tracker, found)
    if tracker.varies and _ties(tracker).weight < FIRM:
        tracker = with_lengths_of(tracker, found)
    return tracker.ended(found)


def from_still(tracker: Tracker) -> Found:
    """Return what is found from a puppet that is held still, whose strings are tied firmly.

    Raises `ArgumentError` where nothing holds it.
    """
    tracker, still = held(tracker.with_longer_steps(), None)
    return more_firmly(tracker, still)


_STILL: Final = ("it begins with a puppet that is held still", from_still)


def held(tracker: Tracker, near: OptimizationResult | None) -> Found:
    """Return the puppet at rest, with strings on bars tied as they are there.

    ``near``: what was found instead; None for nothing. Raises `ArgumentError`: it is held nowhere.
    """
    plan = tracker.plan
    if near is None or len(near.u) != plan.system.N:  # its first pose for all time, which its strings do not hold
        near = optimize(plan.system, plan.cost(), initial=plan.hanging(), shooting="multiple", max_iterations=0)
    still = held_still(plan, near)
    tracker = with_lengths_of(tracker, still)
    return tracker, replace(still, cost=tracker.plan.cost().value(still.x, still.u))


def with_lengths_of(tracker: Tracker, result: OptimizationResult) -> Tracker:
    """Return a tracker whose strings on bars have the lengths that suit a motion of its plan."""
    ties = _ties(tracker)
    lengths = ties.distances(result.x).mean(axis=0)
    named = dict(zip(ties.names, map(float, lengths), strict=True))
    return replace(tracker, mechanism=tracker.mechanism.with_parameters(named)).planned()


def more_firmly(tracker: Tracker, result: OptimizationResult) -> Found:
    """Return what is found where strings on bars are tied firmly, with longer steps first where the tracker has these.

    Strings vary where they cannot be tied.
    """
    left, slow, loose = tracker.left, tracker.slow is not None, _ties(tracker).weight < FIRM
    for longer in [*[True] * (slow and loose), *[False] * (slow or loose)]:
        if result.status in CUT_SHORT or left < 1:
            break
        if tracker.slow is not None and not longer:
            tracker, result = _with_its_own_steps(tracker, result)
        not_tied = replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        tracker = with_lengths_of(tracker, result)
        off = float(np.abs(_ties(tracker).off(result.x)).max())
        if off > _TOO_LOOSE:
            return tracker, not_tied
        tracker.say(f"strings on bars vary by {1e3 * off:.2g} mm: tied more firmly")
        tracker = replace(tracker.tied(FIRM), start=result, earlier=None, left=left)
        try:
            tracker, result = improved(tracker)
        except ProjectionError as error:
            tracker.say(f"strings cannot be tied more firmly: {error}")
            return replace(tracker, left=left), not_tied
    if tracker.slow is not None:
        tracker, result = _with_its_own_steps(tracker, result)
    return tracker.tied(_ties(tracker).weight, firm=result.success), result


def _with_its_own_steps(tracker: Tracker, result: OptimizationResult) -> Found:
    """Return what was tied with longer steps than the motion's own as a motion with these, which is no minimum yet."""
    coarse, scale = tracker.plan, tracker.scale
    tracker = replace(tracker, slow=None).planned().tied(_ties(tracker).weight)
    plan = tracker.plan
    x, u = plan.inside(*plan.finer(coarse, result.x, result.u), result.cost * scale)
    none = np.zeros((plan.system.N, plan.system.nu, plan.system.ndx))
    cost, status = plan.cost().value(x, u), Status.ITERATION_LIMIT if result.success else result.status
    found = replace(result, x=x, u=u, K=none, projection_gain=none, cost=cost, limits=None, status=status, state=None)
    return tracker, found


def _ties(tracker: Tracker) -> Ties:
    assert tracker.ties is not None
    return tracker.ties
