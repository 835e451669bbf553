"""The room that limits leave, where they hold a motion back, and what more room would be worth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.public import public
from leastaction.optimal.result import OptimizationResult
from leastaction.viz.figures import BLUE, INK, ORANGE, VERMILION, Margins, at_least, heading, panel_grid, styled
from leastaction.viz.strings import spans

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPAN_DUAL: Final = 0.01  # so that the noise of limits that are never active does not fill their panels


@public
@styled
def plot_limits(result: OptimizationResult, *, title: str = "Limits") -> Figure:
    """Draw room and dual of each side of each limit over time.

    Parameters
    ----------
    result : OptimizationResult
        Of `optimize` with limits.
    title : str
        Heading.

    Returns
    -------
    Figure
        One row per side that holds at several instants: the room on the left, shaded where the limit is active and red
        where it is not met; the dual on the right.

    Raises
    ------
    ArgumentError
        For what is no result, or one without limits that hold at several instants.
    """
    require_instance(result, "result", OptimizationResult, "optimize() returns one")
    times, report = result.t, result.limits
    # A single instant makes no curve; what it came to is in the report's text.
    sides = [side for side in report.sides if len(side.k) > 1] if report is not None else []
    rows = [(side, j) for side in sides for j in range(len(side.labels))]
    if not rows:
        raise ArgumentError(
            "plot_limits: got a result without limits over time, expected one of an optimisation with limits at "
            "several instants"
        )
    margins = Margins(across=0.85, down=0.36)
    figure, panels = panel_grid(len(rows), 2, panel=(4.6, 1.0), margins=margins, width_ratios=(1.6, 1.0))
    for (side, j), (left, right) in zip(rows, panels, strict=True):
        when = times[side.k] if side.t is None else side.t
        room, dual, active = side.value[:, j], side.dual[:, j], side.active[:, j]
        for begin, end in spans(when, active) if not side.equation else []:
            left.axvspan(begin, end, color=ORANGE, alpha=0.25, linewidth=0.0)
        left.plot(when, room, color=BLUE, linewidth=1.2)
        unmet = room < -1e-6 * max(1.0, float(np.abs(room).max()))
        left.plot(when, np.where(unmet, room, np.nan), color=VERMILION, linewidth=1.8)
        left.axhline(0.0, color=INK, linewidth=0.7)
        left.set_title(side.labels[j], fontweight="bold")
        share = 100.0 * float(np.mean(active))
        state = "equation" if side.equation else f"active {share:.0f} % of the time" if share else "never active"
        left.set_title("not met" if unmet.any() else state, loc="right", color=VERMILION if unmet.any() else INK)
        right.plot(when, dual, color=ORANGE, linewidth=1.4)
        at_least(right, _SPAN_DUAL)
        right.set_title(f"largest {np.abs(dual).max():.3g}", loc="right")
        for axes, label in ((left, "off" if side.equation else "room"), (right, "dual")):
            axes.set_ylabel(label)
            axes.set_xlim(times[0], times[-1])
            axes.yaxis.get_major_locator().set_params(nbins=4)
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    heading(figure, title)
    return figure
