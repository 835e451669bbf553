"""A problem, solved and written: what the command line does with a problem file."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from leastaction.apps.problems.problem import ProblemFile
from leastaction.apps.problems.report import BESIDE, RESULT, write_report
from leastaction.errors import ArgumentError, LeastActionError
from leastaction.io.results import open as open_file
from leastaction.numerics.files import remove_earlier
from leastaction.optimal import IterationRecord, IterationTable, OptimizationResult, StageRecord, StageTable, Status
from leastaction.systems import Followed, follow

INTERRUPTED = 130  # what a shell expects of a program ended by Ctrl-C
STUCK = 1


def run_problem(
    problem: ProblemFile,
    folder: Path,
    *,
    resume: Path | None = None,
    options: Mapping[str, Any] | None = None,
    plots: bool = True,
    animation: bool = True,
    whole: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
    complain: Callable[[str], object] = print,
) -> int:
    """Solve a problem, or go on with an earlier run of it, and fill a folder; progress is printed.

    Ctrl-C ends the search after the last whole iteration, and what it had found is written.

    Parameters
    ----------
    problem : ProblemFile
    folder : Path
        It exists.
    resume : Path, optional
        The result of an earlier run.
    options : mapping, optional
        Of `optimize`, in place of those of the file.
    plots, animation : bool, optional
        Whether to draw them, if the file does not say no.
    whole : callable, optional
        Returns a context in which Ctrl-C waits.
    complain : callable, optional
        Is told what could not be written.

    Returns
    -------
    int
        What the program tells the shell: 0 for a result to use, 130 after Ctrl-C, 1 where the optimiser was stuck or
        something could not be written.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C before there was anything to keep.
    LeastActionError
        The problem cannot be set up, or its result cannot be written.
    """
    console = Console(highlight=False)
    steps = len(problem.t) - 1
    console.print(
        f"{problem.title}: {problem.model.name or 'a mechanism'}, {steps} steps of {problem.t[1]:g} s", markup=False
    )
    began = time.perf_counter()
    found = solve(problem, resume=resume, options=options, console=console)
    with whole():
        found.result.save(folder / RESULT)
        remove_earlier(folder, BESIDE)  # what stays where this run could not be written
    console.print()
    console.print(str(found), markup=False, soft_wrap=True)
    if found.result.limits is not None:
        console.print(str(found.result.limits), markup=False, soft_wrap=True)
    status = found.result.status
    again = f"leastaction optimize {problem.document.title} --resume {folder / RESULT} --out {folder}"
    try:
        with console.status("writing"):
            written = write_report(
                problem, found, folder, plots=plots and problem.plots, animation=animation and problem.animation
            )
    except KeyboardInterrupt:
        complain(f"interrupted; the result is in {folder / RESULT}. Go on with: {again}")
        return INTERRUPTED
    except LeastActionError as error:
        complain(f"{error}. The result itself is in {folder / RESULT}")
        return STUCK
    for name, about in written.items():
        console.print(f"{folder / name}: {about}", markup=False, soft_wrap=True)
    console.print(f"{time.perf_counter() - began:.2f} s in all")
    if status in (Status.ITERATION_LIMIT, Status.INTERRUPTED):
        console.print(f"Go on with: {again}", markup=False, soft_wrap=True)
    if status is Status.INTERRUPTED:
        return INTERRUPTED
    return 0 if found.result.success or status is Status.ITERATION_LIMIT else STUCK


def solve(
    problem: ProblemFile,
    *,
    resume: Path | None = None,
    options: Mapping[str, Any] | None = None,
    console: Console | None = None,
) -> Followed:
    """Return the motion that a problem asks for; see `run_problem`.

    Raises `LeastActionError`: with the place in the file, where it is one of the file's.
    """
    shown = {} if console is None else _progress(console)
    m = problem.model.mechanism
    earlier: Any = None if resume is None else open_file(resume)
    if resume is not None and not isinstance(earlier, OptimizationResult):
        raise ArgumentError(
            f"--resume {resume}: it holds no result of the optimiser; give the {RESULT} of an earlier run"
        )
    if earlier is not None and len(earlier.u) != len(problem.t) - 1:
        raise ArgumentError(
            f"--resume {resume}: got a result of {len(earlier.u)} steps, expected {len(problem.t) - 1}, as "
            f"{problem.document.title} has; give the result of this problem"
        )
    arguments = {**problem.options, **(options or {}), **shown}
    try:
        return follow(
            m,
            problem.wanted,
            problem.weights,
            problem.limits,
            t=problem.t,
            start=problem.start,
            resume=earlier,
            **arguments,
        )
    except LeastActionError as error:
        key = str(error).partition(":")[0]
        if key in ("weights", "limits", "unknowns", "start"):
            raise problem.document.error((key,), str(error).removeprefix(f"{key}: ")) from None
        raise


def _progress(console: Console) -> dict[str, Any]:
    """Return callbacks that show how a search goes on."""
    table, stages = IterationTable(), StageTable()

    def show(record: IterationRecord | StageRecord) -> object:
        # Where help on all variables is taken away step by step, its stages are told.
        return stages(record) if isinstance(record, StageRecord) else table(record)

    return {"callback": show, "progress": lambda line: console.print(line, markup=False, style="dim")}
