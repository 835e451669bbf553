"""Everything that one run leaves in its folder beside its trajectory."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from leastaction.models.marionette import bars_of
from leastaction.numerics import write_text
from leastaction.viz import plot_convergence, plot_snapshots, plot_strings, plot_tracking, save_png, write_animation
from leastaction_marionette.at_rest import RestingPoses, plot_resting, resting
from leastaction_marionette.bars import plot_bars
from leastaction_marionette.command.summary import run_summary
from leastaction_marionette.command.tables import as_text, summary_tables
from leastaction_marionette.markers import plot_markers
from leastaction_marionette.scene import by_parts, marionette_scene, own_string_lengths, string_label
from leastaction_marionette.speeds import AtSpeed, plot_speeds
from leastaction_marionette.tracking import TrackingRun, load_run
from leastaction_marionette.tracking.problem import ROOT
from leastaction_marionette.turns import as_vectors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRAJECTORY: Final = "trajectory.npz"
_FILES: Final = {
    TRAJECTORY: "the run: numpy.load, load_run",
    "summary.json": "the numbers, for programs",
    "summary.txt": "the numbers, to read",
    "convergence.png": "cost against iteration",
    "tracking.png": "reference and achieved motion",
    "markers.png": "how far head, hands and feet are off",
    "strings.png": "string tensions and lengths",
    "bars.png": "how control bars are moved",
    "snapshots.png": "poses over time",
    "speeds.png": "error over speed",
    "resting.png": "what strings can hold at rest",
    "animation.html": "open it in a browser",
}
BESIDE: Final = tuple(name for name in _FILES if name != TRAJECTORY)


def at_rest(run: TrackingRun) -> RestingPoses | None:
    """Return what strings can hold at rest of what a run was to follow; None where it is not told, see `resting`.

    That is of a motion that was planned by tensions: hanging strings that follow one well need no reasons.
    """
    return resting(run) if run.embedded else None


def write_report(
    run: TrackingRun,
    folder: Path,
    *,
    plots: bool = True,
    animation: bool = True,
    progress: Callable[[str], object] = lambda _: None,
    tried: Sequence[AtSpeed] = (),
    error: float = np.inf,
    rest: RestingPoses | None = None,
    summary: dict[str, Any] | None = None,
) -> RenderableType:
    """Write summary, plots and animation of a run into a folder.

    ``run``: the run. ``folder``: an existing folder; files of the same names are replaced, each in one step. ``plots``,
    ``animation``: which of them to write. ``progress``: called with the name of each file before it is made. ``tried``,
    ``error``: at which speeds it was followed, for which error (degrees). ``rest``: what strings can hold at rest, if
    that is to be drawn. ``summary``: the run's, with all that is to be told. Returns the run's files in the folder with
    their sizes, to print. Raises `OutputError`: a file could not be written.
    """
    summary = summary or run_summary(run)
    scene = marionette_scene(run) if plots or animation else None
    makers: dict[str, Callable[[Path], object]] = {
        "summary.json": lambda path: write_text(path, json.dumps(summary, indent=2, ensure_ascii=False) + "\n"),
        "summary.txt": lambda path: write_text(path, as_text(summary_tables(summary))),
    }
    if plots and scene is not None:
        figures: dict[str, Callable[[], Figure]] = {
            "convergence.png": lambda: _convergence(run),
            "tracking.png": lambda: _tracking(run),
            "strings.png": lambda: plot_strings(
                run.trajectory.t,
                own_string_lengths(run),
                run.tension,
                [string_label(name) for name in run.mechanism.constraints],
            ),
            "snapshots.png": lambda: plot_snapshots(scene, title=scene.title),
        }
        if bars_of(run.mechanism):
            figures["bars.png"] = lambda: plot_bars(run)
        if run.markers is not None:
            figures["markers.png"] = lambda: plot_markers(run.trajectory.t, run.markers_apart())
        if rest is not None:
            figures["resting.png"] = lambda: plot_resting(run, rest)
        if tried:
            figures["speeds.png"] = lambda: plot_speeds(tried, goal=error)
        for name, figure in figures.items():
            makers[name] = lambda path, figure=figure: save_png(figure(), path)  # type: ignore[misc]
    if animation and scene is not None:
        makers["animation.html"] = lambda path: write_animation(scene, path)
    for name, make in makers.items():
        progress(name)
        make(folder / name)
    return _file_table(folder, [TRAJECTORY, *makers])


def _file_table(folder: Path, names: list[str]) -> RenderableType:
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_column(style="dim")
    for name in names:
        if (folder / name).exists():
            table.add_row(name, _size((folder / name).stat().st_size), _FILES[name])
    return Group(Text(f"Written to {folder}", style="bold", overflow="fold"), table)


def describe(path: Path) -> RenderableType:
    """Return the summary of a result file, to print.

    Raises `ResultFileError`: the file cannot be used.
    """
    summary = run_summary(load_run(path))
    facts = Table(box=None, pad_edge=False, show_header=False)
    facts.add_column(style="dim")
    facts.add_column()
    facts.add_row("written", summary["run"]["created"])
    for name, value in summary["settings"].items():
        facts.add_row(name.replace("_", " "), str(value))
    facts.add_row("versions", ", ".join(f"{k} {v}" for k, v in summary["versions"].items()))
    return Group(summary_tables(summary), "", facts)


def _convergence(run: TrackingRun) -> Figure:
    several = run.effort.optimisations > 1
    return plot_convergence(run.result, title="Convergence of the last stage" if several else "Convergence")


def _tracking(run: TrackingRun) -> Figure:
    m = run.mechanism
    wanted, made = (as_vectors(m, q) for q in (run.reference, run.trajectory.q))
    return plot_tracking(run.trajectory.t, wanted, made, m.dynamic, lengths=ROOT, groups=by_parts(m))


def _size(count: float) -> str:
    """Return a file size in the unit that fits."""
    for unit in ("B", "kB"):
        if count < 1000.0:
            return f"{count:.0f} {unit}"
        count /= 1000.0
    return f"{count:.1f} MB"
