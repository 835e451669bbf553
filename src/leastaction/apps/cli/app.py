"""The commands, in the order in which help shows them; those of any mechanism are in `mechanism`."""

from __future__ import annotations

import errno
import filecmp
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Group, Parameter
from cyclopts.exceptions import CycloptsError
from rich.console import Console

from leastaction._version import __version__
from leastaction.apps.cli.mechanism import commands
from leastaction.apps.cli.options import (
    MOTION,
    OUTPUT,
    MotionOptions,
    OptimiserOptions,
    OutputOptions,
    PuppetOptions,
)
from leastaction.apps.cli.shield import ending_interrupts, shielded_output
from leastaction.errors import ArgumentError, LeastActionError

if TYPE_CHECKING:
    from leastaction.apps.cli.session import AtSpeeds, Request
    from leastaction.io.motion.motion import Motion

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
app.register_install_completion_command()


@app.command(sort_key=0)
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
    from leastaction.apps.cli.session import Request

    request = Request(_motion(MotionOptions(duration=duration, dt=dt)))
    with _folder(output) as folder:
        return _run(request, optimiser, output, folder)


@app.command(sort_key=1)
def optimize(
    problem: str,
    /,
    *,
    wanted: MotionOptions | None = None,
    puppet: PuppetOptions | None = None,
    check: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False,
    resume: Annotated[Path | None, Parameter(group=MOTION)] = None,
    optimiser: OptimiserOptions | None = None,
    output: OutputOptions,
    json: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False,
) -> int:
    """Make a mechanism do what a problem file says, or the marionette follow a motion; write the result into a folder.

    The folder gets the motion with its inputs and feedback gains (result.npz; of the marionette trajectory.npz), the
    numbers (summary.txt, summary.json), plots (convergence, tracking, limits or strings, snapshots) and an animation
    for the browser. Ctrl-C stops after the last whole iteration and still writes everything.

    Parameters
    ----------
    problem
        A problem file (.yaml, .json), of any mechanism; or the word marionette, a puppet of 22 joint variables on six
        strings, on more, or on a control, for which there are options of motion and strings.
    check
        Play what is found, under feedback, on a simulated rig with elastic strings that go slack, masses that are
        off, and sensors that are noisy and late; say how far its joints are off.
    resume
        result.npz of an earlier run of the problem; of the marionette trajectory.npz, or search.npz of one that still
        sought a first trajectory: go on from there, with the motion that it followed.
    json
        Print the numbers of summary.json, and how it goes on the error stream.
    """
    with _printing_numbers(output.out) if json else nullcontext():
        return _optimized(problem, wanted, puppet, check, resume, optimiser, output)


def _optimized(
    problem: str,
    wanted: MotionOptions | None,
    puppet: PuppetOptions | None,
    check: bool,
    resume: Path | None,
    optimiser: OptimiserOptions | None,
    output: OutputOptions,
) -> int:
    """Solve a problem, or make the marionette follow a motion; see `optimize`."""
    if problem != "marionette":
        if wanted is not None or puppet is not None or check:
            raise ArgumentError(
                f"options of motion, strings and --check belong to the marionette, and not to {problem}"
            )
        return _solve(problem, resume, optimiser or OptimiserOptions(), output)
    wanted, puppet = wanted or MotionOptions(), puppet or PuppetOptions()
    if resume is not None:
        wanted.check_resumed()
    wanted.check()
    limits = puppet.limits()
    from leastaction.apps.cli.session import Request

    with _folder(output) as folder:
        if resume is not None:
            from leastaction.apps.marionette.tracking import load_unfinished

            request = Request(load_unfinished(resume), limits, check=check)
        else:
            request = Request(_motion(wanted), limits, puppet.strings, wanted.follow, check)
        return _run(request, optimiser, output, folder)


