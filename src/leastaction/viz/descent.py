"""The cost along descent directions, beside its models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.public import public
from leastaction.optimal.checks.descent import cost_along
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.viz.figures import BLUE, GREEN, GREY, VERMILION, styled
from leastaction.viz.panels import PanelRow, legend_above, stack

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@public
@styled
def plot_descent(
    system: DiscreteSystem | ContinuousSystem,
    cost: Cost | ContinuousCost,
    initial: Any,
    *,
    methods: Sequence[str] = ("quasi-newton", "newton"),
    horizon: tuple[float, float] | None = None,
    title: str = "",
) -> Figure:
    """Draw the cost of projected trajectories along descent directions, beside the linear and the quadratic model.

    What tells whether derivatives are right, and how far a model can be trusted (see `leastaction.optimal.cost_along`).

    Parameters
    ----------
    system, cost
        As of `optimize`.
    initial : (x, u), OptimizationResult or DenseTrajectory
        The trajectory that is left, as of `optimize`: such as the one that an optimisation begins with.
    methods : sequence of str
        Models: of "newton", "quasi-newton" and "steepest", a panel for each.
    horizon : (t0, tf), optional
        Times (s); needed with ``(x, u)`` of a continuous system.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        Cost against the step length, in which 1 is the minimum of the model.

    Raises
    ------
    ArgumentError
        As of `optimize`; no methods, or one whose model has no minimum there.
    """
    names = [methods] if isinstance(methods, str) else list(methods)
    if not names:
        raise ArgumentError("methods: got none, expected some of 'newton', 'quasi-newton', 'steepest'")
    curves = [cost_along(system, cost, initial, method=name, horizon=horizon) for name in names]
    row = PanelRow(count=len(curves), height=2.6, label="cost")
    figure, ((*panels,),) = stack([row], title, xlabel="step length", headed=True)
    for curve, axes in zip(curves, panels, strict=True):
        axes.plot(curve.gamma, curve.cost, color=BLUE, linewidth=1.6, marker="o", markersize=3, label="cost", zorder=3)
        axes.plot(curve.gamma, curve.linear, color=GREEN, linestyle=(0, (1.2, 1.6)), linewidth=1.6, label="linear")
        axes.plot(
            curve.gamma, curve.quadratic, color=VERMILION, linestyle=(0, (6, 2)), linewidth=1.4, label="quadratic"
        )
        axes.axvline(1.0, color=GREY, linewidth=0.7, zorder=1)
        # The linear model leaves the picture early, and a cost that explodes would press all else flat.
        low = min(float(np.nanmin(curve.cost)), float(curve.quadratic.min()))
        high = max(curve.start, float(curve.quadratic.max()))
        room = max(high - low, 1e-12 * abs(curve.start))
        axes.set_ylim(low - 0.12 * room, high + 0.35 * room)
        axes.margins(x=0.02)
        axes.set_title(curve.method, fontweight="bold", pad=18)
        legend_above(axes, handlelength=2.0, columnspacing=1.0)
    return figure
