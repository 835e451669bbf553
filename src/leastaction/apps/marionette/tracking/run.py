"""The main job: a marionette learns to follow a reference motion.

The reference gives the body's variables only. `track` guesses the strings that go with it, finds a first
trajectory that the puppet can make, and improves it with `leastaction.optimal.optimize`.

The first trajectory is what the puppet does when its strings simply hang above the hooks of the reference.
Where that goes wrong, because the motion is fast or the strings lose their grip on a stretched limb, it is
found by *dynamic embedding* (dissertation 6.6.1): every joint gets a motor, with which any motion can be
followed; the motors are made ever more expensive until they do nothing, and are then taken away.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from leastaction.apps.marionette.tracking.problem import ROOT, SLANT, TrackingProblem
from leastaction.apps.marionette.tracking.weights import FORCED, GENTLE, TrackingWeights
from leastaction.io.motion.motion import Motion
from leastaction.io.results.record import Provenance
from leastaction.mechanics import Mechanism, Trajectory
from leastaction.numerics.arrays import Array
from leastaction.optimal import IterationRecord, OptimizationResult, optimize
from leastaction.optimal.optimize import Callback, Method
from leastaction.viz.tracking import TrackingErrors, tracking_errors

_CHECKPOINTS_SHARE = 0.05  # of the time may go into checkpoints


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
        Whether the first trajectory was found by dynamic embedding.
    trajectory : Trajectory
        The motion, by names: times, configurations, momenta, multipliers.
    result : OptimizationResult
        Of the optimiser, with the gains that hold the motion; its states are ``[q; rho; p; v_rho; lam]``.
    provenance : Provenance
    """

    mechanism: Mechanism = field(repr=False)
    source: str
    reference: Array = field(repr=False)
    embedded: bool
    trajectory: Trajectory = field(repr=False)
    result: OptimizationResult = field(repr=False)
    provenance: Provenance = field(default_factory=Provenance.now)

    @property
    def motion(self) -> Motion:
        """The reference motion of the body."""
        names = self.mechanism.dynamic
        return Motion(names, self.trajectory.t, self.reference[:, : len(names)], self.source)

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
        names = self.mechanism.dynamic
        nd = len(names)
        return tracking_errors(self.reference[:, :nd], self.trajectory.q[:, :nd], names, lengths=ROOT)


@dataclass(frozen=True, kw_only=True)
class TrackingSearch:
    """A search for a first trajectory by dynamic embedding, as far as it went; `track` goes on with it.

    Attributes
    ----------
    mechanism : Mechanism
    motion : Motion
        To be followed.
    stage : int
        Which of the search's optimisations it was at.
    result : OptimizationResult
        Of that optimisation, so far.
    provenance : Provenance
    """

    mechanism: Mechanism = field(repr=False)
    motion: Motion
    stage: int
    result: OptimizationResult = field(repr=False)
    provenance: Provenance = field(default_factory=Provenance.now)


def track(
    mechanism: Mechanism,
    motion: Motion,
    *,
    weights: TrackingWeights | None = None,
    method: Method = "auto",
    max_iterations: int = 100,
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
    method, max_iterations, callback
        As in `leastaction.optimal.optimize`, for the last optimisation.
    tolerance : float, optional
        Likewise. If not given, 1e-6, or 1e-4 where the first trajectory had to be found by embedding:
        such a motion is far from what the puppet does by itself, and its last digits cost much.
    progress : callable, optional
        Called with a line of text as the search for a first trajectory goes on.
    resume : TrackingRun or TrackingSearch, optional
        Go on with an earlier run, or search, of the same motion. The iterates are those of a run that never stopped.
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
    due = time.perf_counter() + checkpoint_seconds

    def kept(now: Callable[[], TrackingRun | TrackingSearch], *, at_once: bool = False) -> None:
        nonlocal due
        began = time.perf_counter()
        if checkpoint is None or (began < due and not at_once):
            return
        checkpoint(now())
        after = time.perf_counter()
        pause = max(checkpoint_seconds, (after - began) / _CHECKPOINTS_SHARE)
        due = after + (pause if checkpoint_seconds > 0.0 else 0.0)

    def keep_search(stage: int, found: OptimizationResult | IterationRecord) -> None:
        ended = isinstance(found, OptimizationResult)

        def now() -> TrackingSearch:
            result = found if isinstance(found, OptimizationResult) else found.snapshot()
            return TrackingSearch(mechanism=mechanism, motion=motion, stage=stage, result=result)

        kept(now, at_once=ended)

    earlier = resume.result if isinstance(resume, TrackingRun) else None
    problem = TrackingProblem(mechanism, motion, weights or GENTLE, threads)
    initial = problem.hang() if resume is None else None
    embedded = resume.embedded if isinstance(resume, TrackingRun) else initial is None
    if embedded:
        problem = TrackingProblem(mechanism, motion, weights or FORCED, threads, ahead=SLANT)
        if earlier is None:
            stage, result = (resume.stage, resume.result) if isinstance(resume, TrackingSearch) else (0, None)
            initial = problem.embed(progress or (lambda _: None), stage=stage, result=result, keep=keep_search)

    def run_of(result: OptimizationResult) -> TrackingRun:
        return TrackingRun(
            mechanism=mechanism,
            source=motion.source,
            reference=problem.reference,
            embedded=embedded,
            trajectory=problem.system.trajectory(result.x, result.u),
            result=result,
        )

    def watch(record: IterationRecord) -> object:
        kept(lambda: run_of(record.snapshot()))
        return callback(record) if callback is not None else None

    if tolerance is None:
        tolerance = 1e-4 if embedded else 1e-6
    result = optimize(
        problem.system,
        problem.cost(problem.weights.tension),
        initial=initial,
        resume=earlier,
        method=method,
        max_iterations=max_iterations,
        tolerance=tolerance,
        callback=watch,
    )
    try:
        return run_of(result)
    except KeyboardInterrupt:  # too late to stop anything, and no reason to lose what there is
        return run_of(result)
