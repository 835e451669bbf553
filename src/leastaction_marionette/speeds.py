"""At which speed a captured motion can be made: error over speed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.numerics import as_number
from leastaction.viz import BLUE, GREY, PALE, VERMILION, new_figure, styled
from leastaction_marionette.scene import marionette_scene
from leastaction_marionette.tracking import TrackingRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPEEDS: Final = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2)
"""Speeds that are tried, relative to the capture, the fastest first."""

_SLOWER: Final = 2  # speeds in a row that bring next to nothing are enough to tell that slower ones do not either
_LESS = 0.97  # times the error before is what they would have to bring


@dataclass(frozen=True, kw_only=True)
class AtSpeed:
    """A motion as it is followed at some speed.

    Attributes
    ----------
    speed : float
        Relative to the capture.
    error : float
        Root mean square error of what is followed: degrees of the joints behind which a string is tied, or millimetres
        of the markers.
    run : TrackingRun
    """

    speed: float
    error: float
    run: TrackingRun = field(repr=False)


def fastest(
    follow: Callable[[Motion], TrackingRun],
    motion_at: Callable[[float], Motion],
    error: float,
    *,
    speeds: Iterable[float] = SPEEDS,
) -> list[AtSpeed]:
    """Follow a motion ever more slowly, until the joints that strings hold, or the markers, stay within an error.

    Two slower speeds in a row that do not make the error less by 3 % end it too: what is missing then are strings, not
    time.

    Parameters
    ----------
    follow : callable
        Follows a motion, as `track` does.
    motion_at : callable
        The motion at a speed, such as ``lambda speed: load_motion(file, speed=speed).motion``.
    error : float
        Largest root mean square error of the held joints (degrees), or of the markers (mm) where they are followed.
    speeds : iterable of float, optional
        What is tried, the fastest first.

    Returns
    -------
    list of AtSpeed
        All that was tried. The last is within the error; if none is, the one with the least error is last. A run that
        was interrupted, or stopped by a callback, is the last one too.

    Raises
    ------
    ArgumentError
        An error that is not positive, no speeds; what `follow` and `motion_at` raise.
    """
    as_number(error, "error", above=0.0)
    tried: list[AtSpeed] = []
    for speed in speeds:
        run = follow(motion_at(speed))
        tried.append(AtSpeed(speed=speed, error=run.off, run=run))
        if run.off <= error or run.ended_early:
            return tried
        if len(tried) > _SLOWER and all(each.error > _LESS * tried[-1 - _SLOWER].error for each in tried[-_SLOWER:]):
            break
    if not tried:
        raise ArgumentError("speeds: got none, expected at least one to try")
    return sorted(tried, key=lambda each: -each.error)


@styled
def plot_speeds(tried: Sequence[AtSpeed], *, goal: float, poses: int = 6) -> Figure:
    """Draw poses at every speed that was tried, the reference behind them, and the error over speed.

    ``tried``: from `fastest`. ``goal``: the error that was asked for. ``poses``: how many, at the same places
    of the motion.
    """
    rows = sorted(tried, key=lambda each: -each.speed)
    figure = new_figure(1.25 * (poses + 1) + 0.6, 1.6 * len(rows) + 0.5)
    panels = figure.subplots(len(rows), poses + 1, squeeze=False)
    what, unit = ("the markers", "mm") if tried[0].run.follow == "markers" else ("the joints that strings hold", "deg")
    words = f"rms of {what}, line at {goal:g} {unit}; grey: the wanted poses"
    figure.suptitle(f"The same motion at other speeds: {words}", x=0.012, ha="left", fontsize=10)
    for each, cells in zip(rows, panels, strict=True):
        _draw_row(each.run, cells[:-1])
        cells[0].set_title(f"{each.speed:g}x")
        bar = cells[-1]
        bar.barh([0.0], [each.error], height=0.5, color=BLUE if each.error <= goal else VERMILION)
        bar.plot([goal, goal], [-0.5, 0.5], color=GREY, linewidth=0.8)
        bar.text(each.error, 0.0, f" {each.error:.1f} {unit}", va="center", fontsize=8.0)
        bar.set(xlim=(0.0, 1.6 * max(goal, *(one.error for one in rows))), ylim=(-1.0, 1.0), yticks=[], xticks=[])
        bar.set_axis_off()
    return figure


def _draw_row(run: TrackingRun, cells: Iterable[Axes]) -> None:
    """Draw poses of a run from the side, evenly over its time, with the reference in grey."""
    cells = list(cells)
    mechanism = run.mechanism
    scene = marionette_scene(run)
    names = sorted({name for bone in scene.bones for name in (bone.start, bone.end)})
    places = np.linspace(0, len(run.trajectory.t) - 1, len(cells)).astype(int)
    shown: list[tuple[float, float]] = []
    for k, cell in zip(places, cells, strict=True):
        for q, colour, width in ((run.reference[k], PALE, 2.5), (run.trajectory.q[k], BLUE, 1.2)):
            at = dict(zip(names, mechanism.positions(q, names), strict=True))
            middle = run.reference[k][:2]
            for bone in scene.bones:
                a, b = at[bone.start], at[bone.end]
                # From ahead and to the right, so that both legs and arms are seen.
                across = [0.6 * (p[0] - middle[0]) + 0.8 * (p[1] - middle[1]) for p in (a, b)]
                cell.plot(across, [a[2], b[2]], color=colour, linewidth=width)
                shown += zip(across, (a[2], b[2]), strict=True)
    least, most = np.min(shown, axis=0) - 0.05, np.max(shown, axis=0) + 0.05
    for cell in cells:
        cell.set(xlim=(least[0], most[0]), ylim=(least[1], most[1]), aspect="equal")
        cell.set_axis_off()
