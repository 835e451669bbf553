"""The commands: demo, optimize, info, draw, examples."""

from __future__ import annotations

import errno
import filecmp
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Group, Parameter
from cyclopts.exceptions import CycloptsError
from rich.console import Console

from leastaction._version import __version__
from leastaction.apps.choices import Axis, Follow, Heading, Strings
from leastaction.apps.cli.options import (
    MOTION,
    OUTPUT,
    PUPPET,
    OptimiserOptions,
    OutputOptions,
    speed_of,
)
from leastaction.apps.cli.shield import ending_interrupts, shielded_output
from leastaction.errors import ArgumentError, LeastActionError

if TYPE_CHECKING:
    from leastaction.apps.cli.session import AtSpeeds
    from leastaction.apps.marionette.tracking import PuppetLimits, TrackingRun, TrackingSearch
    from leastaction.io.motion.motion import Motion
    from leastaction.models.marionette import Hanging

_NOT_PRINTED = 1
_BAD_INPUT = 2
_INTERRUPTED = 130  # what a shell expects of a program ended by Ctrl-C

_HELP = """Mechanisms that learn to move.

Takes a mechanism and a motion to follow, and finds a motion the mechanism can really make, the inputs
that make it, and the feedback that keeps it there.

Start with: leastaction demo --out demo
"""

app = App(
    name="leastaction",
    help=_HELP,
    version=__version__,
    version_flags=["--version"],
    help_flags=["--help", "-h"],
    help_epilogue="Each command explains itself: leastaction optimize --help",
    group_commands=Group("Commands", sort_key=0),
    group_arguments=Group("Arguments", sort_key=0),
    exit_on_error=False,
    print_error=False,
    suppress_keyboard_interrupt=False,
)


@app.command
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
    from leastaction.apps.marionette.walk import walk_in_place

    walk = walk_in_place(duration, dt)
    with _folder(output) as folder:
        return _run(walk, optimiser, output, folder)