def _solve(problem: str, resume: Path | None, optimiser: OptimiserOptions, output: OutputOptions) -> int:
    """Solve the problem of a file."""
    from leastaction.apps.cli.shield import uninterrupted
    from leastaction.apps.problems import load_problem, run_problem
    from leastaction.numerics.documents import NOTATIONS

    if Path(problem).suffix.lower() not in NOTATIONS:
        raise ArgumentError(f"got {problem!r}, expected a problem file ({', '.join(NOTATIONS)}), or marionette")
    stated = load_problem(problem)
    usual = OptimiserOptions()
    options = {
        name: getattr(optimiser, name)
        for name in ("method", "max_iterations", "tolerance")
        if getattr(optimiser, name) != getattr(usual, name)
    }
    with _folder(output) as folder:
        return run_problem(
            stated,
            folder,
            resume=resume,
            options=options,
            plots=output.plots,
            animation=output.animation,
            whole=uninterrupted,
            complain=_complain,
        )


def _motion(wanted: MotionOptions) -> Motion | AtSpeeds:
    """Return the motion that is asked for: read from a file, at any speed if need be, or made up."""
    if wanted.motion is None:
        from leastaction.apps.marionette.walk import walk_in_place

        return walk_in_place(10.0 if wanted.duration is None else wanted.duration, wanted.dt)
    from leastaction.apps.cli.session import AtSpeeds
    from leastaction.apps.marionette.retargeting import load_motion

    console, file = Console(highlight=False), wanted.motion

    def motion_at(speed: float) -> Motion:
        with console.status(f"reading {file.name}"):
            loaded = load_motion(
                file, mapping=wanted.mapping, duration=wanted.duration, dt=wanted.dt, start=wanted.start,
                in_place=wanted.in_place, trim=wanted.trim, speed=speed, up=wanted.up, forward=wanted.forward,
                heading=wanted.heading, markers=wanted.follow == "markers", skeleton=wanted.skeleton,
                frame_rate=wanted.frame_rate,
            )  # fmt: skip
        console.print(loaded.summary(), markup=False)
        for warning in loaded.warnings:
            console.print("[bold yellow]warning:[/bold yellow] ", end="")
            console.print(warning, markup=False, soft_wrap=True)
        # The name is enough for titles, and where a file lies is nobody's business but its owner's.
        return replace(loaded.motion, source=file.name)

    return AtSpeeds(motion_at, wanted.error) if wanted.speed == "auto" else motion_at(wanted.speed)


@app.command(sort_key=6)
def info(file: str, /, *, json: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False) -> int:
    """Show what is in a file: a run and how it ended, a result with its limits, a model and what was left out of it.

    Parameters
    ----------
    file
        A run or a result (.h5, .npz), a run of the marionette (trajectory.npz), or a model: URDF, MJCF, YAML, the name
        of a ready one.
    json
        Print it as JSON.
    """
    from leastaction.apps.cli.mechanism.description import facts_of, text_of

    if json:
        print(facts_of(file))
    else:
        Console(highlight=False).print(text_of(file), soft_wrap=True)
    return 0


@app.command(sort_key=8)
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


@app.command(sort_key=9)
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


app.command(commands.view, sort_key=2)
app.command(commands.check, sort_key=3)
app.command(commands.simulate, sort_key=4)
app.command(commands.lqr, sort_key=5)
app.command(commands.convert, sort_key=7)
app.command(commands.bench, sort_key=10)


@contextmanager
def _folder(output: OutputOptions) -> Iterator[Path]:
    """Check before a run that its results can be drawn and written; yields their folder, see `output_folder`."""
    from leastaction.apps.cli.report import check_pictures
    from leastaction.numerics.files import output_folder

    if output.plots:
        check_pictures()
    with output_folder(output.out) as folder:
        yield folder


@contextmanager
def _printing_numbers(folder: Path) -> Iterator[None]:
    """Send what is printed inside to the error stream, and print the summary that was written after it."""
    summary = folder / "summary.json"
    before = summary.stat().st_mtime_ns if summary.exists() else None
    with redirect_stdout(sys.stderr):
        yield
    # That of an earlier run in the folder is not what was asked for.
    if summary.exists() and summary.stat().st_mtime_ns != before:
        print(summary.read_text(encoding="utf-8").rstrip())


def _run(request: Request, optimiser: OptimiserOptions | None, output: OutputOptions, folder: Path) -> int:
    from leastaction.apps.cli import session

    return session.run(request, optimiser or OptimiserOptions(), output, folder, _complain)


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
