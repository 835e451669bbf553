"""The main job: a marionette learns to follow a reference motion.

The reference gives the body's variables only. `track` guesses the strings that go with it, finds a first trajectory
that the puppet can make, and improves it with `leastaction.optimize`, by tensions (`plan.py`).

The first trajectory is what the puppet does when its strings simply hang above the hooks of the reference. Where that
goes wrong, because the motion is fast or the strings lose their grip on a stretched limb, every joint gets a motor,
with which any motion can be followed (*dynamic embedding*, dissertation 6.6.1); the motors are made ever more expensive
until they do nothing, and are then taken away.

Limits hold all along: strings pull, hinges do not overstretch, the strings' upper ends stay within reach and move as
fast as `PuppetLimits` says. What cannot be followed within them is followed as well as they allow.

Strings that are tied to bars may vary in length at first, and are tied ever more firmly (`tying.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import tie_strings
from leastaction.optimal import Callback, Method
from leastaction_marionette.choices import Follow
from leastaction_marionette.retargeting import PuppetMotion
from leastaction_marionette.tracking import tying
from leastaction_marionette.tracking.found import CUT_SHORT, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.motors import with_motors
from leastaction_marionette.tracking.parts import found_in_parts
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem, below_strings
from leastaction_marionette.tracking.tracker import Checkpoints, Tracker, improved
from leastaction_marionette.tracking.weights import GENTLE, TrackingWeights

PATIENCE: Final = 100
"""Iterations of a puppet that began hanging; then a first trajectory is sought with motors."""

_OFF: Final = 0.02  # of the mean tension at rest, by which hanging strings keep off the limits of tensions


def track(
    mechanism: Mechanism,
    motion: Motion | PuppetMotion,
    *,
    weights: TrackingWeights | None = None,
    limits: PuppetLimits | None = None,
    planned: bool = False,
    follow: Follow = "joints",
    method: Method = "auto",
    max_iterations: int = 500,
    tolerance: float | None = None,
    callback: Callback | None = None,
    progress: Callable[[str], object] | None = None,
    resume: TrackingRun | TrackingSearch | None = None,
    checkpoint: Callable[[TrackingRun | TrackingSearch], object] | None = None,
    checkpoint_seconds: float = 10.0,
    threads: int = 0,
) -> TrackingRun:
    """Find the motion of the marionette that follows a reference best, with its strings and gains.

    Parameters
    ----------
    mechanism : Mechanism
        From `leastaction.models.marionette.marionette`.
    motion : Motion or PuppetMotion
        The reference: values of all body variables, equidistant in time, or what `load_motion` read. It need not be
        possible.
    weights : TrackingWeights, optional
        What matters how much. If not given, `GENTLE` where hanging strings give a good first trajectory, else `FORCED`.
    limits : PuppetLimits, optional
        What the motion keeps to; `PuppetLimits` as it is if not given, also where a run is resumed.
    planned : bool, optional
        Seek a first trajectory with motors at once; else that is done where hanging strings give none that is good, or
        one from which no minimum is found.
    follow : {"joints", "markers"}, optional
        Follow the angles of the joints, or the places of head, hands, feet and pelvis: where the motion says that they
        are (`load_motion` with ``markers=True``), else where they would be if the joints did what is wanted. How
        joints bend in between is then for the optimiser to find. A run or search that is resumed follows what it did.
    method, max_iterations, callback
        As in `leastaction.optimize`, for the last optimisation.
    tolerance : float, optional
        Likewise. If not given, 1e-6, or 1e-2 where the first trajectory had to be found by embedding:
        such a motion is far from what the puppet does by itself, and its last digits cost much. With strings on bars,
        where little changes from one optimisation to the next while they are tied, 3e-3, and 1e-3 with longer steps.
    progress : callable, optional
        Called with a line of text as the search for a first trajectory goes on.
    resume : TrackingRun or TrackingSearch, optional
        Go on with an earlier run, or search, of the same motion. The iterates are those of a run that never stopped, if
        weights, limits and method are the same; a search goes on from its last whole stage.
    checkpoint : callable, optional
        Called with the run as it stands after an iteration, to be kept in case that the program ends; with a
        `TrackingSearch` while a first trajectory is sought, and where Ctrl-C ends that.
    checkpoint_seconds : float, optional
        Least time between two of these calls (s), and longer where they would take more than a twentieth
        of all time; 0: after every iteration.
    threads : int, optional
        Threads for derivatives; 0: as many as there are cores.

    Raises
    ------
    KeyboardInterrupt
        For Ctrl-C while a first trajectory is sought, or while strings on bars are tied and no motion with their
        lengths is near; later it ends the optimisation with what it has.
    ArgumentError
        If the motion does not name the variables, is too short, or no first trajectory is found.
    """
    say, follow = progress or (lambda _: None), follow if resume is None else resume.follow
    motion, lowered = below_strings(mechanism, motion.motion if isinstance(motion, PuppetMotion) else motion)
    if lowered > 0.0:
        say(f"the motion rises above the plane of the strings: lowered there, by up to {lowered:.2g} m")
    limits = limits or PuppetLimits()
    problem = TrackingProblem(mechanism, motion, weights or GENTLE, limits, follow=follow, threads=threads)
    tracker = Tracker(
        mechanism=mechanism,
        motion=motion,
        weights=weights,
        limits=limits,
        follow=follow,
        method=method,
        tolerance=tolerance,
        callback=callback,
        say=say,
        kept=Checkpoints(checkpoint, checkpoint_seconds),
        threads=threads,
        left=max_iterations,
        plan=TrackingPlan(problem),
    )
    if resume is not None:
        return _gone_on(tracker, resume)
    start = None if planned else _hanging(tracker.plan)
    return _sought(tracker) if start is None else _from_hanging(replace(tracker, start=start, hangs=True), PATIENCE)


def _gone_on(tracker: Tracker, found: TrackingRun | TrackingSearch) -> TrackingRun:
    """Return what is found from where an earlier run was, or a search."""
    hangs = isinstance(found, TrackingRun) and not found.embedded
    tracker = replace(tracker, effort=found.effort).planned(hangs=hangs)
    tracker = replace(tracker, restarts=hangs or isinstance(found, TrackingSearch))
    if isinstance(found, TrackingSearch):
        if found.firmness is None:
            return _sought(tracker, found)
        return tying.gone_on(replace(tracker, earlier=found.result), found)
    goes_on = tracker.plan.stated_in(found.plan.limits)
    tracker = replace(tracker, start=None if goes_on else found.plan, earlier=found.plan if goes_on else None)
    if hangs:
        return _from_hanging(tracker, PATIENCE - found.plan.iterations)
    if tracker.ties is not None:
        return tying.gone_on(tracker, found)
    tracker, result = improved(tracker)
    return tracker.ended(result)


def _hanging(plan: TrackingPlan) -> Curve | None:
    """Return what the puppet does under hanging strings that pull, or None where that is no good start."""
    hung = plan.problem.hang()
    if hung is None:
        return None
    x, u = plan.by_tensions(*hung)
    strings = len(plan.strings)
    u[:, :strings] = np.clip(u[:, :strings], *plan.tensions_inside(_OFF))
    return x, u


def _from_hanging(tracker: Tracker, patience: int) -> TrackingRun:
    """Return what is found from hanging strings in some iterations, or else with motors in what is left of them."""
    most = min(tracker.left, max(patience, 1))
    ended, result = improved(replace(tracker, left=most))
    left = tracker.left - (most - ended.left)
    if result.success or result.status in CUT_SHORT or left < 1:
        return ended.ended(result)
    tracker.say("a hanging puppet finds no way: a first trajectory is sought with motors")
    return _sought(replace(tracker, left=left, start=None, earlier=None, effort=ended.effort))


def _sought(tracker: Tracker, begun: TrackingSearch | None = None) -> TrackingRun:
    """Return what is found from a first trajectory that is sought; ``begun``: a search that was cut short."""
    if begun is None:
        tied = tie_strings(tracker.mechanism, tracker.plan.problem.reference)
        tracker = replace(tracker, mechanism=tied).planned()
    by_motors = partial(with_motors, begun=None if begun is None or begun.parts else begun)
    if tracker.ties is not None:
        return tying.followed_on_bars(tracker, by_motors, begun=begun is not None)
    first = found_in_parts(tracker, begun) if begun is None or begun.parts else None
    tracker, result = improved(first or by_motors(tracker))
    return tracker.ended(result)
