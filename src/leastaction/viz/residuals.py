"""How far a run is from its constraints, and from its equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory
from leastaction.mechanics.discrete.impulses import impulses_along
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.viz.figures import GREY, PALE, styled
from leastaction.viz.panels import LINES, PanelRow, legend_above, limit_time, stack
from leastaction.viz.signals import Source, motion_of, pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NAMED: Final = 3  # lines in colour, the worst ones
_FLOOR: Final = 1e-17  # below which a residual is drawn as that


@public
@styled
def plot_residuals(run: Source, *, title: str = "") -> Figure:
    """Draw how far a run is from its constraints and from its equations of motion.

    Parameters
    ----------
    run : Trajectory, ContinuousTrajectory or OptimizationResult
        A run, or a result of a mechanism's system.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        On logarithmic axes, the worst three by name and the others pale: the constraints, a panel for each unit; in
        continuous time also their rates; and the equations of motion. These are, in discrete time, what the impulses
        at an instant lack to be in balance, as a part of the largest of them; in continuous time the accelerations
        against those of the dynamics, which hold to rounding where the run is one of these.

    Raises
    ------
    ArgumentError
        For what is no run, and a result that is of no mechanism.
    """
    motion = motion_of(run, "plot_residuals")
    m = motion.mechanism
    sets: list[tuple[str, Sequence[str], Array, Array]] = []
    then = [m.at_time(t) for t in motion.t]
    h = np.array([at.constraint_values(q) for at, q in zip(then, motion.q, strict=True)]).reshape(len(motion.t), m.nc)
    sets += _of_each_unit("constraint", motion, motion.t, h)
    if isinstance(motion, ContinuousTrajectory):
        rates = [at.constraint_rates(q, v) for at, q, v in zip(then, motion.q, motion.v, strict=True)]
        rates_of = np.array(rates).reshape(len(motion.t), m.nc)
        sets += _of_each_unit("its rate", motion, motion.t, rates_of, per="/s")
    t, lacking = _lacking(motion)
    if lacking.size:
        sets.append(("equations (relative)", m.dynamic, t, lacking))
    rows = [PanelRow(count=1, height=1.5, label=label) for label, *_ in sets]
    figure, panels = stack(rows, title)
    for (label, names, times, values), (axes,) in zip(sets, panels, strict=True):
        del label
        _draw(axes, names, times, np.abs(values))
        limit_time(axes, motion.t)
    return figure


def _of_each_unit(
    what: str, motion: Trajectory | ContinuousTrajectory, t: Array, values: Array, *, per: str = ""
) -> list[tuple[str, Sequence[str], Array, Array]]:
    m = motion.mechanism
    units = [m.units[name] for name in m.constraints]
    found: list[tuple[str, Sequence[str], Array, Array]] = []
    for unit in dict.fromkeys(units):
        kept = [i for i, other in enumerate(units) if other == unit]
        shown = pretty(unit or "1") + per
        label = f"{what} ({shown})" if shown != "1" else what
        found.append((label, [m.constraints[i] for i in kept], t, values[:, kept]))
    return found


def _lacking(motion: Trajectory | ContinuousTrajectory) -> tuple[Array, Array]:
    """Return times and what the equations of dynamic variables lack there, relative to the largest term of each."""
    m = motion.mechanism
    if isinstance(motion, ContinuousTrajectory):
        found = ContinuousDynamics(m).inverse_dynamics(
            motion.q, motion.v, motion.a, motion.lam, u=motion.inputs, t=motion.t
        )
        at = zip(map(np.ascontiguousarray, motion.q), map(np.ascontiguousarray, motion.v), motion.t, strict=True)
        slopes = [m.core.gradient(q, v, t)[0] for q, v, t in at]
        inertia = [m.mass_matrix(q)[: m.nd] @ a for q, a in zip(motion.q, motion.a, strict=True)]
        scale = max(float(np.abs(slopes).max(initial=0.0)), float(np.abs(inertia).max(initial=0.0)))
        return motion.t, found[:, : m.nd] / (scale or 1.0)
    before, after, held = impulses_along(MidpointVI(m), motion.t, motion.q, motion.inputs, motion.lam)
    lacking = (after[:-1] + before[1:] - held[1:])[:, : m.nd]
    scale = max(float(np.abs(part[:, : m.nd]).max(initial=0.0)) for part in (after, held))
    return motion.t[1:-1], lacking / (scale or 1.0)


def _draw(axes: Axes, names: Sequence[str], t: Array, values: Array) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    shown = np.maximum(values, _FLOOR)
    axes.set_yscale("log")
    order = np.argsort(-values.max(axis=0), kind="stable")
    axes.plot(t, shown[:, order[_NAMED:]], color=PALE, linewidth=0.8, zorder=1)
    for i, look in zip(order[:_NAMED], LINES, strict=False):
        axes.plot(t, shown[:, i], label=f"{names[i]}: {values[:, i].max():.1e}", linewidth=1.2, zorder=2, **look)
    if len(order) > _NAMED:
        axes.plot([], [], color=PALE, linewidth=0.8, label=f"{len(order) - _NAMED} others")
    axes.yaxis.set_major_locator(LogLocator(numticks=5))
    axes.yaxis.set_major_formatter(lambda x, _: f"1e{round(np.log10(x))}" if x > 0.0 else "")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", length=0.0, colors=GREY)
    legend_above(axes)
