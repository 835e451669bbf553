"""One optimisation as the command line runs it: its iterations are shown, and what it finds is kept."""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from leastaction.apps.cli import OptimiserOptions, OutputOptions, uninterrupted
from leastaction.errors import OutputError
from leastaction.io import Motion
from leastaction.models.marionette import Hanging, marionette
from leastaction.numerics import remove_earlier
from leastaction.optimal import IterationRecord, IterationTable, Status
from leastaction_marionette.choices import Axes, Follow
from leastaction_marionette.command.report import BESIDE, TRAJECTORY, at_rest, write_report
from leastaction_marionette.command.summary import run_summary
from leastaction_marionette.command.tables import checked, speed_table, summary_tables
from leastaction_marionette.speeds import AtSpeed, fastest
from leastaction_marionette.tracking import PuppetLimits, TrackingRun, TrackingSearch, save_run, save_search, track

SEARCH = "search.npz"  # a run that still seeks its first trajectory

# What a shell expects of a program ended by Ctrl-C.
INTERRUPTED = 130
STUCK = 1

Complain = Callable[[str], object]


@dataclass(frozen=True)
class AtSpeeds:
    """A motion at any speed, and the error (degrees, or mm of markers) within which its fastest is wanted."""

    motion_at: Callable[[float], Motion]
    error: float


@dataclass(frozen=True)
class Request:
    """A motion to follow, or an earlier run to go on with, by what, and whether what is found is checked on a rig."""

    motion: Motion | TrackingRun | TrackingSearch | AtSpeeds
    limits: PuppetLimits | None = None
    strings: Hanging = 6
    follow: Follow = "joints"
    check: bool = False
    axes: Axes = "zyx"


def run(request: Request, optimiser: OptimiserOptions, output: OutputOptions, folder: Path, complain: Complain) -> int:
    """Follow a motion, or go on with an earlier run, and fill the folder.

    Returns what the program tells the shell: 0 when there is a result to use and it is written, 130 after Ctrl-C, 1
    when the optimiser was stuck or something could not be written. Raises `KeyboardInterrupt`: Ctrl-C before there was
    anything to keep. Raises `LeastActionError`: the problem cannot be set up, or its result cannot be written anywhere.
    """
    console = Console(highlight=False)
    began = time.perf_counter()
    kept: list[Path] = []
    try:
        tried: list[AtSpeed] = []
        error = np.inf
        optimise = partial(_optimise, request=request, optimiser=optimiser, folder=folder, console=console, kept=kept)
        if isinstance(request.motion, AtSpeeds):
            tried, error = fastest(optimise, request.motion.motion_at, request.motion.error), request.motion.error
            found = tried[-1].run
        else:
            found = optimise(request.motion)
        optimised = time.perf_counter()
        with uninterrupted():
            kept.append(_keep(found, folder, complain))
        console.print()
        rest = at_rest(found)
        summary = run_summary(found, rest)
        console.print(summary_tables(summary))
        console.print()
        if tried:
            console.print(speed_table(tried, error))
            console.print()
        if request.check:
            console.print(checked(found))
            console.print()
        if kept[-1].parent != folder:
            return STUCK
        with console.status("") as status:
            report = write_report(
                found,
                folder,
                plots=output.plots,
                animation=output.animation,
                progress=lambda name: status.update(f"writing {name}"),
                tried=tried,
                error=error,
                rest=rest,
                summary=summary,
            )
    except KeyboardInterrupt:
        if not kept:
            raise
        again = f"leastaction optimize marionette --resume {kept[-1]} --out {folder}"
        if kept[-1].name == SEARCH:
            complain(f"interrupted; the search for a first trajectory is in {kept[-1]}. Go on with: {again}")
        else:
            complain(
                f"interrupted; the run as far as it went is in {kept[-1]}. Go on with: {again}, or draw it with: "
                f"leastaction draw {kept[-1]} --out {folder}"
            )
        return INTERRUPTED
    except OutputError as error:
        if not kept:
            raise
        complain(f"{error}. The run itself is in {kept[-1]}")
        return STUCK
    finished = time.perf_counter()
    console.print(report)
    console.print(
        f"\n{optimised - began:.2f} s to optimise, {finished - optimised:.2f} s to write, "
        f"{finished - began:.2f} s in all"
    )
    if found.result.status in (Status.ITERATION_LIMIT, Status.INTERRUPTED):
        again = f"leastaction optimize marionette --resume {folder / TRAJECTORY} --out {folder}"
        console.print(f"Go on with: {again}", markup=False, soft_wrap=True)
    if found.result.status is Status.INTERRUPTED:
        return INTERRUPTED
    # A motion whose strings pull is an answer, however the search for a better one ended; the summary says how.
    pulls = found.tension.min() >= 0.0
    usable = found.result.success or found.result.status is Status.ITERATION_LIMIT or pulls
    return 0 if usable else STUCK


def _optimise(
    motion: Motion | TrackingRun | TrackingSearch,
    *,
    request: Request,
    optimiser: OptimiserOptions,
    folder: Path,
    console: Console,
    kept: list[Path],
) -> TrackingRun:
    """Optimise, printing the iterations as they happen and keeping the run now and then."""
    earlier = None if isinstance(motion, Motion) else motion
    if not isinstance(motion, Motion):
        motion = motion.motion
    console.print(
        f"marionette follows {motion.source or 'a motion'}: {motion.t.size - 1} steps of "
        f"{motion.t[1] - motion.t[0]:g} s, at most {optimiser.max_iterations} iterations",
        markup=False,
    )
    table = IterationTable()

    def checkpoint(found: TrackingRun | TrackingSearch) -> None:
        try:
            with uninterrupted():
                if isinstance(found, TrackingSearch):
                    kept.append(save_search(folder / SEARCH, found))
                else:
                    kept.append(_save(found, folder))
        except OutputError as error:  # the run goes on, and is written elsewhere if it must
            console.print(str(error), markup=False, style="dim")

    with console.status("looking for a first trajectory") as spinner:

        def show(record: IterationRecord) -> object:
            spinner.stop()
            return table(record)

        return track(
            marionette(strings=request.strings, axes=request.axes) if earlier is None else earlier.mechanism,
            motion,
            limits=request.limits,
            follow=request.follow,
            method=optimiser.method,
            max_iterations=optimiser.max_iterations,
            tolerance=optimiser.tolerance,
            callback=show,
            progress=lambda line: console.print(line, markup=False, style="dim"),
            resume=earlier,
            checkpoint=checkpoint,
            checkpoint_seconds=optimiser.checkpoint,
        )


def _keep(found: TrackingRun, folder: Path, complain: Complain) -> Path:
    """Write a run into its folder, or else to where it can be written."""
    try:
        return _save(found, folder)
    except OutputError as error:
        for place in (Path.cwd(), Path(tempfile.gettempdir()), Path.home()):
            with contextlib.suppress(OutputError):
                path = save_run(place / f"leastaction-{os.getpid()}-{TRAJECTORY}", found)
                complain(f"{error}. The run is in {path}")
                return path
        raise


def _save(found: TrackingRun, folder: Path) -> Path:
    """Write a run into its folder, in place of the search that led to it."""
    path = save_run(folder / TRAJECTORY, found)
    # Pictures of an earlier run lie beside a trajectory that is not theirs now; without it they stay.
    remove_earlier(folder, BESIDE)
    with contextlib.suppress(OSError):
        (folder / SEARCH).unlink(missing_ok=True)
    return path
