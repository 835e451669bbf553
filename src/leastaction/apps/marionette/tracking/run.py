"""The main job: a marionette learns to follow a reference motion.

The reference gives the body's variables only. `track` guesses the strings that go with it, finds a first
trajectory that the puppet can make, and improves it with `leastaction.optimal.optimize`.

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
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from leastaction.apps.choices import Follow
from leastaction.apps.marionette.tracking import tying
from leastaction.apps.marionette.tracking.checkpoints import Checkpoints
from leastaction.apps.marionette.tracking.found import CUT_SHORT, STUCK, Effort, TrackingRun, TrackingSearch
from leastaction.apps.marionette.tracking.growing import grown
from leastaction.apps.marionette.tracking.limits import FIRST_KINDS, KINDS, PuppetLimits
from leastaction.apps.marionette.tracking.plan import Plan
from leastaction.apps.marionette.tracking.poses import at_rest
from leastaction.apps.marionette.tracking.problem import TrackingProblem, below_strings
from leastaction.apps.marionette.tracking.settle import NotTiedError
from leastaction.apps.marionette.tracking.ties import FIXED_FROM, WEIGHTS
from leastaction.apps.marionette.tracking.weights import FORCED, GENTLE, TrackingWeights
from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io.motion.motion import Motion
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import tie_strings
from leastaction.numerics.arrays import Array
from leastaction.optimal import IterationRecord, OptimizationResult, Status, optimize
from leastaction.optimal.loop import Callback
from leastaction.optimal.settings import Method

_LOST = 2.0  # times the cost with longer steps may the motion cost that begins with these
_LONGEST = 0.021  # s, of the steps with which a captured motion can be searched
_GAINED = 0.999  # times its cost is that of a motion with which it is worth to go on from where a search was stuck
_AGAIN = "the motion found with longer steps cannot be followed: the search begins again with these"
_GROWING = "the motion found cannot be followed: ever larger parts of the wanted one are"
_HANGING = "the motion found cannot be followed: it begins with a puppet that hangs still"
_PATIENCE = 100  # iterations of a puppet that began hanging; then its motion is planned by tensions
_PLAN_PATIENCE = 150  # the same of a plan, that then begins elsewhere
_STOPPED = "Ctrl-C ended the search for another way: this is the best motion found before."
_FEW = 100  # steps, for which a search with longer ones is not worth it

Curve = tuple[Array, Array]


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
        As in `leastaction.optimal.optimize`, for the last optimisation.
    tolerance : float, optional
        Likewise. If not given, 1e-6, or 1e-2 where the first trajectory had to be found by embedding:
        such a motion is far from what the puppet does by itself, and its last digits cost much.
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
        For Ctrl-C while a first trajectory is sought; later it ends the optimisation with what it has.
    ArgumentError
        If the motion does not name the variables, is too short, or no first trajectory is found.
    """
    job = Job(
        mechanism=mechanism,
        motion=motion,
        weights=weights,
        limits=limits or PuppetLimits(),
        follow=follow if resume is None else resume.follow,
        method=method,
        tolerance=tolerance,
        callback=callback,
        say=progress or (lambda _: None),
        kept=Checkpoints(checkpoint, checkpoint_seconds),
        threads=threads,
        left=max_iterations,
    )
    job.begin(resume, planned=planned)
    result = job.tied(job.improve())
    run = job.ended(result)
    if not job.must_be_planned(run):
        return job.with_strings_that_pull(run)
    job.begin_plan(run, max_iterations)
    return job.ended(job.tied(job.improve()))


