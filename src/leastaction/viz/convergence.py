"""Cost and expected decrease against the iteration, with the method of each step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.numerics.arrays import require_instance
from leastaction.numerics.public import public
from leastaction.optimal.result import OptimizationResult
from leastaction.viz.figures import BLUE, GREEN, GREY, ORANGE, PURPLE, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The first whose name a method's begins with.
_MARKS: Final = {"steepest": (ORANGE, "s"), "quasi": (GREEN, "^"), "newton-damped": (BLUE, "v"), "newton": (BLUE, "o")}


def _mark(method: str) -> tuple[str, str]:
    """Colour and marker of a method, by what its name begins with; others share one."""
    return next((mark for key, mark in _MARKS.items() if method.lower().startswith(key)), (PURPLE, "D"))


@public
@styled
def plot_convergence(result: OptimizationResult, *, title: str = "Convergence") -> Figure:
    """Draw how an optimisation went.

    Parameters
    ----------
    result : OptimizationResult
        Of `optimize`.
    title : str
        Heading; the first and the last cost are added.

    Returns
    -------
    Figure
        Two panels over the same iterations: the cost before the first step and after each, on a logarithmic axis where
        it is positive throughout; and the decrease that each direction promised, beside the one at which a run stops.
        The mark of a step says which method's direction it went along.

    Raises
    ------
    ArgumentError
        For what is no result.
    """
    require_instance(result, "result", OptimizationResult, "optimize() returns one")
    history, settings = result.history, result.settings
    costs, methods = history.cost, history.method
    # Of an interrupted run the last one is not known.
    last = [result.expected_decrease] if np.isfinite(result.expected_decrease) else []
    decreases = np.abs(np.append(history.expected_decrease, last))[: len(costs)]
    tolerance = settings.tolerance * abs(result.cost) + settings.absolute_tolerance
    figure = new_figure(8.0, 5.4)
    top, bottom = figure.subplots(2, 1, sharex=True)
    if np.all(costs > 0.0):
        top.set_yscale("log")
        # A narrow range on a log axis has no labelled decade in it and would show no number at all.
        if costs.max() < 15.0 * costs.min():
            _plain_log_labels(top)
    top.plot(np.arange(costs.size), costs, color=GREY, linewidth=1.2, zorder=1)
    if np.any(decreases > 0.0):
        bottom.set_yscale("log")
    positive = np.where(decreases > 0.0, decreases, np.nan)
    bottom.plot(np.arange(decreases.size), positive, color=GREY, linewidth=1.2, zorder=1)

    top.plot(
        0,
        costs[0],
        "o",
        markersize=6,
        markerfacecolor="white",
        markeredgecolor=GREY,
        label="start" if decreases.size < costs.size else "start, end",
        zorder=2,
    )
    for name in dict.fromkeys(methods):
        steps = np.array([k for k, method in enumerate(methods) if method == name], dtype=int)
        colour, marker = _mark(name)
        ends = steps[steps + 1 < costs.size] + 1
        top.plot(ends, costs[ends], marker, color=colour, markersize=6, label=name, zorder=3)
        starts = steps[steps < decreases.size]
        bottom.plot(starts, positive[starts], marker, color=colour, markersize=6, zorder=3)
    if decreases.size == costs.size:
        end = {"markersize": 6, "markerfacecolor": "white", "markeredgecolor": GREY}
        bottom.plot(decreases.size - 1, positive[-1], "o", **end, zorder=3)
    if tolerance > 0.0:
        bottom.axhline(tolerance, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        bottom.annotate(
            f"stop below {tolerance:.0e}",
            (0.0, tolerance),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            xytext=(4, 3),
            ha="left",
            fontsize=8,
            color=GREY,
        )
    top.set_title(f"{title}: {costs[0]:.4g} to {costs[-1]:.4g} in {costs.size - 1} iterations", fontsize=11, pad=8)
    top.set_ylabel("cost")
    bottom.set_ylabel("expected decrease")
    bottom.set_xlabel("iteration")
    bottom.xaxis.get_major_locator().set_params(integer=True)
    bottom.margins(x=0.03)
    top.legend(loc="upper right", ncols=4, handletextpad=0.3, columnspacing=1.2)
    figure.align_ylabels()
    return figure


def _plain_log_labels(axes: Axes) -> None:
    """Label a log axis that spans about one decade at 1, 2, 5 steps, as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0, 7.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
