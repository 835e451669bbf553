"""The main job: a marionette learns to follow a reference motion.

The reference gives the body's variables only. `track` guesses the strings that go with it, finds a first
trajectory that the puppet can make, and improves it with `leastaction.optimal.optimize`.

The first trajectory is what the puppet does when its strings simply hang above the hooks of the reference.
Where that goes wrong, because the motion is fast or the strings lose their grip on a stretched limb, the motion is
planned by tensions (`Plan`): every joint gets a motor, with which any motion can be followed (*dynamic embedding*,
dissertation 6.6.1); the motors are made ever more expensive until they do nothing, and are then taken away.

Limits hold all along: strings pull, hinges do not overstretch, the strings' upper ends stay within reach and move as
fast as `PuppetLimits` says. What cannot be followed within them is followed as well as they allow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from leastaction.apps.marionette.markers import Follow, places_of, with_places
from leastaction.apps.marionette.tracking.checkpoints import Checkpoints
from leastaction.apps.marionette.tracking.limits import PuppetLimits
from leastaction.apps.marionette.tracking.plan import Plan
from leastaction.apps.marionette.tracking.problem import ROOT, TrackingProblem, below_strings, unheld
from leastaction.apps.marionette.tracking.weights import FORCED, GENTLE, TrackingWeights
from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io.motion.motion import Motion
from leastaction.io.results.record import Provenance
from leastaction.mechanics import Mechanism, Trajectory
from leastaction.numerics.arrays import Array
from leastaction.optimal import IterationRecord, OptimizationResult, Status, optimize
from leastaction.optimal.optimize import Callback
from leastaction.optimal.settings import Method
from leastaction.viz.tracking import TrackingErrors, tracking_errors

_LOST = 2.0  # times the cost with longer steps may the motion cost that begins with these
_LONGEST = 0.021  # s, of the steps with which a captured motion can be searched
_STUCK = (Status.LINE_SEARCH_FAILED, Status.NO_DIRECTION, Status.SADDLE)
_CUT_SHORT = (Status.INTERRUPTED, Status.STOPPED_BY_CALLBACK)
_GAINED = 0.999  # times its cost is that of a motion with which it is worth to go on from where a search was stuck
_AGAIN = "the motion found with longer steps cannot be followed: the search begins again with these"
_HANGING = "the motion found cannot be followed: it begins with a puppet that hangs still"
_PATIENCE = 100  # iterations of a puppet that began hanging; then its motion is planned by tensions
_FEW = 100  # steps, for which a search with longer ones is not worth it


@dataclass(frozen=True, kw_only=True)
class TrackingRun:
    """A motion of the marionette, what it was asked to do, and how it was found.

    Attributes
    ----------
    mechanism : Mechanism
    source : str
        Where the reference motion comes from, in words.
    reference : ndarray, shape (N+1, nq)
        The configurations to be followed, with the strings that were guessed for them.
    embedded : bool
        Whether the motion was planned by tensions, its first trajectory found by dynamic embedding.
    trajectory : Trajectory
        The motion, by names: times, configurations, momenta, multipliers.
    result : OptimizationResult
        Of the optimiser, with the gains that hold the motion; its states are ``[q; rho; p; v_rho; lam]``.
    plan : OptimizationResult or None
        Of a motion that was planned by tensions: the optimiser's own result, in whose variables `result` says the same.
        Its states are ``[q; rho; p; v_rho]``, its inputs the tensions and the next places of the upper ends.
    kinds : frozenset of str
        The kinds of limits that were stated, of those that `PuppetLimits` has; the motion keeps to the others anyway.
    unfinished : OptimizationResult or None
        Of a run that was cut short before its strings were told to pull: where it goes on. What the rest says is a
        motion near that one, in which they do.
    follow : {"joints", "markers"}
        What of the reference was followed.
    markers : ndarray (N+1, 6, 3) or None
        Where the markers are wanted (m), in the order of `leastaction.apps.marionette.MARKERS`, if that is known.
    provenance : Provenance
    """

    mechanism: Mechanism = field(repr=False)
    source: str
    reference: Array = field(repr=False)
    embedded: bool
    trajectory: Trajectory = field(repr=False)
    result: OptimizationResult = field(repr=False)
    plan: OptimizationResult | None = field(default=None, repr=False)
    kinds: frozenset[str] = frozenset()
    unfinished: OptimizationResult | None = field(default=None, repr=False)
    follow: Follow = "joints"
    markers: Array | None = field(default=None, repr=False)
    provenance: Provenance = field(default_factory=Provenance.now)

    @property
    def motion(self) -> Motion:
        """The reference motion of the body, with its markers if they are known."""
        names = self.mechanism.dynamic
        body = Motion(names, self.trajectory.t, self.reference[:, : len(names)], self.source)
        return body if self.markers is None else with_places(body, self.markers)

    @property
    def tension(self) -> Array:
        """String tensions (N), shape (N, nc), in the order of the constraints."""
        by_name = self.trajectory.tensions()
        tension = np.stack([by_name[name] for name in self.mechanism.constraints], axis=1)
        tension[0] *= 2.0  # the first impulse is that of half a step, see Trajectory.tensions
        return tension

    @property
    def errors(self) -> TrackingErrors:
        """How far each variable of the body is from the reference."""
        return self.errors_of(self.trajectory.q)

    def errors_of(self, q: Array) -> TrackingErrors:
        """Return how far each variable of the body is from the reference in configurations q (N+1, nq)."""
        nd = self.mechanism.nd
        return tracking_errors(self.reference[:, :nd], q[:, :nd], self.mechanism.dynamic, lengths=ROOT)

    @property
    def held_error(self) -> float:
        """Root mean square error (degrees) of the angles behind which a string is tied."""
        return held_error(self.mechanism, self.reference, self.trajectory.q)

    def markers_apart(self, q: Array | None = None, rows: slice | Array = slice(None)) -> Array:
        """Return how far the markers are from where they are wanted (m): (n, 6).

        ``q``: configurations (n, nq) at some of the instants, ``rows``; those of the motion itself if left out. Raises
        `ArgumentError` if it is not known where markers are wanted.
        """
        if self.markers is None:
            raise ArgumentError("markers: the motion does not say where they are wanted; load it with markers=True")
        made = places_of(self.mechanism, self.trajectory.q if q is None else q)
        return np.asarray(np.linalg.norm(made - self.markers[rows], axis=2))

    @property
    def off(self) -> float:
        """How far what is followed is off, rms: joints that strings hold in degrees, or markers in millimetres."""
        return self.off_of(self.trajectory.q)

    def off_of(self, q: Array) -> float:
        """Return how far what is followed is `off` in configurations q (N+1, nq)."""
        if self.follow == "joints":
            return held_error(self.mechanism, self.reference, q)
        return 1e3 * float(np.sqrt(np.mean(self.markers_apart(q) ** 2)))

    @property
    def ended_early(self) -> bool:
        """Whether Ctrl-C or a callback ended it."""
        return self.result.status in _CUT_SHORT


def held_error(mechanism: Mechanism, reference: Array, q: Array) -> float:
    """Return the root mean square error (degrees) of the angles behind which a string is tied.

    ``reference``, ``q`` (N+1, nq): the wanted configurations and those that were made.
    """
    free = (*ROOT, *unheld(mechanism))
    held = [i for i, name in enumerate(mechanism.dynamic) if name not in free]
    return float(np.rad2deg(np.sqrt(np.mean((reference - q)[:, held] ** 2))))


@dataclass(frozen=True, kw_only=True)
class TrackingSearch:
    """A search for a first trajectory by dynamic embedding, as far as it went; `track` goes on with it.

    Attributes
    ----------
    mechanism : Mechanism
    motion : Motion
        To be followed.
    stage : int
        Which of the search's optimisations is next.
    result : OptimizationResult
        Of the one before it.
    follow : {"joints", "markers"}
        What of the motion.
    provenance : Provenance
    """

    mechanism: Mechanism = field(repr=False)
    motion: Motion
    stage: int
    result: OptimizationResult = field(repr=False)
    follow: Follow = "joints"
    provenance: Provenance = field(default_factory=Provenance.now)


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
    kept = Checkpoints(checkpoint, checkpoint_seconds)
    if resume is not None:
        follow = resume.follow

    def keep_search(stage: int, found: OptimizationResult, at_once: bool) -> None:
        kept(
            lambda: TrackingSearch(mechanism=mechanism, motion=motion, stage=stage, result=found, follow=follow),
            at_once=at_once,
        )

    bounds = limits or PuppetLimits()
    motion, lowered = below_strings(mechanism, motion)
    if lowered > 0.0 and progress is not None:
        progress(f"the motion rises above the plane of the strings: lowered there, by up to {lowered:.2g} m")
    problem = TrackingProblem(mechanism, motion, weights or GENTLE, threads, follow)
    initial = problem.hang() if resume is None and not planned else None
    embedded, earlier = initial is None, None
    if isinstance(resume, TrackingRun):
        embedded = resume.embedded and resume.unfinished is None
        earlier = resume.unfinished or resume.result
    plan: Plan | None = None
    most = np.inf
    # Where else to begin, with what is said of it.
    others: list[tuple[str, Callable[[], tuple[Array, Array]]]] = []
    if embedded:
        problem = TrackingProblem(mechanism, motion, weights or FORCED, threads, follow)
        plan = Plan(problem, weights or FORCED, bounds)
        coarse = _coarser(plan, motion)
        if isinstance(resume, TrackingRun):
            earlier = resume.plan
        else:
            stage, before = (resume.stage, resume.result) if isinstance(resume, TrackingSearch) else (0, None)
            # A search that had to take the plan's own steps goes on with them.
            searched = plan if before is not None and len(before.u) == plan.system.N else coarse
            say = progress or (lambda _: None)
            found = searched.search(say, stage=stage, result=before, keep=keep_search)
            initial = found
            if searched is not plan:
                expected = searched.cost().value(*found) * plan.system.N / searched.system.N
                initial = plan.inside(*plan.finer(searched, *found), expected)
                most = _LOST * expected
                others.append((_AGAIN, partial(plan.search, say, keep=keep_search)))
            others.append((_HANGING, plan.hung))

    def run_of(found: OptimizationResult) -> TrackingRun:
        result = found if plan is None else plan.by_lengths(found)
        return TrackingRun(
            mechanism=mechanism,
            source=motion.source,
            reference=problem.reference,
            embedded=embedded,
            trajectory=problem.system.trajectory(result.x, result.u),
            result=result,
            plan=None if plan is None else found,
            kinds=kinds,
            follow=follow,
            markers=problem.markers,
        )

    lost = False

    def watch(record: IterationRecord) -> object:
        nonlocal lost
        if record.iteration == 0 and record.cost > most:
            lost = True
            return True
        kept(lambda: run_of(record.snapshot()))
        return callback(record) if callback is not None else None

    if tolerance is None:
        tolerance = 1e-2 if embedded else 1e-6
    system, cost = (plan.system, plan.cost()) if plan else (problem.system, problem.cost(problem.weights.tension))
    mechanism_used, place = system.integrator.mechanism, problem.reference[:, :2]
    if isinstance(resume, TrackingRun):
        kinds = resume.kinds
    else:
        kinds = frozenset()
        if embedded:
            kinds = frozenset({"tension", "joints"})
            if initial is not None:
                kinds |= bounds.broken(mechanism_used, problem.t, place, initial[0])
    left, best = max_iterations, np.inf
    start: tuple[Array, Array] | OptimizationResult | None = initial
    stood: OptimizationResult | None = None
    # Where a search was stuck, and the limits it kept to, while another is made from elsewhere.
    left_behind: tuple[OptimizationResult, frozenset[str]] | None = None
    patience = _PATIENCE - (0 if earlier is None else earlier.iterations)
    while True:
        budget = left if plan else min(left, max(patience, 1))
        try:
            result = optimize(
                system,
                cost,
                initial=start,
                resume=earlier,
                limits=bounds.of(mechanism_used, place, kinds),
                free_start=plan.free_start if plan else False,
                shooting="single",
                method=method,
                max_iterations=budget,
                tolerance=tolerance,
                callback=watch,
            )
        except ProjectionError:
            if stood is not None:
                result = stood
                break
            if not others:
                raise
            lost = True
        if lost and others:
            said, find = others.pop(0)
            if progress is not None:
                progress(said)
            start, most, lost = find(), np.inf, False
            continue
        stood, most = result, np.inf
        made = result.iterations - (0 if earlier is None else earlier.iterations)
        left, patience = left - made, patience - made
        if plan is not None and result.status in _STUCK and left > 0 and result.cost < _GAINED * best:
            # Walls of low barriers are close together: with higher ones, and inside of them, there is a way on.
            best, start, earlier = result.cost, plan.inside(result.x, result.u, result.cost), None
            continue
        if plan is not None and result.status in _STUCK and left > 0 and others:
            if left_behind is None or result.cost < left_behind[0].cost:
                left_behind = result, kinds
            said, find = others.pop(0)
            if progress is not None:
                progress(said)
            another = find()
            if len(another[1]) == system.N:
                best, start, earlier = np.inf, another, None
                continue
        # A limit that the motion keeps to anyway need not be stated; one that it breaks is, and the search goes on.
        more = bounds.broken(mechanism_used, problem.t, place, result.x) - kinds
        if "tension" not in kinds and run_of(result).tension.min() < bounds.tension:
            more |= {"tension"}
        lost_patience = plan is None and patience < 1
        if not more or left < 1 or lost_patience or result.status in _CUT_SHORT:
            break
        if progress is not None:
            progress(f"it breaks limits of {', '.join(sorted(more))}: goes on with these stated")
        kinds, start, earlier = kinds | more, result, None
    if left_behind is not None and not result.success and left_behind[0].cost < result.cost:
        result, kinds = left_behind
    if plan is not None:
        result = plan.pulling(result)
    try:
        run = run_of(result)
    except KeyboardInterrupt:  # too late to stop anything, and no reason to lose what there is
        run = run_of(result)
    ended = run.ended_early
    if plan is None and run.tension.min() < 0.0 and (ended or left < 1):
        # It ended before its strings were told to pull.
        plan, embedded = (
            Plan(TrackingProblem(mechanism, motion, FORCED, threads, follow), weights or FORCED, bounds),
            True,
        )
        pulling = run_of(plan.pulling(plan.by_tensions(run.trajectory, run.tension, result)))
        return replace(pulling, unfinished=result)
    creeps = not result.success and not ended and left > 0
    if plan is None and (creeps or run.tension.min() < 0.0):
        if progress is not None:
            why = "a hanging puppet finds no way" if creeps else "hanging strings end up pushing"
            progress(f"{why}: the motion is planned by tensions")
        return track(
            mechanism, motion, weights=weights, limits=limits, planned=True, follow=follow, method=method,
            max_iterations=left if creeps else max_iterations, callback=callback, progress=progress,
            checkpoint=checkpoint, checkpoint_seconds=checkpoint_seconds, threads=threads,
        )  # fmt: skip
    return run


def _coarser(plan: Plan, motion: Motion) -> Plan:
    """Return a plan with steps of twice the length, for the search; the plan itself where it has few, or long ones."""
    steps = len(motion.t) - 1
    if steps < _FEW or 2.0 * plan.dt > _LONGEST:
        return plan
    slow = motion.resample(motion.duration / (steps // 2), duration=motion.duration)
    problem = plan.problem
    return Plan(
        TrackingProblem(problem.mechanism, slow, plan.weights, problem.threads, problem.follow),
        plan.weights,
        plan.limits,
    )
