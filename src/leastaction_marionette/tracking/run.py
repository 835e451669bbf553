"""The main job: a marionette learns to follow a reference motion.

The reference gives the body's variables only. `track` guesses the strings that go with it, finds a first
trajectory that the puppet can make, and improves it with `leastaction.optimize`.

The first trajectory is what the puppet does when its strings simply hang above the hooks of the reference.
Where that goes wrong, because the motion is fast or the strings lose their grip on a stretched limb, the motion is
planned by tensions (`Plan`): every joint gets a motor, with which any motion can be followed (*dynamic embedding*,
dissertation 6.6.1); the motors are made ever more expensive until they do nothing, and are then taken away.

Limits hold all along: strings pull, hinges do not overstretch, the strings' upper ends stay within reach and move as
fast as `PuppetLimits` says. What cannot be followed within them is followed as well as they allow.

Strings that are tied to bars may vary in length at first, and are tied ever more firmly (`ties.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.optimal import Callback, Method, OptimizationResult, Status
from leastaction_marionette.choices import Follow
from leastaction_marionette.tracking import tying
from leastaction_marionette.tracking.beginning import begun
from leastaction_marionette.tracking.by_lengths import by_tensions
from leastaction_marionette.tracking.checkpoints import Checkpoints
from leastaction_marionette.tracking.found import TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.problem import TrackingProblem, below_strings
from leastaction_marionette.tracking.settle import NotTiedError
from leastaction_marionette.tracking.ties import FIRM
from leastaction_marionette.tracking.tracker import Tracker
from leastaction_marionette.tracking.weights import GENTLE, TrackingWeights

_NONE_NEAR: Final = "strings on bars: no motion in which all of them pull is near to what was found"


def track(
    mechanism: Mechanism,
    motion: Motion,
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
    motion : Motion
        The reference: values of all body variables, equidistant in time. It need not be possible.
    weights : TrackingWeights, optional
        What matters how much. If not given, `GENTLE` where the hanging strings give a good first
        trajectory, else `FORCED`.
    limits : PuppetLimits, optional
        What the motion keeps to; `PuppetLimits` as it is if not given, also where a run is resumed.
    planned : bool, optional
        Plan by tensions at once; else that is done where hanging strings give no good start, or end up pushing.
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
    motion, lowered = below_strings(mechanism, motion)
    if lowered > 0.0:
        say(f"the motion rises above the plane of the strings: lowered there, by up to {lowered:.2g} m")
    tracker = Tracker(
        mechanism=mechanism,
        motion=motion,
        problem=TrackingProblem(mechanism, motion, weights or GENTLE, threads, follow),
        weights=weights,
        limits=limits or PuppetLimits(),
        follow=follow,
        method=method,
        tolerance=tolerance,
        callback=callback,
        say=say,
        kept=Checkpoints(checkpoint, checkpoint_seconds),
        threads=threads,
        left=max_iterations,
    )
    tracker, search = begun(tracker, resume, planned=planned)
    earlier = resume.plan if isinstance(resume, TrackingRun) else None
    tracker, result = tying.tied(tracker, search, earlier=earlier)
    tracker, run = _ended(tracker, result)
    if not _must_be_planned(tracker, run):
        return _with_strings_that_pull(tracker, run)
    creeps = _creeps(tracker, run)
    why = "a hanging puppet finds no way" if creeps else "hanging strings end up pushing"
    tracker.say(f"{why}: the motion is planned by tensions")
    # With what is left of the iterations where it crept.
    again = replace(tracker, left=tracker.left if creeps else max_iterations, earlier=None, kinds=frozenset())
    return _ended(*tying.tied(*begun(again, None, planned=True)))[1]


def _ended(tracker: Tracker, result: OptimizationResult) -> tuple[Tracker, TrackingRun]:
    """Return the run that a result is; of a plan, with strings that pull wherever it ended."""
    if tracker.plan is not None:
        if tracker.ties is not None and tracker.varies and tracker.ties.weight < FIRM[0]:
            tracker = tying.with_lengths_of(tracker, result)
        assert tracker.plan is not None
        result = tracker.plan.pulling(result)
    try:
        run = tracker.run_of(result)
        return tracker, tying.or_still(tracker, run) if tracker.ties is not None and not result.success else run
    except NotTiedError as error:
        if result.status is Status.INTERRUPTED:  # what is kept is worth more than a puppet held still
            raise KeyboardInterrupt from error
        if not tracker.began_still and tracker.left > 0:
            tracker.say(f"{_NONE_NEAR}: it begins with a puppet that is held still")
            tracker, again = tying.from_still(tracker, result, tracker.left)
            if again is not None:
                return _ended(tracker, again)
        tracker.say(f"{error}: it is held still")
        tracker, still = tying.held(tracker, result)
        return tracker, tracker.run_of(still)
    except KeyboardInterrupt:  # too late to stop anything, and no reason to lose what there is
        return tracker, tracker.run_of(result)


def _must_be_planned(tracker: Tracker, run: TrackingRun) -> bool:
    """Whether hanging strings found no way, or ended up pushing, with time to plan by tensions."""
    if tracker.plan is not None or _cut_short(tracker, run):
        return False
    return _creeps(tracker, run) or run.tension.min() < 0.0


def _creeps(tracker: Tracker, run: TrackingRun) -> bool:
    return not run.result.success and not run.ended_early and tracker.left > 0


def _cut_short(tracker: Tracker, run: TrackingRun) -> bool:
    """Whether a hanging puppet's run ended before its strings were told to pull."""
    return tracker.plan is None and run.tension.min() < 0.0 and (run.ended_early or tracker.left < 1)


def _with_strings_that_pull(tracker: Tracker, run: TrackingRun) -> TrackingRun:
    """Return a run, or a motion near it in which strings pull where it was cut short before they were told to."""
    if not _cut_short(tracker, run):
        return run
    tracker = tracker.planned()
    assert tracker.plan is not None
    tensions = by_tensions(tracker.plan, run.trajectory, run.tension, run.result)
    return replace(tracker.run_of(tracker.plan.pulling(tensions)), unfinished=run.result)
