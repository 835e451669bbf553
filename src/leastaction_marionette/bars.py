"""How control bars are moved: their poses over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.models.marionette import bars_of
from leastaction.numerics import Array
from leastaction.viz import GREY, new_figure, styled
from leastaction_marionette.tracking.found import TrackingRun
from leastaction_marionette.tracking.limits import pelvis_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AXES = {"x": "right", "y": "ahead", "z": "up"}
_TURNS = {"z": "turned left", "y": "tilted right", "x": "tilted back"}  # what a positive angle is


@styled
def plot_bars(run: TrackingRun) -> Figure:
    """Draw the poses of a run's control bars over time, seen from where the pelvis is wanted and faces.

    Parameters
    ----------
    run : TrackingRun
        Of a marionette on bars.

    Returns
    -------
    Figure
        A row for each bar: its place, and its turns; dashed lines are their limits where the motion comes near them.

    Raises
    ------
    ArgumentError
        If all strings are held by hands.
    """
    bars, limits = bars_of(run.mechanism), run.limits
    if not bars:
        raise ArgumentError("run: its strings are all held by hands, expected a marionette on control bars")
    pelvis, t = pelvis_of(run.mechanism, run.reference), run.trajectory.t
    figure = new_figure(9.0, 0.4 + 2.6 * len(bars))
    panels = figure.subplots(len(bars), 2, squeeze=False)
    for bar, (places, turns) in zip(bars, panels, strict=True):
        apart = [run.trajectory[name] for name in bar.places]
        cos, sin = np.cos(pelvis[:, 2]), np.sin(pelvis[:, 2])
        x, y = apart[0] - pelvis[:, 0], apart[1] - pelvis[:, 1]
        lines = {"x": cos * x + sin * y, "y": cos * y - sin * x, "z": apart[2]}
        _draw(places, t, {_AXES[axis]: line for axis, line in lines.items()}, {2: limits.lift})
        places.set(ylabel=f"{bar.name}: off by (m)")
        angles = {axis: run.trajectory[name] for axis, name in zip(bar.turns, bar.angles, strict=True)}
        angles["z"] = angles["z"] - pelvis[:, 2]
        most = {i: np.rad2deg(limits.turn if axis == "z" else limits.tilt) for i, axis in enumerate(angles)}
        _draw(turns, t, {_TURNS[axis]: np.rad2deg(line) for axis, line in angles.items()}, most)
        turns.set(ylabel=f"{bar.name}: turned by (degrees)")
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    return figure


def _draw(axes: Axes, t: Array, lines: dict[str, Array], limits: dict[int, float]) -> None:
    """Draw lines by their names, and limits on both sides by the lines' numbers where they are nearly reached."""
    for i, (name, line) in enumerate(lines.items()):
        (drawn,) = axes.plot(t, line, linewidth=1.2, label=name)
        most = limits.get(i, np.inf)
        for side in (-most, most):
            if np.isfinite(side) and np.max(np.sign(side) * line) > 0.8 * most:
                axes.axhline(side, color=drawn.get_color(), linewidth=0.8, linestyle="--")
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.margins(x=0.0)
    axes.legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