@app.command
def optimize(
    mechanism: Literal["marionette"],  # noqa: ARG001
    /,
    *,
    motion: Annotated[Path | None, Parameter(group=MOTION)] = None,
    mapping: Annotated[Path | None, Parameter(group=MOTION)] = None,
    skeleton: Annotated[Path | None, Parameter(group=MOTION)] = None,
    frame_rate: Annotated[float | None, Parameter(group=MOTION)] = None,
    duration: Annotated[float | None, Parameter(group=MOTION)] = None,
    dt: Annotated[float, Parameter(group=MOTION)] = 0.01,
    follow: Annotated[Follow, Parameter(group=MOTION)] = "joints",
    start: Annotated[Literal["rest", "moving"], Parameter(group=MOTION)] = "rest",
    in_place: Annotated[bool, Parameter(group=MOTION, negative=())] = False,
    trim: Annotated[tuple[float, float] | None, Parameter(group=MOTION)] = None,
    speed: Annotated[float | Literal["auto"], Parameter(group=MOTION, converter=speed_of)] = 1.0,
    error: Annotated[float, Parameter(group=MOTION)] = 5.0,
    up: Annotated[Axis | None, Parameter(group=MOTION)] = None,
    forward: Annotated[Axis | None, Parameter(group=MOTION)] = None,
    heading: Annotated[Heading, Parameter(group=MOTION)] = "facing",
    strings: Annotated[Strings, Parameter(group=PUPPET)] = 6,
    tension: Annotated[float, Parameter(group=PUPPET)] = 0.5,
    reach: Annotated[float, Parameter(group=PUPPET)] = 2.0,
    end_speed: Annotated[float, Parameter(group=PUPPET)] = 8.0,
    end_acceleration: Annotated[float, Parameter(group=PUPPET)] = 150.0,
    lift: Annotated[float, Parameter(group=PUPPET)] = 0.5,
    tilt: Annotated[float, Parameter(group=PUPPET)] = 57.0,
    turn: Annotated[float, Parameter(group=PUPPET)] = 86.0,
    turn_speed: Annotated[float, Parameter(group=PUPPET)] = 12.0,
    turn_acceleration: Annotated[float, Parameter(group=PUPPET)] = 300.0,
    check: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False,
    resume: Annotated[Path | None, Parameter(group=MOTION)] = None,
    optimiser: OptimiserOptions | None = None,
    output: OutputOptions,
) -> int:
    """Make a mechanism follow a motion, and write the result into a folder.

    The folder gets the trajectory with its inputs and feedback gains (trajectory.npz), the numbers
    (summary.txt, summary.json), plots (convergence, tracking, strings, snapshots) and an animation for
    the browser. Ctrl-C stops after the last whole iteration and still writes everything.

    Parameters
    ----------
    mechanism
        The mechanism: marionette, a puppet of 22 joint variables on six strings, on more, or on a control.
    motion
        Motion capture to follow: a BVH file, or an AMC file. A walk on the spot is made up without it.
    mapping
        TOML file that says which joint of the capture is which joint of the puppet, where the usual names do not fit.
    skeleton
        The ASF file of an AMC file; the one beside it with whose name the motion's begins, if not given.
    frame_rate
        Frames per second of an AMC file that does not say it; 120 if not given.
    duration
        Length, s. A shorter capture is repeated by its best cycle. The whole capture (10 s of the
        made-up walk) if not given.
    dt
        Time step, s.
    follow
        What of the motion: the angles of all joints, or the places of head, hands, feet and pelvis, from which the
        optimiser finds the angles.
    start
        Begin at rest in the first pose and pick up speed, or begin as captured.
    in_place
        Leave out the travel over the ground.
    trim
        Part of the capture to use: from and to, s.
    speed
        Speed of the motion relative to the capture: 0.5 is half as fast. auto: as fast as the error allows; other
        speeds are tried, the fastest first, and their errors are shown.
    error
        With --speed auto: largest root mean square error of the joints that strings hold, degrees; of the markers, mm,
        where these are followed.
    up
        The capture's axis that points up, such as y or -z; found from the poses if not given.
    forward
        The capture's axis that points ahead; found from the poses if not given.
    heading
        What is turned ahead: the way that the person faces, travels, or the capture's forward axis; straight
        takes out the slow turns of one who walks in a circle.
    strings
        How many strings: 6; 7, with one behind the pelvis; 8, with one at each foot; 9, two at each limb and one at the
        neck; 11, the six with feet, pelvis and elbows. Or what the seven are tied to, with fixed lengths: cross, a
        rigid bar for all; cross+legs, with a bar of their own for the knees; cross+hands, cross+legs+hands, where
        the strings of the puppet's hands are picked up by hands.
    tension
        Least tension of every string at every instant, N.
    reach
        How far the strings' upper ends, and bars, may be from above the wanted pelvis along each axis, m.
    end_speed
        Largest speed of the upper ends, and bars, along each axis, m/s.
    end_acceleration
        Largest acceleration of the upper ends, and bars, along each axis, m/s^2.
    lift
        How far a bar may be lifted above the plane of the hands, and lowered, m.
    tilt
        How far a bar may be tilted from level about each axis, degrees.
    turn
        How far a bar may be turned about the vertical from where the pelvis is wanted to face, degrees.
    turn_speed
        Largest speed of a bar's turns about each axis, rad/s.
    turn_acceleration
        Largest acceleration of a bar's turns about each axis, rad/s^2.
    check
        Play what is found, under feedback, on a simulated rig with elastic strings that go slack, masses that are
        off, and sensors that are noisy and late; say how far its joints are off.
    resume
        trajectory.npz of an earlier run, or search.npz of one that still sought a first trajectory: go on from there,
        with the motion that it followed.
    """
    if resume is not None and (motion is not None or mapping is not None or duration is not None):
        # The motion is in the file; a second one could contradict it.
        raise ArgumentError(
            "--resume goes on with the motion of the earlier run: leave out --motion, --mapping and --duration"
        )
    if resume is not None and follow != "joints":
        raise ArgumentError("--resume follows what the earlier run did: leave out --follow")
    of_file = {
        "--mapping": mapping, "--skeleton": skeleton, "--frame-rate": frame_rate, "--trim": trim,
        "--up": up, "--forward": forward,
        "--speed": None if speed == 1.0 else speed, "--heading": None if heading == "facing" else heading,
    }  # fmt: skip
    for option, value in of_file.items():
        if value is not None and motion is None:
            raise ArgumentError(f"{option} belongs to a motion capture file: give --motion FILE too")
    from leastaction.apps.marionette.tracking.limits import PuppetLimits

    limits = PuppetLimits(
        tension=tension,
        reach=reach,
        speed=end_speed,
        acceleration=end_acceleration,
        lift=lift,
        tilt=math.radians(tilt),
        turn=math.radians(turn),
        turn_speed=turn_speed,
        turn_acceleration=turn_acceleration,
    )
    if resume is not None:
        from leastaction.apps.marionette.tracking import load_unfinished

        with _folder(output) as folder:
            return _run(load_unfinished(resume), optimiser, output, folder, limits=limits, check=check)
    if motion is None:
        from leastaction.apps.marionette.walk import walk_in_place

        walk = walk_in_place(10.0 if duration is None else duration, dt)
        with _folder(output) as folder:
            return _run(walk, optimiser, output, folder, limits=limits, strings=strings, follow=follow, check=check)
    from leastaction.apps.marionette.retargeting import load_motion

    console = Console(highlight=False)

    def motion_at(speed: float) -> Motion:
        with console.status(f"reading {motion.name}"):
            loaded = load_motion(
                motion, mapping=mapping, duration=duration, dt=dt, start=start, in_place=in_place, trim=trim,
                speed=speed, up=up, forward=forward, heading=heading, markers=follow == "markers",
                skeleton=skeleton, frame_rate=frame_rate,
            )  # fmt: skip
        console.print(loaded.summary(), markup=False)
        for warning in loaded.warnings:
            console.print("[bold yellow]warning:[/bold yellow] ", end="")
            console.print(warning, markup=False, soft_wrap=True)
        # The name is enough for titles, and where a file lies is nobody's business but its owner's.
        return replace(loaded.motion, source=motion.name)

    with _folder(output) as folder:
        wanted: Motion | AtSpeeds
        if speed == "auto":
            from leastaction.apps.cli.session import AtSpeeds

            wanted = AtSpeeds(motion_at, error)
        else:
            wanted = motion_at(speed)
        return _run(wanted, optimiser, output, folder, limits=limits, strings=strings, follow=follow, check=check)