@dataclass
class Job:
    """What `track` does, step by step. For one thread.

    The fields without a default are its arguments; ``left`` are the iterations that are left.
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

    problem: TrackingProblem = field(init=False)
    plan: Plan | None = None
    effort: Effort = field(default_factory=Effort)
    # Where the next optimisation begins: a curve or a result, or it goes on with an earlier one.
    start: Curve | OptimizationResult | None = None
    earlier: OptimizationResult | None = None
    kinds: frozenset[str] = frozenset()  # of limits that are stated
    # Where else to begin, with what is said of it.
    others: list[tuple[str, Callable[[], Curve]]] = field(default_factory=list)
    most: float = np.inf  # that a motion may cost to begin with, or it is lost
    lost: bool = False
    patience: int = _PATIENCE

    def begin(self, resume: TrackingRun | TrackingSearch | None, *, planned: bool) -> None:
        """Find where to begin: what hanging strings do, where a run was, or what a search finds."""
        self.motion, lowered = below_strings(self.mechanism, self.motion)
        if lowered > 0.0:
            self.say(f"the motion rises above the plane of the strings: lowered there, by up to {lowered:.2g} m")
        self.problem = self._problem(GENTLE)
        self.patience = _PATIENCE
        if isinstance(resume, TrackingRun):
            self._go_on(resume)
            return
        hanging = self.problem.hang() if resume is None and not planned else None
        if hanging is None:
            self._search(resume)
        else:
            self.start = hanging

    def _problem(self, weights: TrackingWeights) -> TrackingProblem:
        """Return the problem, with its own weights if it has none of the user's."""
        return TrackingProblem(self.mechanism, self.motion, self.weights or weights, self.threads, self.follow)

    def planned(self) -> Plan:
        """Return the plan by tensions of the problem with the weights of such motions."""
        self.problem = self._problem(FORCED)
        return Plan(self.problem, self.weights or FORCED, self.limits)

    def _go_on(self, run: TrackingRun) -> None:
        """Begin where a run was."""
        self.kinds = run.kinds
        self.effort = run.effort or Effort().plus(run.plan or run.result)
        self.earlier = run.unfinished or run.result
        if run.embedded and run.unfinished is None:
            self.plan, self.earlier = self.planned(), run.plan
            if self.plan.ties is not None:
                self.plan.ties.weight, self.plan.ties.firm = WEIGHTS[-2], True
        self.patience = _PATIENCE - (0 if self.earlier is None else self.earlier.iterations)

    def _search(self, cut_short: TrackingSearch | None) -> None:
        """Seek a first trajectory with motors, or go on with a search that was cut short."""
        if cut_short is not None and cut_short.firmness is not None:
            tying.go_on(self, cut_short)
            return
        if cut_short is None:
            self.mechanism = tie_strings(self.mechanism, self.problem.reference)
        self.plan = plan = self.planned()
        stage, before = (0, None) if cut_short is None else (cut_short.stage, cut_short.result)
        if cut_short is not None:
            self.effort = cut_short.effort
        coarse, _ = _coarser(plan, self.motion)
        # A search that had to take the plan's own steps goes on with them.
        searched = plan if before is not None and len(before.u) == plan.system.N else coarse
        found = self._searched_by(searched, stage=stage, result=before)
        self.start = found
        if searched is not plan:
            expected = searched.cost().value(*found) * plan.system.N / searched.system.N
            self.start = plan.inside(*plan.finer(searched, *found), expected)
            self.most = _LOST * expected
            self.others.append((_AGAIN, partial(self._searched_by, plan)))
        self.others += [(_GROWING, self._grown), (_HANGING, self._hanging)]
        self.kinds = FIRST_KINDS | self._broken(self.start[0])

    def _searched_by(self, plan: Plan, *, stage: int = 0, result: OptimizationResult | None = None) -> Curve:
        assert self.plan is not None
        scale = self.plan.system.N / plan.system.N
        return plan.search(
            self.say,
            stage=stage,
            result=result,
            keep=self._keep_search,
            count=lambda found, motors: self._spend(found, None if motors else scale),
        )

    def _grown(self) -> Curve:
        """Return what following ever larger parts of the motion leads to; all limits are stated on that way."""
        assert self.plan is not None
        self.kinds = frozenset(KINDS)
        return grown(self.plan, *_coarser(self.plan, self.motion), self.say, self._spend)

    def _spend(self, found: OptimizationResult, scale: float | None) -> None:
        """Count an optimisation of the search for a first trajectory; ``scale``: as of `Effort.plus`."""
        self.effort = self.effort.plus(found, scale=scale)

    def _keep_search(self, stage: int, found: OptimizationResult, at_once: bool) -> None:
        self.kept(
            lambda: TrackingSearch(
                mechanism=self.mechanism,
                motion=self.motion,
                stage=stage,
                result=found,
                follow=self.follow,
                effort=self.effort,
            ),
            at_once=at_once,
        )

    def _broken(self, x: Array) -> frozenset[str]:
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
                self.start, self.most, self.lost = self._elsewhere(), np.inf, False
                continue
            stood, self.most = result, np.inf
            self._count(result)
            stuck = self.plan is not None and result.status in STUCK and self.left > 0
            if self.plan is not None and stuck and result.cost < _GAINED * best:
                # Walls of low barriers are close together: with higher ones, and inside of them, there is a way on.
                best, self.earlier = result.cost, None
                self.start = self.plan.inside(result.x, result.u, result.cost)
                continue
            creeps = self.plan is not None and result.status is Status.ITERATION_LIMIT and self.left > 0
            if (stuck or creeps) and self.others:
                if left_behind is None or result.cost < left_behind[0].cost:
                    left_behind = result, self.kinds
                # A search with these steps would lead to where it is stuck with them.
                self.others = [other for other in self.others if other[0] != _AGAIN]
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
        if left_behind.cost > (1.0 / _LOST if result.success else 1.0) * result.cost:
            return result
        self.kinds = kinds
        if self.left < 1 or left_behind.status in STUCK or result.status in CUT_SHORT:
            return left_behind
        self.say("what was left behind is nearer: goes on with that")
        self.start, self.earlier = None, left_behind
        found = self._optimised()
        self._count(found)
        return found

    tied, tie, varies = tying.tied, tying.tie, property(tying.varies)

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
                return found

    def _hanging(self) -> Curve:
        """Return what the puppet does where its strings are held, or poses at rest where it falls from them."""
        assert self.plan is not None
        hung = self.plan.hung()
        return hung if len(hung[1]) == self.plan.system.N else at_rest(self.plan)

    def _optimised(self) -> OptimizationResult:
        """Return what one optimisation finds from where the job stands, within the limits that are stated."""
        plan, problem = self.plan, self.problem
        system, cost = (plan.system, plan.cost()) if plan else (problem.system, problem.cost(problem.weights.tension))
        tolerance = self.tolerance
        if tolerance is None:
            tolerance = 1e-6 if plan is None else 1e-2
        return optimize(
            system,
            cost,
            initial=self.start,
            resume=self.earlier,
            limits=self.limits.of(system.integrator.mechanism, problem.pelvis, self.kinds),
            free_start=plan.free_start if plan else False,
            shooting="single",
            method=self.method,
            max_iterations=min(self.left, self._patience),
            tolerance=tolerance,
            callback=self._watch,
        )

    def _snapshot(self, record: IterationRecord) -> TrackingRun:
        return self.run_of(record.snapshot(), counted=False)

    @property
    def _patience(self) -> int:
        """Iterations after which another way is taken, where there is one."""
        if self.plan is None:
            return max(self.patience, 1)
        return _PLAN_PATIENCE if self.others else self.left

    def _watch(self, record: IterationRecord) -> object:
        """Stop a motion that is lost; else keep the run now and then, and tell the user's callback."""
        if record.iteration == 0 and record.cost > self.most:
            self.lost = True
            return True
        varies = self.varies
        self.kept(lambda: tying.kept_search(self, record.snapshot()) if varies else self._snapshot(record))
        return self.callback(record) if self.callback is not None else None

    def _count(self, result: OptimizationResult) -> None:
        before = 0 if self.earlier is None else self.earlier.iterations
        self.effort = self.effort.plus(result, before=before)
        self.left -= result.iterations - before
        self.patience -= result.iterations - before

    def _more_limits(self, result: OptimizationResult) -> frozenset[str]:
        """Return the kinds of limits that a result breaks and that were not stated; the others need not be."""
        more = self._broken(result.x) - self.kinds
        if "tension" not in self.kinds and self.run_of(result).tension.min() < self.limits.tension:
            more |= {"tension"}
        return more

    def run_of(self, found: OptimizationResult, *, counted: bool = True) -> TrackingRun:
        """Return a result as a run; ``counted``: whether it is in the effort already."""
        result = found if self.plan is None else self.plan.by_lengths(found)
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

    def ended(self, result: OptimizationResult) -> TrackingRun:
        """Return the run that a result is; of a plan, with strings that pull wherever it ended."""
        if self.plan is not None:
            if self.varies and self.plan.ties is not None and self.plan.ties.weight < FIXED_FROM:
                self.tie(result)
            result = self.plan.pulling(result)
        try:
            run = self.run_of(result)
            return run if self.plan is None or self.plan.ties is None or result.success else tying.or_still(self, run)
        except NotTiedError as error:
            assert self.plan is not None
            self.say(f"{error}: it is held still")
            return self.run_of(tying.holds_still(self, result))
        except KeyboardInterrupt:  # too late to stop anything, and no reason to lose what there is
            return self.run_of(result)

    def must_be_planned(self, run: TrackingRun) -> bool:
        """Whether hanging strings found no way, or ended up pushing, with time to plan by tensions."""
        if self.plan is not None or self._cut_short(run):
            return False
        return self._creeps(run) or run.tension.min() < 0.0

    def _creeps(self, run: TrackingRun) -> bool:
        return not run.result.success and not run.ended_early and self.left > 0

    def _cut_short(self, run: TrackingRun) -> bool:
        """Whether a hanging puppet's run ended before its strings were told to pull."""
        return self.plan is None and run.tension.min() < 0.0 and (run.ended_early or self.left < 1)

    def with_strings_that_pull(self, run: TrackingRun) -> TrackingRun:
        """Return a run, or a motion near it in which strings pull where it was cut short before they were told to."""
        if not self._cut_short(run):
            return run
        result = run.result
        self.plan = plan = self.planned()
        pulling = self.run_of(plan.pulling(plan.by_tensions(run.trajectory, run.tension, result)))
        return replace(pulling, unfinished=result)

    def begin_plan(self, run: TrackingRun, max_iterations: int) -> None:
        """Begin again with a plan by tensions, with what is left of the iterations where a hanging puppet crept."""
        creeps = self._creeps(run)
        why = "a hanging puppet finds no way" if creeps else "hanging strings end up pushing"
        self.say(f"{why}: the motion is planned by tensions")
        self.left = self.left if creeps else max_iterations
        self.earlier = None
        self.kinds = frozenset()
        self.begin(None, planned=True)


def _coarser(plan: Plan, motion: Motion) -> tuple[Plan, Motion]:
    """Return a plan with steps of twice the length, and its motion; those given where it has few, or long ones."""
    steps = len(motion.t) - 1
    if steps < _FEW or 2.0 * plan.dt > _LONGEST:
        return plan, motion
    slow = motion.resample(motion.duration / (steps // 2), duration=motion.duration)
    return plan.following(slow), slow
