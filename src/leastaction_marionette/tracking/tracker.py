"""How far `track` has come with a motion, and how that is improved by one optimisation after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.optimal import Callback, IterationRecord, Method, OptimizationResult, Shooting, Status
from leastaction_marionette.choices import Follow
from leastaction_marionette.markers import with_places
from leastaction_marionette.tracking.found import CUT_SHORT, STUCK, Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.pace import Pace
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.poses import at_rest
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.settle import by_lengths
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM, Ties
from leastaction_marionette.tracking.weights import FORCED, GENTLE, TrackingWeights
from leastaction_marionette.turns import body_of

_LONGEST: Final = 0.021  # s, of the steps with which a captured motion can be searched
_FEW: Final = 100  # steps, for which a search with longer ones is not worth it
_GAINED = 0.999  # share of its cost with which it is worth to go on from where a search was stuck
# Tolerances, if none is given: of a puppet that began hanging, of a plan, and where its strings are tied firmly. There
# one optimisation leads to the next, and most is gained with the first, whose longer steps are cheap.
_HANGING, _PLANNED, _TIED, _TIED_SLOWLY = 1e-6, 1e-2, 3e-3, 1e-3
_SHARE = 0.05  # of the time may go into checkpoints
_LOST = 2.0  # share of the cost of a minimum that what was left behind costs where it is no better
_PLAN_PATIENCE = 150  # iterations of a plan, which then begins again with a puppet that is held still
# Parts of the cost that ten iterations hardly change: where strings on bars are tied loosely, and with longer steps.
_HARDLY, _HARDLY_FIRM = 0.002, 0.005
_CREPT = "The search creeps, and was made from elsewhere: what was left behind is nearer. Go on with --resume."
_STOPPED = "Ctrl-C ended the search for another way: this is the best motion found before."
_THERE = "The expected decrease of the cost is below the tolerance; limits are kept where lengths are exact."
_STILL = "the motion found cannot be followed: it begins with a puppet that is held still"


class Checkpoints:
    """Hands on what is to be kept, not too often. For one thread.

    ``keep``: what is done with it; None: nothing. ``seconds``: least time between two of these calls, longer where they
    would take more than a twentieth of all time; 0: no pause.
    """

    def __init__(self, keep: Callable[[TrackingRun | TrackingSearch], object] | None, seconds: float) -> None:
        self.keep, self.seconds = keep, seconds
        self.due = time.perf_counter() + seconds

    def __call__(self, now: Callable[[], TrackingRun | TrackingSearch], *, at_once: bool = False) -> None:
        """Keep what ``now`` gives, which is asked only if it is time, or where this is the last chance."""
        began = time.perf_counter()
        if self.keep is None or (began < self.due and not at_once):
            return
        self.keep(now())
        after = time.perf_counter()
        pause = max(self.seconds, (after - began) / _SHARE)
        self.due = after + (pause if self.seconds > 0.0 else 0.0)


@dataclass(frozen=True, kw_only=True)
class Tracker:
    """How far a motion is followed. What goes on from it is another one.

    The fields down to ``left`` are the arguments of `track`, the mechanism with the lengths to which its strings on
    bars are tied; ``left`` are the iterations that are left.
    """

    mechanism: Mechanism
    motion: Motion
    weights: TrackingWeights | None
    limits: PuppetLimits
    follow: Follow
    method: Method
    tolerance: float | None
    callback: Callback | None
    say: Callable[[str], object]
    kept: Checkpoints
    threads: int
    left: int

    plan: TrackingPlan
    hangs: bool = False  # whether it began with what hanging strings do
    slow: Motion | None = None  # the motion with longer steps, while strings on bars are tied with these
    effort: Effort = field(default_factory=Effort)
    # Where the next optimisation begins: a curve or a result, whose steps may have gaps; or it goes on with an earlier.
    start: Curve | OptimizationResult | None = None
    shooting: Shooting = "auto"
    earlier: OptimizationResult | None = None
    restarts: bool = True  # whether it begins with a puppet that is held still where it is stuck or creeps, on no bars

    @property
    def ties(self) -> Ties | None:
        """The lengths of strings on bars, if there are some."""
        return self.plan.ties

    @property
    def varies(self) -> bool:
        """Whether strings on bars still vary in length."""
        return self.ties is not None and not self.ties.firm

    @property
    def may_restart(self) -> bool:
        """Whether there is another way where it is stuck or creeps."""
        return self.restarts and self.ties is None and not self.hangs

    @property
    def scale(self) -> float:
        """By how many steps the motion has more than it is followed with for the time being."""
        return 1.0 if self.slow is None else (len(self.motion.t) - 1) / (len(self.slow.t) - 1)

    def planned(self, *, hangs: bool = False) -> Tracker:
        """Return one with the plan of its motion and mechanism; ``hangs``: with the weights of gentle motions."""
        problem = TrackingProblem(
            self.mechanism,
            self.slow or self.motion,
            self.weights or (GENTLE if hangs else FORCED),
            self.limits,
            follow=self.follow,
            threads=self.threads,
        )
        return replace(self, plan=TrackingPlan(problem), hangs=hangs)

    def tied(self, weight: float, *, firm: bool = False) -> Tracker:
        """Return one whose strings on bars are tied with a weight; ``firm``: and need not be tied more firmly."""
        return replace(self, plan=self.plan.tied(weight, firm=firm))

    def with_longer_steps(self) -> Tracker:
        """Return one with steps of twice the length, where the motion has many that are not long."""
        motion, steps, dt = self.motion, len(self.motion.t) - 1, float(self.motion.t[1] - self.motion.t[0])
        if steps < _FEW or 2.0 * dt > _LONGEST:
            return self if self.slow is None else replace(self, slow=None).planned()
        slow = motion.resample(motion.duration / (steps // 2), duration=motion.duration)
        return replace(self, slow=slow).planned()

    def spent(self, found: OptimizationResult) -> Tracker:
        """Return one that has counted an optimisation."""
        made = found.iterations - (0 if self.earlier is None else self.earlier.iterations)
        effort = self.effort.plus(found, before=self.earlier, scale=self.scale)
        return replace(self, effort=effort, left=self.left - made, shooting="auto")

    def as_search(self, found: OptimizationResult, *, counted: bool = False, stage: int = 0) -> TrackingSearch:
        """Return what a search has found as what is gone on with; ``counted``: whether it is in the effort already."""
        return TrackingSearch(
            mechanism=self.mechanism,
            motion=self.motion,
            stage=stage,
            result=found,
            follow=self.follow,
            effort=self.effort if counted else self.effort.plus(found, before=self.earlier),
            firmness=None if stage or self.ties is None else self.ties.weight,
        )

    def run_of(
        self, found: OptimizationResult, *, counted: bool = True, pulling: OptimizationResult | None = None
    ) -> TrackingRun:
        """Return a result as a run; ``counted``: as of `as_search`; ``pulling``: the same with strings that pull."""
        names, problem = body_of(self.mechanism), self.plan.problem
        body = Motion(names, problem.t, problem.reference[:, : len(names)], self.motion.source)
        return TrackingRun(
            mechanism=self.mechanism,
            motion=body if problem.markers is None else with_places(body, problem.markers),
            embedded=not self.hangs,
            result=by_lengths(self.plan, pulling or found),
            plan=found,
            limits=self.limits,
            follow=self.follow,
            effort=self.effort if counted else self.effort.plus(found, before=self.earlier),
        )

    def ended(self, found: OptimizationResult) -> TrackingRun:
        """Return what was found as a run whose strings pull, wherever it ended; it goes on where it was."""
        pulling = self.plan.pulling(found)
        if not (np.isfinite(found.x).all() and np.isfinite(found.u).all()):
            found = pulling
        try:
            return self.run_of(found, pulling=pulling)
        except KeyboardInterrupt:  # too late to stop anything, and no reason to lose what there is
            return self.run_of(found, pulling=pulling)


def improved(tracker: Tracker) -> tuple[Tracker, OptimizationResult]:
    """Optimise until nothing more is gained: from inside of limits where it is stuck, and from a puppet held still.

    Raises `ProjectionError`: nothing can be followed from where it stands.
    """
    best, stood = np.inf, None
    while True:
        try:
            result = _optimised(tracker)
        except ProjectionError:
            if stood is not None:
                return tracker, stood
            if tracker.ties is not None:
                raise
            tracker.say(_STILL)
            tracker = replace(tracker, start=at_rest(tracker.plan))
            result = _optimised(tracker)
        tracker = tracker.spent(result)
        if result.gap > 0.0:  # what is left of them is for feedback
            tracker = replace(tracker, start=(result.x, result.u))
            continue
        stood = result
        if result.status in STUCK and tracker.left > 0 and result.cost < _GAINED * best:
            # Walls of low barriers are close together: with higher ones, and inside of them, there is a way on.
            best, start = result.cost, tracker.plan.inside(result.x, result.u, result.cost)
            tracker = replace(tracker, earlier=None, start=start)
            continue
        stuck = result.status in (*STUCK, Status.ITERATION_LIMIT)
        if stuck and tracker.left > 0 and tracker.may_restart:
            return _from_rest(tracker, result)
        return tracker, result


def _from_rest(tracker: Tracker, result: OptimizationResult) -> tuple[Tracker, OptimizationResult]:
    """Return what is found from a puppet that is held still, or a result that is stuck or creeps.

    The latter where it is nearer: much nearer, if the former is a minimum.
    """
    tracker.say(_STILL)
    try:
        begun = replace(tracker, start=at_rest(tracker.plan), earlier=None, restarts=False)
        other, other_result = improved(begun)
    except (ArgumentError, ProjectionError):
        return tracker, result
    except KeyboardInterrupt:
        return tracker, replace(result, status=Status.INTERRUPTED, message=_STOPPED)
    if result.cost > (1.0 / _LOST if other_result.success else 1.0) * other_result.cost:
        return other, other_result
    tracker = replace(tracker, start=None, earlier=result, effort=other.effort, left=other.left, restarts=False)
    if tracker.left < 1 or result.status in STUCK or other_result.status in CUT_SHORT:
        return replace(tracker, earlier=None), result
    tracker.say("what was left behind is nearer: goes on with that")
    return improved(tracker)


def _optimised(tracker: Tracker) -> OptimizationResult:
    """Return what one optimisation finds from where it stands, within the limits that are stated."""
    plan, ties = tracker.plan, tracker.ties
    # Strings on bars may be tied so loosely, or with such long steps, that an optimisation only leads to the next.
    passes = ties is not None and ties.weight < FIRM
    leads_on = tracker.may_restart if ties is None else passes or tracker.slow is not None
    hardly = 0.0 if ties is None or not leads_on else _HARDLY if passes else _HARDLY_FIRM
    pace, tolerance = Pace(hardly=hardly, earlier=tracker.earlier), _tolerance(tracker)
    ended: Status | None = None

    def watch(record: IterationRecord) -> object:
        nonlocal ended

        def now() -> TrackingRun | TrackingSearch:
            found = record.snapshot()
            return tracker.as_search(found) if tracker.varies else tracker.run_of(found, counted=False)

        if record.gap == 0.0:
            tracker.kept(now)
        if tracker.callback is not None and tracker.callback(record):
            return True
        creeps = pace.creeps(record)
        # What limits are off by where strings on bars are tied is mended where these become rods.
        if ties is not None and not passes and pace.is_there(record, tolerance):
            ended = Status.CONVERGED
        elif leads_on and creeps:
            ended = Status.ITERATION_LIMIT
        return ended is not None

    result = optimize(
        plan.system,
        plan.cost(),
        initial=tracker.start,
        resume=tracker.earlier,
        limits=plan.stated(),
        free_start=plan.mechanism.coordinates,
        shooting=tracker.shooting,
        method=tracker.method,
        max_iterations=min(tracker.left, _PLAN_PATIENCE) if tracker.may_restart else tracker.left,
        tolerance=tolerance,
        callback=watch,
    )
    if result.status is Status.INTERRUPTED and result.gap > 0.0:
        raise KeyboardInterrupt  # there is no motion yet
    if result.status is Status.INTERRUPTED and tracker.varies:
        # There may be no motion near it on strings that keep their lengths.
        tracker.kept(lambda: tracker.as_search(result), at_once=True)
    if ended is None:
        return result
    return replace(result, status=ended, message=_THERE if ended is Status.CONVERGED else _CREPT)


def _tolerance(tracker: Tracker) -> float:
    """Return the tolerance: the user's, or that of a puppet that began hanging, a plan, or strings tied firmly."""
    if tracker.tolerance is not None:
        return tracker.tolerance
    if tracker.ties is None or tracker.ties.weight < FIRM:
        return _HANGING if tracker.hangs else _PLANNED
    return _TIED if tracker.slow is None else _TIED_SLOWLY