@app.command
def info(file: Path, /) -> int:
    """Show what is in a result file: how the run ended, tracking errors, string tensions.

    Parameters
    ----------
    file
        trajectory.npz of an earlier run.
    """
    from leastaction.apps.cli.report import describe

    Console(highlight=False).print(describe(file))
    return 0


@app.command
def draw(file: Path, /, *, output: OutputOptions) -> int:
    """Draw the plots and the animation of a result file again.

    Parameters
    ----------
    file
        trajectory.npz of an earlier run.
    """
    from leastaction.apps.cli.report import TRAJECTORY, at_rest, write_report
    from leastaction.apps.cli.summary import run_summary
    from leastaction.apps.marionette.tracking import load_run

    run, console = load_run(file), Console(highlight=False)
    with _folder(output) as folder:
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


@app.command
def examples(example: str | None = None, /, *, out: Path = Path("pictures")) -> int:
    """List the example scripts, or run one: it prints what it finds and draws a picture.

    Parameters
    ----------
    example
        Number or name of an example; all are listed without it.
    out
        Folder for the picture; made if need be.
    """
    from leastaction.apps.cli.examples import find_example, find_examples, run_example

    console = Console(highlight=False, soft_wrap=True)
    if example is None:
        for one in find_examples():
            console.print(f"{one.number:3}  [bold]{one.name}[/bold]: ", end="")
            console.print(one.about, markup=False)
        console.print(f"The scripts are in {find_examples()[0].file.parent}", markup=False, style="dim")
        return 0
    from leastaction.numerics.files import prepare_output_folder

    chosen = find_example(example)
    folder = prepare_output_folder(out)
    run_example(chosen, folder)
    console.print(f"picture: {folder / chosen.file.stem}.png", markup=False)
    return 0


@contextmanager
def _folder(output: OutputOptions) -> Iterator[Path]:
    """Check before a run that its results can be drawn and written; yields their folder, see `output_folder`."""
    from leastaction.apps.cli.report import check_pictures
    from leastaction.numerics.files import output_folder

    if output.plots:
        check_pictures()
    with output_folder(output.out) as folder:
        yield folder


def _run(
    motion: Motion | TrackingRun | TrackingSearch | AtSpeeds,
    optimiser: OptimiserOptions | None,
    output: OutputOptions,
    folder: Path,
    *,
    limits: PuppetLimits | None = None,
    strings: Hanging = 6,
    follow: Follow = "joints",
    check: bool = False,
) -> int:
    from leastaction.apps.cli import session

    return session.run(
        motion,
        optimiser=optimiser or OptimiserOptions(),
        output=output,
        folder=folder,
        complain=_complain,
        limits=limits,
        strings=strings,
        follow=follow,
        check=check,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Exit codes: 0 done; 1 the optimiser could not go on, or something could not be written or printed (a line
    on the error stream says what, and where the run is); 2 something given was wrong, said in one line on the
    error stream; 130 interrupted, or asked to end.

    Parameters
    ----------
    arguments
        Words after the program's name; those of this process if not given.
    """
    with shielded_output() as output:
        try:
            with ending_interrupts():
                answer = app(arguments, result_action="return_value")
            code = answer if isinstance(answer, int) else 0
        except CycloptsError as error:
            _complain(str(error), hint="Try leastaction --help")
            code = _BAD_INPUT
        except LeastActionError as error:
            _complain(str(error))
            code = _BAD_INPUT
        except MemoryError:
            _complain("this takes more memory than there is: take a longer --dt or a shorter --duration")
            code = _BAD_INPUT
        except KeyboardInterrupt:
            _complain("interrupted before there was a result to keep")
            code = _INTERRUPTED
        output.flush()
        # Nobody asked for what a closed pipe (| head) did not take.
        if output.error is not None and output.error.errno != errno.EPIPE:
            _complain(f"the output could not be printed ({output.error.strerror})")
            code = code or _NOT_PRINTED
    sys.exit(code)


def _complain(message: str, *, hint: str = "") -> None:
    """Print an error on the error stream, in its own words."""
    console = Console(stderr=True, highlight=False)
    console.print("[bold red]error:[/bold red] ", end="")
    console.print(message, markup=False, soft_wrap=True)
    if hint:
        console.print(hint, style="dim")
