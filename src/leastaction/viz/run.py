"""States and inputs of a run over time, beside a reference, with limits and where they hold the motion back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.trajectory import BaseTrajectory
from leastaction.numerics.arrays import Array, as_wanted
from leastaction.numerics.public import public
from leastaction.optimal.limits.limit import Limit, checked_limits
from leastaction.optimal.result import OptimizationResult
from leastaction.systems.closed_loop import ClosedLoop
from leastaction.systems.rig import Played
from leastaction.viz.bounds import ACTIVE, LIMIT, DrawnBound, draw_bound, reported_bounds, stated_bounds
from leastaction.viz.figures import ORANGE, at_least, styled
from leastaction.viz.panels import (
    HEADING,
    LINES,
    Panel,
    by_unit,
    draw_line,
    limit_time,
    name_lines,
    signal_panels,
    widen,
)
from leastaction.viz.signals import Drawn, Key, Signal, check_source, chosen, drawn_unit, inputs_of, states_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WANTED: Final[dict[str, Any]] = {"color": ORANGE, "linewidth": 3.2, "alpha": 0.6, "linestyle": "-", "zorder": 2}

Reference = Drawn | tuple[npt.ArrayLike, npt.ArrayLike] | npt.ArrayLike | None


@public
@styled
def plot_run(
    run: Drawn | Mapping[str, Drawn],
    names: str | Sequence[str] | None = None,
    *,
    reference: Reference = None,
    limits: Sequence[Limit] = (),
    title: str = "",
) -> Figure:
    """Draw states and inputs over time, beside a reference, with limits drawn and shaded where they are active.

    Parameters
    ----------
    run : Trajectory, ContinuousTrajectory, OptimizationResult, Played or ClosedLoop, or a mapping of these
        What is drawn; `Played` is what a rig did, `ClosedLoop` what a controller made of its plant. Several runs by
        their labels are drawn over each other; names, limits and the time axis are those of the first.
    names : str or sequence of str, optional
        Of states and inputs, with wildcards, such as ``["theta", "finger.*"]``: variables and inputs if left out; of a
        result that is of no mechanism all states.
    reference : run, result, (x, u) or x, optional
        What was wanted, drawn broad and pale: found by name in a run or a result. Of arrays x has one row per instant
        and all states, or their first columns, such as the variables alone (N+1, nq); u is as the run's. NaN is where
        nothing was wanted; an instant between such is a dot.
    limits : sequence of Limit, optional
        Each `Bound` on what is drawn is drawn too, and the time is shaded in which the run is on it or beyond. Of a
        result that has limits theirs are drawn, and shaded where they hold the motion back.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        8 inches wide. A group of panels for each unit, inputs after states: up to four lines in one, or one panel for
        each. Angles are in degrees.

    Raises
    ------
    ArgumentError
        For what is no run, unknown names, or a reference of another shape.
    """
    runs = run if isinstance(run, Mapping) else {"run": run}
    if not runs:
        raise ArgumentError("plot_run: got no runs, expected one at least")
    for each in runs.values():
        check_source(each, "plot_run")
    run, *others = runs.values()
    states, inputs = states_of(run), inputs_of(run)
    selected = [*_shown_by_itself(run, states), *inputs]
    if names is not None:
        selected = chosen([*states, *inputs], names, "plot_run: names")
    wanted = _wanted(reference, states, inputs, len(run.t))
    if len(limits) == 0 and isinstance(run, OptimizationResult) and run.limits is not None:
        bounds = reported_bounds(run.limits, selected)
    else:
        bounds = stated_bounds(checked_limits(limits), [*states, *inputs])
    parts = [signal for signal in selected if signal not in inputs], [signal for signal in selected if signal in inputs]
    groups = [group for part in parts for group in by_unit(part)]
    marked = len(runs) > 1 or any(signal.key in {**wanted, **bounds} for signal in selected)
    compared = [{signal.key: signal for signal in (*states_of(other), *inputs_of(other))} for other in others]
    figure, panels = signal_panels(groups, title, one_each=marked, headed=marked)
    for panel in panels:
        _draw(panel, compared, wanted, bounds)
        limit_time(panel.axes, run.t)
    _explain(figure, panels, list(runs), wanted, bounds, has_title=bool(title))
    return figure


def _shown_by_itself(run: Drawn, states: list[Signal]) -> list[Signal]:
    """Return the states that are drawn if none are named: the variables of a mechanism."""
    m = getattr(run.system if isinstance(run, OptimizationResult) else run, "mechanism", None)
    return states if m is None else states[: m.nq]


def _wanted(reference: Reference, states: list[Signal], inputs: list[Signal], n: int) -> dict[Key, Signal]:
    """Return the reference by name."""
    if reference is None:
        return {}
    if isinstance(reference, BaseTrajectory | OptimizationResult | Played | ClosedLoop):
        return {signal.key: signal for signal in (*states_of(reference), *inputs_of(reference))}
    pairs = zip(reference, (states, inputs), strict=False) if isinstance(reference, tuple) else [(reference, states)]
    found: dict[Key, Signal] = {}
    for given, signals in pairs:
        rows = n if signals is states else len(signals[0].t) if signals else n - 1
        values = as_wanted(given, "plot_run: reference", (rows, None))
        if values.shape[1] > len(signals):
            raise ArgumentError(
                f"plot_run: reference: got {values.shape[1]} columns, expected those of {len(signals)} "
                f"{'states' if signals is states else 'inputs'} at most: {', '.join(s.name for s in signals[:8])} ..."
            )
        columns = [(s, column) for s, column in zip(signals, values.T, strict=False) if not np.isnan(column).all()]
        found |= {s.key: replace(s, values=column) for s, column in columns}
    return found


def _lonely(values: Array) -> list[int]:
    """Return the instants at which something is wanted, but not before and after."""
    there = np.concatenate([[False], ~np.isnan(values), [False]])
    return np.flatnonzero(there[1:-1] & ~there[:-2] & ~there[2:]).tolist()


def _draw(
    panel: Panel,
    compared: list[dict[Key, Signal]],
    wanted: Mapping[Key, Signal],
    bounds: Mapping[Key, list[DrawnBound]],
) -> None:
    for signal, look in zip(panel.signals, LINES, strict=False):
        # Of another mechanism the unit may not be known.
        if (other := wanted.get(signal.key)) is not None:
            lonely = _lonely(other.values)
            draw_line(panel.axes, replace(other, unit=signal.unit), marker="o", markevery=lonely, **_WANTED)
        draw_line(panel.axes, signal, label=signal.name, linewidth=1.3, zorder=3, **look)
        for known, another in zip(compared, LINES[1:], strict=False):
            if signal.key in known:
                same = replace(known[signal.key], unit=signal.unit)
                # Above the first: dashes leave a line below them to be seen, a line leaves no dashes.
                draw_line(panel.axes, same, linewidth=1.2, zorder=3.2, **another)
    at_least(panel.axes, panel.least)
    for signal in panel.signals:
        factor = drawn_unit(signal.unit)[0]
        lines = bounds.get(signal.key, [])
        for bound in lines:
            draw_bound(panel.axes, bound, factor)
        if lines:
            widen(panel.axes, [value for bound in lines for value in factor * bound.values])
    name_lines(panel)


def _explain(
    figure: Figure,
    panels: list[Panel],
    runs: list[str],
    wanted: Mapping[Key, Signal],
    bounds: Mapping[Key, list[DrawnBound]],
    *,
    has_title: bool,
) -> None:
    """Write once, above all panels, what is drawn beside the lines."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys = {signal.key for panel in panels for signal in panel.signals}
    handles: list[Line2D | Patch] = []
    if keys & set(wanted):
        handles.append(Line2D([], [], **{**_WANTED, "label": "reference"}))
    if handles or len(runs) > 1:
        handles += [Line2D([], [], label=label, **look) for label, look in zip(runs, LINES, strict=False)]
    shown = [bound for key in keys for bound in bounds.get(key, [])]
    if shown:
        handles.append(Line2D([], [], **{**LIMIT, "label": "limit"}))
    if any(bound.active.any() for bound in shown):
        handles.append(Patch(**{**ACTIVE, "label": "limit active"}))
    if handles:
        below = HEADING / figure.get_size_inches()[1] if has_title else 0.0
        corner = 1.0, 1.0 - below
        figure.legend(handles=handles, ncols=len(handles), loc="upper right", bbox_to_anchor=corner, borderaxespad=0.4)
