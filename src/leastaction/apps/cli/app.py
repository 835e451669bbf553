"""The commands, in the order in which help shows them; those of any mechanism are in `mechanism`."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import Annotated

from cyclopts import App, Group, Parameter
from cyclopts.exceptions import CycloptsError
from rich.console import Console

from leastaction._version import __version__
from leastaction.apps.cli.applications import applications
from leastaction.apps.cli.mechanism import commands
from leastaction.apps.cli.options import OUTPUT, OptimiserOptions, OutputOptions
from leastaction.apps.cli.output import checked_folder, complain, printing_numbers
from leastaction.apps.cli.shield import ending_interrupts, shielded_output
from leastaction.errors import ArgumentError, LeastActionError

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


optimize_app = App(name="optimize", sort_key=1)
app.command(optimize_app)


@optimize_app.default
def optimize(
    problem: str,
    /,
    *,
    resume: Annotated[Path | None, Parameter(group=OUTPUT)] = None,
    optimiser: OptimiserOptions | None = None,
    output: OutputOptions,
    json: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False,
) -> int:
    """Make a mechanism do what a problem file says, or a marionette follow a motion; write the result into a folder.

    The folder gets the motion with its inputs and feedback gains (result.npz), the numbers (summary.txt,
    summary.json), plots (convergence, tracking, limits) and an animation for the browser. Ctrl-C stops after the last
    whole iteration and still writes everything.

    Parameters
    ----------
    problem
        A problem file (.yaml, .json), of any mechanism; or one of the words below, which have options of their own.
    resume
        result.npz of an earlier run of the problem: go on from there.
    json
        Print the numbers of summary.json, and how it goes on the error stream.
    """
    with printing_numbers(output.out) if json else nullcontext():
        return _solve(problem, resume, optimiser or OptimiserOptions(), output)


def _solve(problem: str, resume: Path | None, optimiser: OptimiserOptions, output: OutputOptions) -> int:
    """Solve the problem of a file."""
    from leastaction.apps.cli.shield import uninterrupted
    from leastaction.apps.problems import load_problem, run_problem
    from leastaction.numerics.documents import NOTATIONS

    if Path(problem).suffix.lower() not in NOTATIONS:
        known = [f"a problem file ({', '.join(NOTATIONS)})", *(name for name in optimize_app if name[0] != "-")]
        raise ArgumentError(f"got {problem!r}, expected {', or '.join(known)}")
    stated = load_problem(problem)
    usual = OptimiserOptions()
    options = {
        name: getattr(optimiser, name)
        for name in ("method", "max_iterations", "tolerance")
        if getattr(optimiser, name) != getattr(usual, name)
    }
    with checked_folder(output) as folder:
        return run_problem(
            stated,
            folder,
            resume=resume,
            options=options,
            plots=output.plots,
            animation=output.animation,
            whole=uninterrupted,
            complain=complain,
        )


@app.command(sort_key=6)
def info(file: str, /, *, json: Annotated[bool, Parameter(group=OUTPUT, negative=())] = False) -> int:
    """Show what is in a file: a run and how it ended, a result with its limits, a model and what was left out of it.

    Parameters
    ----------
    file
        A run or a result (.h5, .npz), a run of the marionette (trajectory.npz), a capture (.bvh, .amc, .c3d, .trc), or
        a model: URDF, MJCF, YAML, the name of a ready one.
    json
        Print it as JSON.
    """
    from leastaction.apps.cli.mechanism.description import facts_of, text_of

    if json:
        print(facts_of(file))
    else:
        Console(highlight=False).print(text_of(file), soft_wrap=True)
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


@cache
def program() -> App:
    """Return the program with the commands of all applications that are installed."""
    for application in applications():
        application.add_commands(app)
    return app


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
                answer = program()(arguments, result_action="return_value")
            code = answer if isinstance(answer, int) else 0
        except CycloptsError as error:
            complain(str(error), hint="Try leastaction --help")
            code = _BAD_INPUT
        except LeastActionError as error:
            complain(str(error))
            code = _BAD_INPUT
        except MemoryError:
            complain("this takes more memory than there is: take a longer --dt or a shorter --duration")
            code = _BAD_INPUT
        except KeyboardInterrupt:
            complain("interrupted before there was a result to keep")
            code = _INTERRUPTED
        output.flush()
        # Nobody asked for what a closed pipe (| head) did not take.
        if output.error is not None and output.error.errno != errno.EPIPE:
            complain(f"the output could not be printed ({output.error.strerror})")
            code = code or _NOT_PRINTED
    sys.exit(code)
