"""Everything that one run leaves in its folder."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from leastaction import models
from leastaction.apps.cli.summary import as_text, length_names, run_summary, summary_tables
from leastaction.apps.marionette.scene import (
    GROUPS,
    marionette_scene,
    string_labels,
    string_lengths,
)
from leastaction.errors import ArgumentError
from leastaction.io.results.files import load_record, save_record
from leastaction.io.results.record import RunRecord
from leastaction.numerics.files import write_text
from leastaction.viz.animation import write_animation
from leastaction.viz.convergence import plot_convergence
from leastaction.viz.figures import save_png
from leastaction.viz.snapshots import plot_snapshots
from leastaction.viz.strings import plot_strings
from leastaction.viz.tracking import plot_tracking

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from leastaction.mechanics import Mechanism

TRAJECTORY = "trajectory.npz"


@dataclass(frozen=True, kw_only=True)
class Report:
    """What was written, and the tables for the terminal.

    Parameters
    ----------
    files
        Each file and what it shows, in the order of writing.
    tables
        The summary, to print.
    """

    files: tuple[tuple[Path, str], ...]
    tables: RenderableType

    def file_table(self) -> RenderableType:
        """Return the files with their sizes, to print."""
        table = Table(box=None, pad_edge=False, show_header=False)
        table.add_column()
        table.add_column(justify="right")
        table.add_column(style="dim")
        for path, meaning in self.files:
            table.add_row(path.name, _size(path.stat().st_size), meaning)
        title = Text(f"Written to {self.files[0][0].parent}", style="bold", overflow="fold")
        return Group(title, table)


def check_pictures() -> None:
    """Refuse to start a run whose pictures cannot be drawn.

    Raises
    ------
    ArgumentError
        Matplotlib is not installed.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ArgumentError(
            "the plots need matplotlib, which is not installed. "
            "Install it (pip install 'leastaction[viz]'), or run with --no-plots"
        )


def write_report(
    record: RunRecord,
    folder: Path,
    *,
    trajectory: bool = True,
    plots: bool = True,
    animation: bool = True,
    progress: Callable[[str], object] = lambda _: None,
) -> Report:
    """Write trajectory, summary, plots and animation of a run into a folder.

    Parameters
    ----------
    record
        The run.
    folder
        An existing folder; files of the same names are replaced, each in one step.
    trajectory, plots, animation
        Which of them to write.
    progress
        Called with the name of each file before it is made.

    Returns
    -------
    Report
        The files and the tables.

    Raises
    ------
    OutputError
        A file could not be written.
    """
    files: list[tuple[Path, str]] = []

    def add(name: str, meaning: str, write: Callable[[Path], object]) -> None:
        progress(name)
        write(folder / name)
        files.append((folder / name, meaning))

    def draw(name: str, meaning: str, make: Callable[[], Figure]) -> None:
        add(name, meaning, lambda path: save_png(make(), path))

    if trajectory:
        # First, because it is what cannot be made again from the others.
        add(TRAJECTORY, "the run: load_record, numpy.load", lambda path: save_record(path, record))
    mechanism = _puppet(record)
    lengths = None if mechanism is None else string_lengths(mechanism, record.q)
    summary = run_summary(record, string_lengths=lengths)
    tables = summary_tables(summary, groups=None if mechanism is None else GROUPS)
    text = json.dumps(summary, indent=2, ensure_ascii=False) + "\n"
    add("summary.json", "the numbers, for programs", lambda path: write_text(path, text))
    add("summary.txt", "the numbers, to read", lambda path: write_text(path, as_text(tables)))
    if plots:
        draw("convergence.png", "cost against iteration", lambda: _convergence(record))
        if record.q_wanted is not None:
            draw("tracking.png", "wanted and achieved motion", lambda: _tracking(record))
        if lengths is not None and record.tension is not None:
            pulls, spans = record.tension, lengths
            draw(
                "strings.png",
                "string tensions and lengths",
                lambda: plot_strings(record.t, spans, pulls, string_labels()),
            )
    if mechanism is not None and (plots or animation):
        scene = marionette_scene(
            mechanism,
            record.t,
            record.q,
            q_wanted=record.q_wanted,
            tension=record.tension,
            title=f"Marionette: {record.settings.get('source') or 'motion'}",
        )
        if plots:
            draw("snapshots.png", "poses over time", lambda: plot_snapshots(scene))
        if animation:
            meaning = "open it in a browser"
            add("animation.html", meaning, lambda path: write_animation(scene, path))
    return Report(files=tuple(files), tables=tables)


def describe(path: Path) -> RenderableType:
    """Return the summary of a result file, to print.

    Raises
    ------
    ResultFileError
        The file cannot be used.
    """
    record = load_record(path)
    mechanism = _puppet(record)
    lengths = None if mechanism is None else string_lengths(mechanism, record.q)
    summary = run_summary(record, string_lengths=lengths)
    facts = Table(box=None, pad_edge=False, show_header=False)
    facts.add_column(style="dim")
    facts.add_column()
    facts.add_row("written", record.created)
    for name, value in record.settings.items():
        facts.add_row(name.replace("_", " "), str(value))
    facts.add_row("versions", ", ".join(f"{k} {v}" for k, v in record.versions.items()))
    groups = None if mechanism is None else GROUPS
    return Group(summary_tables(summary, groups=groups), "", facts)


def _puppet(record: RunRecord) -> Mechanism | None:
    """Return the marionette if that is what the run is of."""
    return models.build(record.mechanism) if record.mechanism == "marionette" else None


def _convergence(record: RunRecord) -> Figure:
    histories = record.histories
    final = np.atleast_1d(histories.get("final_expected_decrease", np.zeros(0)))
    # Of an interrupted run it is not known.
    decreases = np.append(histories["expected_decrease"], final[np.isfinite(final)])
    settings = record.settings
    relative = settings.get("tolerance", 0.0) * abs(float(histories["cost"][-1]))
    return plot_convergence(
        histories["cost"],
        decreases,
        [str(method) for method in histories.get("method", ())],
        tolerance=relative + settings.get("absolute_tolerance", 0.0),
    )


def _tracking(record: RunRecord) -> Figure:
    assert record.q_wanted is not None
    nd = record.n_dynamic
    names = record.variables[:nd]
    return plot_tracking(
        record.t,
        record.q_wanted[:, :nd],
        record.q[:, :nd],
        names,
        lengths=length_names(names),
        groups=GROUPS if record.mechanism == "marionette" else None,
    )


def _size(count: float) -> str:
    """Return a file size in the unit that fits."""
    for unit in ("B", "kB"):
        if count < 1000.0:
            return f"{count:.0f} {unit}"
        count /= 1000.0
    return f"{count:.1f} MB"
