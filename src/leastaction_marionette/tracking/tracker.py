"""How far `track` has come with a motion, and how that is improved by one optimisation after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from leastaction.errors import ProjectionError
from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.numerics import Array
from leastaction.optimal import Callback, IterationRecord, Method, OptimizationResult, Shooting, Status, optimize
from leastaction_marionette.choices import Follow
from leastaction_marionette.tracking.by_lengths import by_lengths
from leastaction_marionette.tracking.checkpoints import Checkpoints
from leastaction_marionette.tracking.found import CUT_SHORT, STUCK, Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.motors import SEARCH_STAGES
from leastaction_marionette.tracking.pace import Pace
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import hanging
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.ties import FIRM, Ties
from leastaction_marionette.tracking.weights import FORCED, TrackingWeights

PATIENCE: Final = 100
"""Iterations of a puppet that began hanging; then its motion is planned by tensions."""

_GAINED = 0.999  # share of its cost with which it is worth to go on from where a search was stuck
# Tolerances, if none is given: of a puppet that began hanging, of a plan, and where its strings are tied firmly. There
# one optimisation leads to the next, and most is gained with the first, whose longer steps are cheap.
_HANGING, _PLANNED, _TIED, _TIED_SLOWLY = 1e-6, 1e-2, 3e-3, 1e-3
# Parts of the cost that ten iterations hardly change: where strings on bars are tied loosely, and firmly but not last.
_HARDLY, _HARDLY_FIRM = 0.002, 0.005
_CREPT = "The search creeps: what it has found is gone on with."
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
        before = 0 if self.earlier is None else self.earlier.iterations
        made = found.iterations - before
        scale = len(self.motion.t) / len(self.stepped.t)
        effort = self.effort.plus(found, before=before, scale=scale)
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
            effort=self.effort.plus(found, before=0 if self.earlier is None else self.earlier.iterations),
            firmness=self.ties.weight,
            kinds=self.kinds,
        )

    def run_of(self, found: OptimizationResult, *, counted: bool = True) -> TrackingRun:
        """Return a result as a run; ``counted``: whether it is in the effort already."""
        result = found if self.plan is None else by_lengths(self.plan, found)
        before = 0 if self.earlier is None else self.earlier.iterations
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
            effort=self.effort if counted else self.effort.plus(found, before=before),
        )


def improved(tracker: Tracker) -> tuple[Tracker, OptimizationResult]:
    """Optimise until nothing more is gained: from inside of limits where it is stuck, with limits that it breaks.

    Raises `ProjectionError`: nothing can be followed from where it stands.
    """
    best, stood = np.inf, None
    while True:
        try:
            stood = result = _optimised(tracker)
        except ProjectionError:
            if stood is not None:
                return tracker, stood
            if tracker.plan is None or tracker.ties is not None:
                raise
            tracker.say(_STILL)
            tracker = replace(tracker, start=hanging(tracker.plan))
            stood = result = _optimised(tracker)
        tracker = tracker.spent(result)
        stuck = result.status in STUCK and tracker.left > 0
        if tracker.plan is not None and stuck and result.cost < _GAINED * best:
            # Walls of low barriers are close together: with higher ones, and inside of them, there is a way on.
            best, start = result.cost, tracker.plan.inside(result.x, result.u, result.cost)
            tracker = replace(tracker, earlier=None, start=start)
            continue
        more = _more_limits(tracker, result)
        lost_patience = tracker.plan is None and tracker.patience < 1
        if not more or tracker.left < 1 or lost_patience or result.status in CUT_SHORT:
            return tracker, result
        tracker.say(f"it breaks limits of {', '.join(sorted(more))}: goes on with these stated")
        tracker = replace(tracker, kinds=tracker.kinds | more, start=result, earlier=None)


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
    result = optimize(
        system,
        cost,
        initial=tracker.start,
        resume=tracker.earlier,
        limits=tracker.limits.of(system.mechanism, problem.pelvis, tracker.kinds),
        free_start=plan.free_start if plan else False,
        shooting=tracker.shooting,
        method=tracker.method,
        max_iterations=tracker.left if plan else min(tracker.left, max(tracker.patience, 1)),
        tolerance=watch.tolerance,
        callback=watch,
    )
    if result.status is Status.INTERRUPTED and tracker.varies:
        # There may be no motion near it on strings that keep their lengths.
        tracker.kept(lambda: tracker.as_search(result), at_once=True)
    if watch.there:
        return replace(result, status=Status.CONVERGED, message=_THERE)
    return replace(result, status=Status.ITERATION_LIMIT, message=_CREPT) if watch.creeps else result


class _Watch:
    """Looks at the iterations of one optimisation: keeps the run now and then, tells the user, and ends it early.

    So it does where strings on bars are tied: if it creeps, and only leads to the next; if it is near enough to its
    minimum for what follows.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._tracker, ties = tracker, tracker.ties
        self.creeps = self.there = False
        # Strings on bars may be tied so loosely that an optimisation only leads to the next, or not for the last time.
        self._passes = ties is not None and ties.weight < FIRM[0]
        self._leads_on = ties is not None and ties.weight < FIRM[-1]
        self._pace = Pace(hardly=0.0 if not self._leads_on else _HARDLY if self._passes else _HARDLY_FIRM)

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

        tracker.kept(now)
        if tracker.callback is not None and tracker.callback(record):
            return True
        creeps = self._pace.creeps(record)
        # What limits are off by where strings on bars are tied is mended where these become rods.
        on_bars = tracker.ties is not None
        self.there = on_bars and not self._passes and self._pace.is_there(record, self.tolerance)
        self.creeps = self._leads_on and creeps and not self.there
        return self.creeps or self.there
