"""The marionette's commands: ``demo``, ``optimize marionette``, ``draw``; and what is in the files of its runs."""

from __future__ import annotations

import filecmp
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter
from rich.console import Console, RenderableType

from leastaction.apps.cli import OUTPUT, OptimiserOptions, OutputOptions, checked_folder, complain, printing_numbers
from leastaction.errors import ArgumentError
from leastaction_marionette.choices import Axes
from leastaction_marionette.command.options import MOTION, MotionOptions, PuppetOptions

if TYPE_CHECKING:
    from leastaction.io import Motion
    from leastaction_marionette.command.session import AtSpeeds, Request


RECORDS = frozenset({"TrackingRun", "TrackingSearch"})
"""What is in the files that it writes."""


def add_commands(app: App) -> None:
    """Add the marionette's commands to the program."""
    app.command(demo, sort_key=0)
    app["optimize"].command(optimize, name="marionette")
    app.command(draw, sort_key=8)


def text_of(file: Path) -> RenderableType:
    """Return the numbers of a run in a file, to print; raises `ResultFileError` if it cannot be used."""
    from leastaction_marionette.command.report import describe

    return describe(file)


def facts_of(file: Path) -> dict[str, Any]:
    """Return the numbers of a run in a file as plain data; raises `ResultFileError` if it cannot be used."""
    from leastaction_marionette.command.summary import run_summary
    from leastaction_marionette.tracking import load_run

    return run_summary(load_run(file))


def demo(
    *,
    duration: Annotated[float, Parameter(group=MOTION)] = 10.0,
    dt: Annotated[float, Parameter(group=MOTION)] = 0.01,
    optimiser: OptimiserOptions | None = None,
    output: OutputOptions,
) -> int:
    """Teach the marionette to walk on the spot, from a made-up walk: needs no file.

    Parameters
    ----------
    duration
        Length of the walk, s.
    dt
        Time step, s.
    """
    from leastaction_marionette.command.session import Request

    request = Request(_motion(MotionOptions(duration=duration, dt=dt)))
    with checked_folder(output) as folder:
        return _run(request, optimiser, output, folder)


def optimize(
    *,
    wanted: MotionOptions | None = None,
    puppet: PuppetOptions | None = None,
    check: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False,
    resume: Annotated[Path | None, Parameter(group=MOTION)] = None,
    optimiser: OptimiserOptions | None = None,
    output: OutputOptions,
    json: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False,
) -> int:
    """Make the marionette follow a motion, made up or captured (--motion FILE), and write the result into a folder.

    It is a puppet of 22 joint variables on six strings, on more, or on a control. The folder gets the motion with its
    inputs and feedback gains (trajectory.npz), the numbers (summary.txt, summary.json), plots (convergence, tracking,
    strings, snapshots) and an animation for the browser. Ctrl-C stops after the last whole iteration and still writes
    everything.

    Parameters
    ----------
    check
        Play what is found, under feedback, on a simulated rig with elastic strings that go slack, masses that are
        off, and sensors that are noisy and late; say how far its joints are off.
    resume
        trajectory.npz of an earlier run, or search.npz of one that still sought a first trajectory: go on from there,
        with the motion that it followed.
    json
        Print the numbers of summary.json, and how it goes on the error stream.
    """
    with printing_numbers(output.out) if json else nullcontext():
        return _optimized(wanted or MotionOptions(), puppet or PuppetOptions(), check, resume, optimiser, output)


def _optimized(
    wanted: MotionOptions,
    puppet: PuppetOptions,
    check: bool,
    resume: Path | None,
    optimiser: OptimiserOptions | None,
    output: OutputOptions,
) -> int:
    if resume is not None:
        wanted.check_resumed()
    wanted.check()
    limits = puppet.limits()
    from leastaction_marionette.command.session import Request

    with checked_folder(output) as folder:
        if resume is not None:
            from leastaction_marionette.tracking import load_unfinished

            request = Request(load_unfinished(resume), limits, check=check)
        else:
            request = Request(_motion(wanted, puppet.axes), limits, puppet.strings, wanted.follow, check, puppet.axes)
        return _run(request, optimiser, output, folder)


def _run(request: Request, optimiser: OptimiserOptions | None, output: OutputOptions, folder: Path) -> int:
    from leastaction_marionette.command import session

    return session.run(request, optimiser or OptimiserOptions(), output, folder, complain)


def draw(file: Path, /, *, output: OutputOptions) -> int:
    """Draw the plots and the animation of a result file again.

    Parameters
    ----------
    file
        trajectory.npz of an earlier run.
    """
    from leastaction_marionette.command.report import TRAJECTORY, at_rest, write_report
    from leastaction_marionette.command.summary import run_summary
    from leastaction_marionette.tracking import load_run

    run, console = load_run(file), Console(highlight=False)
    with checked_folder(output) as folder:
        beside = folder / TRAJECTORY
        if beside.exists() and not filecmp.cmp(file, beside, shallow=False):
            raise ArgumentError(
                f"{beside} is another run than {file}, and pictures of this one do not belong beside it: "
                "give another folder as --out"
            )
        with console.status("looking for poses at rest") as status:
            rest = at_rest(run)
            report = write_report(
                run,
                folder,
                plots=output.plots,
                animation=output.animation,
                progress=lambda name: status.update(f"writing {name}"),
                rest=rest,
                summary=run_summary(run, rest),
            )
    console.print(report)
    return 0


def _motion(wanted: MotionOptions, axes: Axes = "zyx") -> Motion | AtSpeeds:
    """Return the motion that is asked for: read from a file, at any speed if need be, or made up."""
    if wanted.motion is None:
        from leastaction_marionette.walk import walk_in_place

        return walk_in_place(10.0 if wanted.duration is None else wanted.duration, wanted.dt)
    from leastaction_marionette.command.session import AtSpeeds
    from leastaction_marionette.retargeting import load_motion

    console, file = Console(highlight=False), wanted.motion

    def motion_at(speed: float) -> Motion:
        with console.status(f"reading {file.name}"):
            loaded = load_motion(
                file, mapping=wanted.mapping, duration=wanted.duration, dt=wanted.dt, start=wanted.start,
                in_place=wanted.in_place, trim=wanted.trim, speed=speed, up=wanted.up, forward=wanted.forward,
                heading=wanted.heading, markers=wanted.follow == "markers", skeleton=wanted.skeleton,
                frame_rate=wanted.frame_rate, axes=axes,
            )  # fmt: skip
        console.print(loaded.summary(), markup=False)
        for warning in loaded.warnings:
            console.print("[bold yellow]warning:[/bold yellow] ", end="")
            console.print(warning, markup=False, soft_wrap=True)
        # The name is enough for titles, and where a file lies is nobody's business but its owner's.
        return replace(loaded.motion, source=file.name)

    return AtSpeeds(motion_at, wanted.error) if wanted.speed == "auto" else motion_at(wanted.speed)
