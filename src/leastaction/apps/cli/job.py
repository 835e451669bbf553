"""One optimisation as the command line runs it: from a wanted motion to a record of the run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from rich.console import Console

from leastaction.apps.cli.options import OptimiserOptions
from leastaction.errors import ResultFileError
from leastaction.io.motion.motion import Motion
from leastaction.io.results.record import RunRecord

if TYPE_CHECKING:
    from leastaction.apps.marionette.tracking import TrackingRun
    from leastaction.optimal import OptimizationResult


# The optimiser speaks of its arguments, the command line of its options.
_MESSAGES = {
    "ITERATION_LIMIT": (
        "The limit on iterations was reached: raise --max-iterations, or go on with --resume."
    ),
    "INTERRUPTED": "Interrupted; this is the last whole iterate. Go on with --resume.",
}


@dataclass(frozen=True, kw_only=True)
class Job:
    """What to optimise.

    Parameters
    ----------
    motion
        The motion to follow, at the steps of the optimisation.
    mechanism
        Name of the mechanism.
    optimiser
        How the optimiser works.
    resume
        An earlier run to go on from.
    """

    motion: Motion
    mechanism: str = "marionette"
    optimiser: OptimiserOptions
    resume: RunRecord | None = None


def walk(*, duration: float, dt: float) -> Motion:
    """Return the made-up walk."""
    from leastaction.apps.marionette.walk import walk_in_place

    return walk_in_place(duration, dt)


def capture(
    path: Path,
    *,
    mapping: Path | None,
    duration: float | None,
    dt: float,
    start: Literal["rest", "moving"],
    in_place: bool,
    console: Console,
) -> Motion:
    """Return the motion of a motion capture file and say where it comes from.

    Raises
    ------
    MotionFileError
        The file or the mapping cannot be used.
    """
    from leastaction.apps.marionette.retargeting.load import load_motion

    loaded = load_motion(
        path, mapping=mapping, duration=duration, dt=dt, start=start, in_place=in_place
    )
    console.print(loaded.summary(), markup=False)
    # The name is enough for titles, and where a file lies is nobody's business but its owner's.
    return replace(loaded.motion, source=path.name)


def earlier(path: Path, *, mechanism: str, optimiser: OptimiserOptions) -> Job:
    """Return the job that goes on from a result file.

    Raises
    ------
    ResultFileError
        The file cannot be used, or is of another mechanism, or lacks what is needed to go on.
    """
    from leastaction.io.results.files import load_record

    record = load_record(path)
    if record.mechanism != mechanism:
        raise ResultFileError(
            f"{path} is a run of {record.mechanism}, expected one of {mechanism}. "
            "Give the trajectory.npz of such a run"
        )
    if record.q_wanted is None:
        raise ResultFileError(
            f"{path} lacks the wanted motion, which is needed to go on. Run the optimisation again"
        )
    nd = record.n_dynamic
    motion = Motion(
        names=record.variables[:nd],
        t=record.t,
        q=record.q_wanted[:, :nd],
        source=str(record.settings.get("source", "")),
    )
    return Job(motion=motion, mechanism=mechanism, optimiser=optimiser, resume=record)


def run(job: Job, console: Console) -> RunRecord:
    """Optimise, printing the iterations as they happen.

    Ctrl-C ends the run with the last whole iterate.

    Raises
    ------
    LeastActionError
        The problem cannot be set up: the motion does not fit the mechanism, or there is no trajectory
        to start from.
    """
    from leastaction import models
    from leastaction.apps.marionette.tracking import track
    from leastaction.io.results.files import current_versions
    from leastaction.optimal import IterationTable

    mechanism = models.build(job.mechanism)
    steps = job.motion.t.size - 1
    source = job.motion.source or "a motion"
    dt = float(job.motion.t[1] - job.motion.t[0])
    limit = job.optimiser.max_iterations
    console.print(
        f"{job.mechanism} follows {source}: {steps} steps of {dt:g} s, at most {limit} iterations",
        markup=False,
    )
    tracked = track(
        mechanism,
        job.motion,
        method=job.optimiser.method,
        max_iterations=limit,
        tolerance=job.optimiser.tolerance,
        callback=IterationTable(),
        progress=lambda line: console.print(line, markup=False, style="dim"),
        resume=None if job.resume is None else result_of(job.resume),
    )
    return record_of(tracked, job, versions=current_versions())


def record_of(tracked: TrackingRun, job: Job, *, versions: dict[str, str]) -> RunRecord:
    """Return a finished run as plain arrays."""
    mechanism, result = tracked.mechanism, tracked.result
    history = result.history
    return RunRecord(
        mechanism=job.mechanism,
        variables=mechanism.variables,
        n_dynamic=mechanism.nd,
        inputs=(*mechanism.inputs, *mechanism.kinematic),
        constraints=mechanism.constraints,
        t=tracked.t,
        q=tracked.q,
        p=tracked.p,
        v=result.x[:, mechanism.nq + mechanism.nd : mechanism.nx],
        u=result.u,
        lam=tracked.lam,
        x=result.x,
        K=result.K,
        K_projection=result.projection_gain,
        q_wanted=tracked.wanted,
        tension=tracked.tension,
        histories={name: np.asarray(value) for name, value in vars(history).items()}
        | {"final_expected_decrease": np.array(result.expected_decrease)},
        settings={
            "source": job.motion.source,
            "dt": float(tracked.t[1] - tracked.t[0]),
            **asdict(result.settings),
            "schedule": asdict(result.schedule),
            "embedded": tracked.embedded,
        },
        versions=versions,
        status=result.status.name,
        message=_MESSAGES.get(result.status.name, result.message),
    )


def result_of(record: RunRecord) -> OptimizationResult:
    """Return the optimiser's result that a record was made of, to go on from.

    Raises
    ------
    ResultFileError
        The record lacks what is needed, or names a status that this version does not know.
    """
    from leastaction.optimal import OptimizationHistory, OptimizationResult, Settings, Status
    from leastaction.optimal.result import NewtonSchedule

    if record.K_projection is None:
        raise ResultFileError(
            "the earlier run lacks the gains of its projection, which are needed to go on. "
            "Run the optimisation again"
        )
    try:
        histories, settings = record.histories, record.settings
        arrays: dict[str, Any] = {
            name: histories[name] for name in OptimizationHistory.__dataclass_fields__
        }
        arrays["method"] = tuple(str(name) for name in histories["method"])
        return OptimizationResult(
            status=Status[record.status],
            message=record.message,
            x=record.x,
            u=record.u,
            K=record.K,
            cost=float(histories["cost"][-1]),
            expected_decrease=float(histories["final_expected_decrease"]),
            history=OptimizationHistory(**arrays),
            timings={},
            rollouts=0,
            settings=Settings(**{name: settings[name] for name in Settings.__dataclass_fields__}),
            projection_gain=record.K_projection,
            schedule=NewtonSchedule(**settings["schedule"]),
        )
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise ResultFileError(
            f"the earlier run cannot be gone on with: it lacks {error}. "
            "It was written by another version; run the optimisation again"
        ) from error


def exit_code(status: str) -> int:
    """Return what the program tells the shell about how a run ended.

    0 when there is a result to use, 130 when Ctrl-C ended the run, 1 when the optimiser was stuck.
    """
    if status == "INTERRUPTED":
        return 130
    return 0 if status in ("CONVERGED", "STALLED", "ITERATION_LIMIT") else 1
