"""The gains that hold a motion, and the eigenvalues of what they make of the system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.result import OptimizationResult
from leastaction.viz.figures import BLUE, GREY, INK, new_figure, styled
from leastaction.viz.panels import LINES, WIDTH, legend_above, limit_time
from leastaction.viz.signals import pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINES: Final = 6  # gains of an input that are drawn as lines; more are a picture
_INPUTS: Final = 3


@public
@styled
def plot_feedback(
    result: OptimizationResult, *, system: DiscreteSystem | ContinuousSystem | None = None, title: str = ""
) -> Figure:
    """Draw the gains about an optimised motion, and the eigenvalues of the system under them along it.

    Parameters
    ----------
    result : OptimizationResult
        With gains `K` about it: ``u = u_opt - K (x - x_opt)``.
    system : DiscreteSystem or ContinuousSystem, optional
        The system; needed if the result keeps none (see `OptimizationResult.system`).
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        Gains over time: lines by the state that they answer to, or where there are many a picture of their largest
        sizes. Eigenvalues of ``A - B K`` at every instant, dark at the end: in discrete time beside the unit circle, in
        continuous time beside the imaginary axis (1/s); on the right the largest size, or real part, over time. Those
        of a motion that varies are a picture of each moment, not a proof that it is stable.

    Raises
    ------
    ArgumentError
        For what is no result, or one that keeps no system where none is given.
    """
    require_instance(result, "result", OptimizationResult, "optimize() returns one")
    known = result.system if system is None else system
    if known is None:
        raise ArgumentError("plot_feedback: the result keeps no system, expected system=, the one that was optimised")
    continuous = isinstance(result, ContinuousOptimizationResult)
    values = _eigenvalues(result, known)
    t = result.t[: len(values)]
    states = _states(result, known)
    lines = len(result.input_names) <= _INPUTS and len(states) <= _LINES
    inputs = len(result.input_names) if lines else 1
    heights = [*([1.5] * inputs if lines else [2.6]), 2.8]
    figure = new_figure(WIDTH, 0.4 + sum(heights) + 0.5 * len(heights))
    parts: Any = figure.subfigures(2, 1, height_ratios=[sum(heights[:-1]), heights[-1]])
    above, below = parts
    if lines:
        for axes, i in zip(np.ravel(above.subplots(inputs, 1, sharex=True)), range(inputs), strict=True):
            _gain_lines(axes, result, t, i, states)
    else:
        _gain_picture(above.subplots(), figure, result, list(states))
    plane, over_time = below.subplots(1, 2)
    _plane(plane, figure, t, values, continuous=continuous)
    _largest(over_time, t, values, continuous=continuous)
    if title:
        figure.suptitle(title, fontsize=12, ha="left", x=0.012)
    return figure


def _eigenvalues(result: OptimizationResult, system: object) -> Array:
    """Return those of every instant (n, nx), complex."""
    if isinstance(system, ContinuousSystem):
        A, B = system.linearize(result.x, result.u, result.t)
    else:
        if not isinstance(system, DiscreteSystem):
            raise ArgumentError(f"system: got {type(system).__name__}, expected a DiscreteSystem or a ContinuousSystem")
        A, B = system.linearize(result.x, result.u)
    return np.asarray(np.linalg.eigvals(np.asarray(A) - np.asarray(B) @ result.K[: len(A)]))


def _states(result: OptimizationResult, system: Any) -> dict[str, str]:
    """Return what the gains answer to, with its unit: of rotations that are quaternions the turns about their axes."""
    known = dict(zip(result.state_names, result.state_units, strict=True))
    count = result.K.shape[-1]
    if count == len(known):
        return known
    m = getattr(system, "mechanism", None)
    if m is None:
        return dict.fromkeys((f"dx[{i}]" for i in range(count)), "")
    return {**{name: m.units[name] for name in m.variables}, **dict(list(known.items())[m.nq :])}


def _gain_lines(axes: Axes, result: OptimizationResult, t: Array, i: int, states: dict[str, str]) -> None:
    unit = result.input_units[i]
    for j, (name, other) in enumerate(states.items()):
        by = pretty(f"{unit or '1'} / {f'({other})' if ' ' in other or '/' in other else other}") if other else ""
        look = LINES[j % len(LINES)]
        axes.plot(t, result.K[: len(t), i, j], label=f"{name} ({by})" if by else name, linewidth=1.3, **look)
    axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=1)
    axes.set_ylabel(f"gains of {result.input_names[i]}")
    axes.set_xlabel("time (s)")
    limit_time(axes, result.t)
    legend_above(axes, handlelength=2.0, columnspacing=1.0)


def _gain_picture(axes: Axes, figure: Figure, result: OptimizationResult, states: list[str]) -> None:
    from matplotlib.colors import LogNorm

    largest = np.abs(result.K).max(axis=0)
    top = float(largest.max()) or 1.0
    picture = axes.imshow(
        np.maximum(largest, 1e-4 * top), aspect="auto", cmap="cividis", norm=LogNorm(1e-4 * top, top), origin="upper"
    )
    axes.grid(visible=False)
    for ticks, names in ((axes.xaxis, states), (axes.yaxis, result.input_names)):
        shown = np.unique(np.linspace(0, len(names) - 1, min(len(names), 16)).astype(int))
        ticks.set_ticks(shown, [names[k] for k in shown])
    axes.tick_params(axis="x", labelrotation=60, labelsize=7)
    axes.tick_params(axis="y", labelsize=7)
    figure.colorbar(picture, ax=axes, label="largest gain (SI units)")


def _plane(axes: Axes, figure: Figure, t: Array, values: Array, *, continuous: bool) -> None:
    when = np.repeat(t, values.shape[1])
    flat = values.ravel()
    points = axes.scatter(flat.real, flat.imag, c=when, s=7, cmap="cividis_r", linewidths=0.0, zorder=2)
    low, high = axes.get_xlim(), axes.get_ylim()
    if continuous:
        axes.axvline(0.0, color=INK, linewidth=0.9)
        axes.axvspan(0.0, max(low[1], 1.0) * 10.0, color=GREY, alpha=0.15, linewidth=0.0)
    else:
        angle = np.linspace(0.0, 2.0 * np.pi, 2000)
        axes.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.9)
    axes.set_xlim(low[0], max(low[1], 0.05 * abs(low[0])) if continuous else max(low[1], 1.0 + 0.05 * (1.0 - low[0])))
    axes.set_ylim(high)
    unit = " (1/s)" if continuous else ""
    axes.set_xlabel(f"real part{unit}")
    axes.set_ylabel(f"imaginary part{unit}")
    axes.set_title("eigenvalues of A − B K", fontweight="bold")
    figure.colorbar(points, ax=axes, label="time (s)")


def _largest(axes: Axes, t: Array, values: Array, *, continuous: bool) -> None:
    sizes = values.real if continuous else np.abs(values)
    largest = sizes.max(axis=1)
    axes.plot(t, largest, color=BLUE, linewidth=1.4)
    axes.axhline(0.0 if continuous else 1.0, color=INK, linewidth=0.9, linestyle=(0, (5, 2)))
    axes.set_xlabel("time (s)")
    axes.set_ylabel("largest real part (1/s)" if continuous else "largest size")
    limit_time(axes, t)
