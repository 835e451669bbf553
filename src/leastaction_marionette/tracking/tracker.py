"""What `track` has while it works on a motion, and how that is improved by one optimisation after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io import Motion
from leastaction.mechanics import Mechanism
from leastaction.numerics import Array
from leastaction.optimal import Callback, IterationRecord, Method, OptimizationResult, Status
from leastaction_marionette.choices import Follow
from leastaction_marionette.tracking.by_lengths import by_lengths
from leastaction_marionette.tracking.checkpoints import Checkpoints
from leastaction_marionette.tracking.found import CUT_SHORT, STUCK, Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.motors import SEARCH_STAGES
from leastaction_marionette.tracking.pace import Pace
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.ties import FIRM
from leastaction_marionette.tracking.weights import FORCED, TrackingWeights

LOST: Final = 2.0
"""Times the cost with longer steps may the motion cost that begins with these."""

PATIENCE: Final = 100
"""Iterations of a puppet that began hanging; then its motion is planned by tensions."""

GAPS: Final = "the motion found with longer steps cannot be followed: gaps between its steps are closed"
AGAIN: Final = "they cannot be closed: the search begins again with these steps"

_GAINED = 0.999  # times its cost is that of a motion with which it is worth to go on from where a search was stuck
# Tolerances, if none is given: of a puppet that began hanging, of a plan, and where its strings are tied firmly. There
# one optimisation leads to the next, and most is gained with the first, whose longer steps are cheap.
_HANGING, _PLANNED, _TIED, _TIED_SLOWLY = 1e-6, 1e-2, 3e-3, 1e-3
# Parts of the cost that ten iterations hardly change: where strings on bars are tied loosely, and firmly but not last.
_HARDLY, _HARDLY_FIRM = 0.002, 0.005
_PLAN_PATIENCE = 150  # iterations of a plan, that then begins elsewhere
_CREPT = "The search creeps, and was made from elsewhere: what was left behind is nearer. Go on with --resume."
_THERE = "The expected decrease of the cost is below the tolerance; what limits are off by is settled on rods."
_STOPPED = "Ctrl-C ended the search for another way: this is the best motion found before."

Curve = tuple[Array, Array]


@dataclass
class Tracker:
    """A motion as it is followed so far, and what improves it. For one thread.

    The fields without a default are the arguments of `track`; ``left`` are the iterations that are left.
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

    # The motion with longer steps, while strings on bars are tied with these.
    slow: Motion | None = None
    problem: TrackingProblem = field(init=False)
    plan: TrackingPlan | None = None
    effort: Effort = field(default_factory=Effort)
    # Where the next optimisation begins: a curve or a result, or it goes on with an earlier one.
    start: Curve | OptimizationResult | None = None
    earlier: OptimizationResult | None = None
    kinds: frozenset[str] = frozenset()  # of limits that are stated
    # How a first trajectory is sought, where it begins with a puppet that is held still and that leads nowhere.
    search: Callable[[], None] | None = None
    began_still: bool = False  # whether a puppet that is held still is where all this began
    # Where else to begin, with what is said of it.
    others: list[tuple[str, Callable[[], Curve]]] = field(default_factory=list)
    most: float = np.inf  # that a motion may cost to begin with, or it is lost
    lost: bool = False
    pace: Pace = field(default_factory=Pace)  # of the optimisation under way
    creeps: bool = False  # and so it is left behind
    there: bool = False  # near enough to its minimum for what follows
    patience: int = PATIENCE

    def problem_with(self, weights: TrackingWeights) -> TrackingProblem:
        """Return the problem, with its own weights if it has none of the user's."""
        return TrackingProblem(self.mechanism, self.stepped, self.weights or weights, self.threads, self.follow)

    @property
    def stepped(self) -> Motion:
        """The motion with the steps that it is followed with for the time being."""
        return self.motion if self.slow is None else self.slow

    def planned(self) -> TrackingPlan:
        """Return the plan by tensions of the problem with the weights of such motions."""
        self.problem = self.problem_with(FORCED)
        return TrackingPlan(self.problem, self.weights or FORCED, self.limits)

    def broken(self, x: Array) -> frozenset[str]:
        """Return the kinds of limits that states break, besides that of the tensions."""
        mechanism = (self.problem if self.plan is None else self.plan).mechanism
        return self.limits.broken(mechanism, self.problem.t, self.problem.pelvis, x)

    def improve(self) -> OptimizationResult:
        """Optimise until nothing more is gained: from inside of limits, from elsewhere, with limits that it breaks."""
        best = np.inf
        stood: OptimizationResult | None = None
        # Where a search was stuck, or crept, and the limits it kept to, while another is made from elsewhere.
        left_behind: tuple[OptimizationResult, frozenset[str]] | None = None
        while True:
            try:
                result = self._optimised()
            except ProjectionError:
                if stood is not None:
                    result = stood
                    break
                if not self.others:
                    raise
                self.lost = True
            if self.lost and self.others:
                self.start, self.lost = self._elsewhere(), False
                continue
            stood, self.most = result, np.inf
            self._count(result)
            stuck = self.plan is not None and result.status in STUCK and self.left > 0
            if self.plan is not None and stuck and result.cost < _GAINED * best:
                # Walls of low barriers are close together: with higher ones, and inside of them, there is a way on.
                best, self.earlier = result.cost, None
                self.start = self.plan.inside(result.x, result.u, result.cost)
                continue
            # What is still to be tied need not be a minimum.
            creeps = self.plan is not None and not self.plan.varies and result.status is Status.ITERATION_LIMIT
            creeps = creeps and self.left > 0
            if (stuck or creeps) and self.others:
                if left_behind is None or result.cost < left_behind[0].cost:
                    left_behind = result, self.kinds
                # A search with these steps would lead to where it is stuck with them.
                self.others = [other for other in self.others if other[0] not in (GAPS, AGAIN)]
                try:
                    best, self.start, self.earlier = np.inf, self._elsewhere(), None
                except KeyboardInterrupt:
                    result, self.kinds = left_behind
                    return replace(result, status=Status.INTERRUPTED, message=_STOPPED)
                except ArgumentError:
                    break
                continue
            more = self._more_limits(result)
            lost_patience = self.plan is None and self.patience < 1
            if not more or self.left < 1 or lost_patience or result.status in CUT_SHORT:
                break
            self.say(f"it breaks limits of {', '.join(sorted(more))}: goes on with these stated")
            self.kinds, self.start, self.earlier = self.kinds | more, result, None
        return result if left_behind is None else self._better(result, *left_behind)

    def _better(
        self, result: OptimizationResult, left_behind: OptimizationResult, kinds: frozenset[str]
    ) -> OptimizationResult:
        """Return a result, or what was left behind where that is nearer: much nearer, if the result is a minimum."""
        if left_behind.cost > (1.0 / LOST if result.success else 1.0) * result.cost:
            return result
        self.kinds = kinds
        if self.left < 1 or left_behind.status in STUCK or result.status in CUT_SHORT:
            return left_behind
        self.say("what was left behind is nearer: goes on with that")
        self.start, self.earlier = None, left_behind
        found = self._optimised()
        self._count(found)
        if found.status in STUCK and self.left > 0:
            # Its prices and barriers may be what it is stuck with: once more from there with others.
            self.start, self.earlier = (found.x, found.u), None
            again = self._optimised()
            self._count(again)
            found = again if again.success else found
        return found

    def _elsewhere(self) -> Curve:
        """Return the next of the other places to begin.

        Raises `ArgumentError` where no limits allow any: the last is a puppet that hangs still.
        """
        while True:
            said, find = self.others.pop(0)
            self.say(said)
            found = find()
            assert self.plan is not None
            if len(found[1]) == self.plan.system.N:
                self.most = LOST * self.plan.cost().value(*found) if self.others else np.inf
                return found

    def _optimised(self) -> OptimizationResult:
        """Return what one optimisation finds from where it stands, within the limits that are stated."""
        plan, problem = self.plan, self.problem
        system, cost = (plan.system, plan.cost()) if plan else (problem.system, problem.cost(problem.weights.tension))
        self.pace, self.creeps, self.there = Pace(hardly=self._hardly), False, False
        result = optimize(
            system,
            cost,
            initial=self.start,
            resume=self.earlier,
            limits=self.limits.of(system.mechanism, problem.pelvis, self.kinds),
            free_start=plan.free_start if plan else False,
            shooting="single",
            method=self.method,
            max_iterations=min(self.left, self._patience),
            tolerance=self._asked_for,
            callback=self._watch,
        )
        if result.status is Status.INTERRUPTED and plan is not None and plan.varies:
            # There may be no motion near it on strings that keep their lengths.
            self.kept(lambda: self._as_search(result), at_once=True)
        if self.there:
            return replace(result, status=Status.CONVERGED, message=_THERE)
        return replace(result, status=Status.ITERATION_LIMIT, message=_CREPT) if self.creeps else result

    def _snapshot(self, record: IterationRecord) -> TrackingRun:
        return self.run_of(record.snapshot(), counted=False)

    @property
    def _patience(self) -> int:
        """Iterations after which another way is taken, where there is one."""
        if self.plan is None:
            return max(self.patience, 1)
        return _PLAN_PATIENCE if self.others else self.left

    @property
    def _leads_on(self) -> bool:
        """Whether there is something to go on with where an optimisation creeps."""
        plan = self.plan
        if plan is None or plan.ties is None:
            return plan is not None and bool(self.others)
        return bool(self.others) or plan.ties.weight < FIRM[-1]

    @property
    def _asked_for(self) -> float:
        """The tolerance: the user's, or else that of what is planned, or of a puppet that began hanging."""
        if self.tolerance is not None:
            return self.tolerance
        if self.plan is None:
            return _HANGING
        if self.plan.ties is None or self._passes:
            return _PLANNED
        return _TIED if self.slow is None else _TIED_SLOWLY

    @property
    def _hardly(self) -> float:
        """The part of its cost by which an optimisation creeps that only leads to the next."""
        if self.plan is None or self.plan.ties is None or self.plan.ties.weight >= FIRM[-1]:
            return 0.0
        return _HARDLY if self._passes else _HARDLY_FIRM

    @property
    def _passes(self) -> bool:
        """Whether strings on bars are still tied so loosely that an optimisation only leads to the next."""
        plan = self.plan
        return plan is not None and plan.ties is not None and plan.ties.weight < FIRM[0]

    def _watch(self, record: IterationRecord) -> object:
        """Stop a motion that is lost; else keep the run now and then, and tell the user's callback."""
        if record.iteration == 0 and record.cost > self.most:
            self.lost = True
            return True
        varies = self.plan is not None and self.plan.varies
        on_bars = self.plan is not None and self.plan.ties is not None
        self.kept(lambda: self._as_search(record.snapshot()) if varies else self._snapshot(record))
        if self.callback is not None and self.callback(record):
            return True
        creeps = self.pace.creeps(record)
        # What limits are off by where strings on bars are tied is mended where these become rods.
        self.there = on_bars and not self._passes and self.pace.is_there(record, self._asked_for)
        self.creeps = self._leads_on and creeps and not self.there
        return self.creeps or self.there

    def _count(self, result: OptimizationResult) -> None:
        before = 0 if self.earlier is None else self.earlier.iterations
        self.effort = self.effort.plus(result, before=before, scale=len(self.motion.t) / len(self.stepped.t))
        self.left -= result.iterations - before
        self.patience -= result.iterations - before

    def spend(self, found: OptimizationResult, scale: float | None) -> None:
        """Count an optimisation of the search for a first trajectory; ``scale``: as of `Effort.plus`."""
        self.effort = self.effort.plus(found, scale=scale)

    def _as_search(self, found: OptimizationResult) -> TrackingSearch:
        """Return an iterate on which strings on bars still vary in length, as what is gone on with.

        Cheaper than a run is.
        """
        assert self.plan is not None
        assert self.plan.ties is not None
        return TrackingSearch(
            mechanism=self.mechanism,
            motion=self.motion,
            stage=SEARCH_STAGES,
            result=found,
            follow=self.follow,
            effort=self.effort.plus(found, before=0 if self.earlier is None else self.earlier.iterations),
            firmness=self.plan.ties.weight,
            kinds=self.kinds,
        )

    def _more_limits(self, result: OptimizationResult) -> frozenset[str]:
        """Return the kinds of limits that a result breaks and that were not stated; the others need not be."""
        more = self.broken(result.x) - self.kinds
        if "tension" not in self.kinds and not self.limits.keep(self.run_of(result).tension):
            more |= {"tension"}
        return more

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
