"""What commands print and write, beside their results: errors of a line, folders that are checked before a run."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from leastaction.apps.cli.options import OutputOptions
from leastaction.errors import ArgumentError


def complain(message: str, *, hint: str = "") -> None:
    """Print an error on the error stream, in its own words."""
    console = Console(stderr=True, highlight=False)
    console.print("[bold red]error:[/bold red] ", end="")
    console.print(message, markup=False, soft_wrap=True)
    if hint:
        console.print(hint, style="dim")


@contextmanager
def checked_folder(output: OutputOptions) -> Iterator[Path]:
    """Check before a run that its results can be drawn and written; yields their folder, made where need be.

    Raises `ArgumentError`: matplotlib is not installed; `OutputError`: nothing can be written there.
    """
    from leastaction.numerics.files import output_folder

    if output.plots:
        _check_pictures()
    with output_folder(output.out) as folder:
        yield folder


@contextmanager
def printing_numbers(folder: Path) -> Iterator[None]:
    """Send what is printed inside to the error stream, and print the summary that was written after it."""
    summary = folder / "summary.json"
    before = summary.stat().st_mtime_ns if summary.exists() else None
    with redirect_stdout(sys.stderr):
        yield
    # That of an earlier run in the folder is not what was asked for.
    if summary.exists() and summary.stat().st_mtime_ns != before:
        print(summary.read_text(encoding="utf-8").rstrip())


def _check_pictures() -> None:
    """Refuse to start a run whose pictures cannot be drawn."""
    if importlib.util.find_spec("matplotlib") is None:
        raise ArgumentError(
            "the plots need matplotlib, which is not installed. "
            "Install it (pip install 'leastaction[viz]'), or run with --no-plots"
        )


@contextmanager
def progress_bar(what: str, total: int, console: Console) -> Iterator[Callable[[int], None]]:
    """Show a bar while something is done; yields what is to be called with how much of it is done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)
