"""How far `track` has come with a motion, and how that is improved by one optimisation after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.numerics import Array
from leastaction.optimal import Callback, IterationRecord, Method, OptimizationResult, Shooting, Status
from leastaction_marionette.choices import Follow
from leastaction_marionette.tracking.by_lengths import by_lengths
from leastaction_marionette.tracking.checkpoints import Checkpoints
from leastaction_marionette.tracking.found import CUT_SHORT, STUCK, Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.growing import grown
from leastaction_marionette.tracking.limits import KINDS, PuppetLimits
from leastaction_marionette.tracking.motors import SEARCH_STAGES
from leastaction_marionette.tracking.pace import Pace
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import hanging
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM, Ties
from leastaction_marionette.tracking.weights import FORCED, TrackingWeights

PATIENCE: Final = 100
"""Iterations of a puppet that began hanging; then its motion is planned by tensions."""

_LONGEST: Final = 0.021  # s, of the steps with which a captured motion can be searched
_FEW: Final = 100  # steps, for which a search with longer ones is not worth it
_GAINED = 0.999  # share of its cost with which it is worth to go on from where a search was stuck
# Tolerances, if none is given: of a puppet that began hanging, of a plan, and where its strings are tied firmly. There
# one optimisation leads to the next, and most is gained with the first, whose longer steps are cheap.
_HANGING, _PLANNED, _TIED, _TIED_SLOWLY = 1e-6, 1e-2, 3e-3, 1e-3
# Parts of the cost that ten iterations hardly change: where strings on bars are tied loosely, and firmly but not last.
_HARDLY, _HARDLY_FIRM = 0.002, 0.005
_LOST = 2.0  # share of the cost of a minimum that what was left behind costs where it is no better
_PLAN_PATIENCE = 150  # iterations of a plan, which then grows from a smaller one
_CREPT = "The search creeps, and was made from elsewhere: what was left behind is nearer. Go on with --resume."
_STOPPED = "Ctrl-C ended the search for another way: this is the best motion found before."
_GROWING = "the motion found cannot be followed: ever larger parts of the wanted one are"
_THERE = "The expected decrease of the cost is below the tolerance; what limits are off by is settled on rods."
_STILL = "the motion found cannot be followed: it begins with a puppet that hangs still"

Curve = tuple[Array, Array]


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
    kept: Checkpoints[TrackingRun | TrackingSearch]
    threads: int
    left: int

    problem: TrackingProblem
    # The motion with longer steps, while strings on bars are tied with these.
    slow: Motion | None = None
    plan: TrackingPlan | None = None
    effort: Effort = field(default_factory=Effort)
    # Where the next optimisation begins: a curve or a result, whose steps may have gaps; or it goes on with an earlier.
    start: Curve | OptimizationResult | None = None
    shooting: Shooting = "single"
    earlier: OptimizationResult | None = None
    kinds: frozenset[str] = frozenset()  # of limits that are stated
    grows: bool = True  # whether a motion that grows is tried where this one is stuck or creeps, on no bars
    began_still: bool = False  # whether a puppet that is held still is where all this began
    patience: int = PATIENCE

    @property
    def stepped(self) -> Motion:
        """The motion with the steps that it is followed with for the time being."""
        return self.motion if self.slow is None else self.slow

    @property
    def ties(self) -> Ties | None:
        """The lengths of strings on bars, of a plan that has some."""
        return None if self.plan is None else self.plan.ties

    @property
    def may_grow(self) -> bool:
        """Whether there is another way where a plan is stuck or creeps."""
        return self.grows and self.plan is not None and self.ties is None

    @property
    def varies(self) -> bool:
        """Whether strings on bars still vary in length."""
        return self.plan is not None and self.plan.varies

    def planned(self) -> Tracker:
        """Return one with the plan by tensions of the problem with the weights of such motions."""
        weights = self.weights or FORCED
        problem = TrackingProblem(self.mechanism, self.stepped, weights, self.threads, self.follow)
        return replace(self, problem=problem, plan=TrackingPlan(problem, weights, self.limits))

    def tied(self, weight: float, *, firm: bool = False) -> Tracker:
        """Return one whose strings on bars are tied with a weight; ``firm``: and need not be tied more firmly."""
        assert self.plan is not None
        return replace(self, plan=self.plan.tied(weight, firm=firm))

    def broken(self, x: Array) -> frozenset[str]:
        """Return the kinds of limits that states break, besides that of the tensions."""
        mechanism = (self.problem if self.plan is None else self.plan).mechanism
        return self.limits.broken(mechanism, self.problem.t, self.problem.pelvis, x)

    def spent(self, found: OptimizationResult) -> Tracker:
        """Return one that has counted an optimisation."""
        made = found.iterations - (0 if self.earlier is None else self.earlier.iterations)
        effort = self.effort.plus(found, before=self.earlier, scale=len(self.motion.t) / len(self.stepped.t))
        return replace(self, effort=effort, left=self.left - made, patience=self.patience - made, shooting="single")

    def as_search(self, found: OptimizationResult) -> TrackingSearch:
        """Return an iterate on which strings on bars still vary in length, as what is gone on with.

        Cheaper than a run is.
        """
        assert self.ties is not None
        return TrackingSearch(
            mechanism=self.mechanism,
            motion=self.motion,
            stage=SEARCH_STAGES,
            result=found,
            follow=self.follow,
            effort=self.effort.plus(found, before=self.earlier),
            firmness=self.ties.weight,
            kinds=self.kinds,
        )

    def run_of(self, found: OptimizationResult, *, counted: bool = True) -> TrackingRun:
        """Return a result as a run; ``counted``: whether it is in the effort already."""
        result = found if self.plan is None else by_lengths(self.plan, found)
        return TrackingRun(
            mechanism=self.mechanism,
            source=self.motion.source,
            reference=self.problem.reference,
            embedded=self.plan is not None,
            trajectory=self.problem.system.trajectory(result.x, result.u),
            result=result,
            plan=None if self.plan is None else found,
            kinds=self.kinds,
            limits=self.limits,
            follow=self.follow,
            markers=self.problem.markers,
            effort=self.effort if counted else self.effort.plus(found, before=self.earlier),
        )


def improved(tracker: Tracker) -> tuple[Tracker, OptimizationResult]:
    """Optimise until nothing more is gained: from inside of limits where it is stuck, with limits that it breaks.

    Raises `ProjectionError`: nothing can be followed from where it stands.
    """
    best, stood = np.inf, None
    while True:
        try:
            result = _optimised(tracker)
        except ProjectionError:
            if stood is not None:
                return tracker, stood
            if tracker.plan is None or tracker.ties is not None:
                raise
            tracker.say(_STILL)
            tracker = replace(tracker, start=hanging(tracker.plan), shooting="single")
            result = _optimised(tracker)
        tracker = tracker.spent(result)
        if result.gap > 0.0:  # what is left of them is for feedback
            tracker = replace(tracker, start=(result.x, result.u))
            continue
        stood = result
        stuck = result.status in STUCK and tracker.left > 0
        if tracker.plan is not None and stuck and result.cost < _GAINED * best:
            # Walls of low barriers are close together: with higher ones, and inside of them, there is a way on.
            best, start = result.cost, tracker.plan.inside(result.x, result.u, result.cost)
            tracker = replace(tracker, earlier=None, start=start)
            continue
        creeps = tracker.plan is not None and tracker.ties is None and result.status is Status.ITERATION_LIMIT
        if (stuck or (creeps and tracker.left > 0)) and tracker.may_grow:
            return _better(tracker, result)
        more = _more_limits(tracker, result)
        lost_patience = tracker.plan is None and tracker.patience < 1
        if not more or tracker.left < 1 or lost_patience or result.status in CUT_SHORT:
            return tracker, result
        tracker.say(f"it breaks limits of {', '.join(sorted(more))}: goes on with these stated")
        tracker = replace(tracker, kinds=tracker.kinds | more, start=result, earlier=None)


def _better(tracker: Tracker, result: OptimizationResult) -> tuple[Tracker, OptimizationResult]:
    """Return what following ever larger parts of the motion leads to, or a result that is stuck or creeps.

    The latter where it is nearer: much nearer, if the former is a minimum.
    """
    assert tracker.plan is not None
    slow = slower(tracker.motion)
    coarse = tracker.plan if slow is tracker.motion else tracker.plan.following(slow)
    tracker.say(_GROWING)
    try:
        found = grown(coarse, slow, tracker.say)
        start = found.initial
        if coarse is not tracker.plan:
            scale = tracker.plan.system.N / coarse.system.N
            start = tracker.plan.inside(*tracker.plan.finer(coarse, *start), scale * found.cost)
        effort = replace(
            tracker.effort,
            optimisations=tracker.effort.optimisations + len(found.stages),
            iterations=tracker.effort.iterations + found.iterations,
        )
        begun = replace(tracker, start=start, earlier=None, kinds=frozenset(KINDS), effort=effort, grows=False)
        other, other_result = improved(begun)
    except (ArgumentError, ProjectionError):
        return tracker, result
    except KeyboardInterrupt:
        return tracker, replace(result, status=Status.INTERRUPTED, message=_STOPPED)
    if result.cost > (1.0 / _LOST if other_result.success else 1.0) * other_result.cost:
        return other, other_result
    tracker = replace(tracker, start=None, earlier=result, effort=other.effort, left=other.left, grows=False)
    if tracker.left < 1 or result.status in STUCK or other_result.status in CUT_SHORT:
        return replace(tracker, earlier=None), result
    tracker.say("what was left behind is nearer: goes on with that")
    return improved(tracker)


def slower(motion: Motion) -> Motion:
    """Return a motion with steps of twice the length; that given where it has few, or long ones."""
    steps, dt = len(motion.t) - 1, float(motion.t[1] - motion.t[0])
    if steps < _FEW or 2.0 * dt > _LONGEST:
        return motion
    return motion.resample(motion.duration / (steps // 2), duration=motion.duration)


def _more_limits(tracker: Tracker, result: OptimizationResult) -> frozenset[str]:
    """Return the kinds of limits that a result breaks and that were not stated; the others need not be."""
    more = tracker.broken(result.x) - tracker.kinds
    if "tension" not in tracker.kinds and not tracker.limits.keep(tracker.run_of(result).tension):
        more |= {"tension"}
    return more


def _optimised(tracker: Tracker) -> OptimizationResult:
    """Return what one optimisation finds from where it stands, within the limits that are stated."""
    plan, problem = tracker.plan, tracker.problem
    system, cost = (plan.system, plan.cost()) if plan else (problem.system, problem.cost(problem.weights.tension))
    watch = _Watch(tracker)
    patience = tracker.left if not tracker.may_grow else _PLAN_PATIENCE
    if plan is None:
        patience = max(tracker.patience, 1)
    result = optimize(
        system,
        cost,
        initial=tracker.start,
        resume=tracker.earlier,
        limits=tracker.limits.of(system.mechanism, problem.pelvis, tracker.kinds),
        free_start=plan.free_start if plan else False,
        shooting=tracker.shooting,
        method=tracker.method,
        max_iterations=min(tracker.left, patience),
        tolerance=watch.tolerance,
        callback=watch,
    )
    if result.status is Status.INTERRUPTED and result.gap > 0.0:
        raise KeyboardInterrupt  # there is no motion yet
    if result.status is Status.INTERRUPTED and tracker.varies:
        # There may be no motion near it on strings that keep their lengths.
        tracker.kept(lambda: tracker.as_search(result), at_once=True)
    if watch.there:
        return replace(result, status=Status.CONVERGED, message=_THERE)
    return replace(result, status=Status.ITERATION_LIMIT, message=_CREPT) if watch.creeps else result


class _Watch:
    """Looks at the iterations of one optimisation: keeps the run now and then, tells the user, and ends it early.

    So it does if it creeps where something follows, and where it is near enough to its minimum for what follows.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._tracker, ties = tracker, tracker.ties
        self.creeps = self.there = False
        # Strings on bars may be tied so loosely that an optimisation only leads to the next, or not for the last time.
        self._passes = ties is not None and ties.weight < FIRM[0]
        self._leads_on = tracker.may_grow if ties is None else ties.weight < FIRM[-1]
        hardly = 0.0 if ties is None or not self._leads_on else _HARDLY if self._passes else _HARDLY_FIRM
        self._pace = Pace(hardly=hardly, earlier=tracker.earlier)

    @property
    def tolerance(self) -> float:
        """The tolerance: the user's, or else that of what is planned, or of a puppet that began hanging."""
        tracker = self._tracker
        if tracker.tolerance is not None:
            return tracker.tolerance
        if tracker.plan is None:
            return _HANGING
        if tracker.ties is None or self._passes:
            return _PLANNED
        return _TIED if tracker.slow is None else _TIED_SLOWLY

    def __call__(self, record: IterationRecord) -> object:
        """Return whether the optimisation ends here."""
        tracker = self._tracker

        def now() -> TrackingRun | TrackingSearch:
            found = record.snapshot()
            return tracker.as_search(found) if tracker.varies else tracker.run_of(found, counted=False)

        if record.gap == 0.0:
            tracker.kept(now)
        if tracker.callback is not None and tracker.callback(record):
            return True
        creeps = self._pace.creeps(record)
        # What limits are off by where strings on bars are tied is mended where these become rods.
        on_bars = tracker.ties is not None
        self.there = on_bars and not self._passes and self._pace.is_there(record, self.tolerance)
        self.creeps = self._leads_on and creeps and not self.there
        return self.creeps or self.there
