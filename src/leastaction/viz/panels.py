"""Panels under each other at the width of a page: one for a few lines of a unit, small ones where there are many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.viz.figures import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILION, at_least, heading, new_figure
from leastaction.viz.signals import Signal, axis_label, drawn_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH: Final = 8.0  # of a figure, inches: about 800 pixels on a page
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.78, 0.15, 0.34, 0.5  # around all panels, inches
HEADING: Final = 0.29  # a line above all panels, inches
_ACROSS, _DOWN, _BETWEEN = 0.5, 0.38, 0.62  # between panels, between rows of a group, between groups
_TALL, _SMALL = 1.45, 0.95  # heights of panels
_COLUMNS: Final = 4
_CHARACTERS: Final = 13.0  # of a name that an inch holds
_TOGETHER: Final = 4  # lines in one panel at the most
_LEAST: Final = 0.02  # of the largest range in a group: what moves less looks like it

# Told apart by the dashes where colours are not seen.
LINES: Final[tuple[dict[str, Any], ...]] = (
    {"color": BLUE, "linestyle": "-"},
    {"color": VERMILION, "linestyle": (0, (6, 2))},
    {"color": GREEN, "linestyle": (0, (6, 2, 1.2, 2))},
    {"color": INK, "linestyle": (0, (1.2, 1.6))},
    {"color": ORANGE, "linestyle": (0, (3, 1.2))},
    {"color": PURPLE, "linestyle": (0, (8, 2, 1.2, 2, 1.2, 2))},
)


@dataclass(frozen=True, kw_only=True)
class PanelRow:
    """Panels beside each other. ``starts``: whether a group begins with it, ``label``: its axis."""

    count: int
    height: float
    label: str = ""
    starts: bool = True
    columns: int = 0  # as wide as if there were so many


def stack(
    rows: Sequence[PanelRow], title: str, *, xlabel: str = "time (s)", headed: bool = False
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure and its panels, row by row, all over the same axis.

    The places are computed, not found by a layout engine, which takes longer than all the drawing. ``headed``: whether
    something stands above them even without a title.
    """
    top = _TOP + HEADING * (bool(title) + headed)
    gaps = [0.0, *(_BETWEEN if row.starts else _DOWN for row in rows[1:])]
    height = top + sum(row.height for row in rows) + sum(gaps) + _BOTTOM
    figure = new_figure(WIDTH, height, layout=None)
    panels: list[list[Axes]] = []
    edge, first = height - top, None
    for i, (row, gap) in enumerate(zip(rows, gaps, strict=True)):
        edge -= gap + row.height
        columns = row.columns or row.count
        width = (WIDTH - _LEFT - _RIGHT - (columns - 1) * _ACROSS) / columns
        line = []
        for j in range(row.count):
            place = (_LEFT + j * (width + _ACROSS)) / WIDTH, edge / height, width / WIDTH, row.height / height
            axes: Axes = figure.add_axes(place, sharex=first)
            first = first or axes
            below = i + 1 < len(rows) and rows[i + 1].count > j and not rows[i + 1].starts
            axes.tick_params(labelbottom=not below)
            if i + 1 == len(rows) or (not below and rows[i + 1].count <= j and not rows[i + 1].starts):
                axes.set_xlabel(xlabel)
            axes.locator_params(axis="y", nbins=4)
            axes.yaxis.set_major_formatter("{x:g}")
            line.append(axes)
        if row.label:
            line[0].set_ylabel(row.label)
            line[0].yaxis.set_label_coords(-0.56 / width, 0.5)
        panels.append(line)
    if title:
        heading(figure, title)
    return figure, panels


@dataclass(frozen=True, kw_only=True)
class Panel:
    """An empty panel and the signals that go into it. ``least``: the least range of its axis, as it is drawn."""

    axes: Axes
    signals: Sequence[Signal]
    least: float


def signal_panels(
    groups: Sequence[Sequence[Signal]], title: str, *, one_each: bool = False, headed: bool = False
) -> tuple[Figure, list[Panel]]:
    """Return a figure with a group of panels for each group of signals of one unit.

    A few signals share a panel, if not ``one_each``; many have small ones of their own.
    """
    rows: list[PanelRow] = []
    contents: list[list[Sequence[Signal]]] = []
    ranges: list[float] = []
    for group in groups:
        factor = drawn_unit(group[0].unit)[0]
        least = _LEAST * factor * max(float(np.ptp(signal.values)) for signal in group)
        label = axis_label(group[0].unit, group[0].kind)
        if len(group) == 1 or (len(group) <= _TOGETHER and not one_each):
            rows.append(PanelRow(count=1, height=_TALL, label=label))
            contents.append([group])
            ranges.append(least)
            continue
        columns = math.ceil(len(group) / math.ceil(len(group) / _COLUMNS))  # rows as long as each other
        for start in range(0, len(group), columns):
            part = group[start : start + columns]
            rows.append(PanelRow(count=len(part), height=_SMALL, label=label, starts=start == 0, columns=columns))
            contents.append([[signal] for signal in part])
            ranges.append(least)
    figure, lines = stack(rows, title, headed=headed)
    return figure, [
        Panel(axes=axes, signals=signals, least=least)
        for least, line, content in zip(ranges, lines, contents, strict=True)
        for axes, signals in zip(line, content, strict=True)
    ]


def draw_signals(panel: Panel) -> None:
    """Draw the signals of a panel, with their names on top."""
    for signal, look in zip(panel.signals, LINES, strict=False):
        draw_line(panel.axes, signal, label=signal.name, linewidth=1.3, zorder=3, **look)
    at_least(panel.axes, panel.least)
    name_lines(panel)


def name_lines(panel: Panel) -> None:
    """Write the name of the only signal, or the names of several beside their lines, above a panel."""
    if len(panel.signals) == 1:
        name, width = panel.signals[0].name, panel.axes.get_position().width * WIDTH
        fits = width * _CHARACTERS / len(name)
        panel.axes.set_title(name, fontweight="bold", fontsize=max(9.0 * min(1.0, fits), 5.5))
    else:
        legend_above(panel.axes)


def legend_above(axes: Axes, **options: Any) -> None:
    """Write a legend in one line above a panel, from its left edge."""
    handles, labels = axes.get_legend_handles_labels()
    style = {"handlelength": 2.6, "columnspacing": 1.4, "borderaxespad": 0.0, "borderpad": 0.1} | options
    axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=len(labels), **style)


def draw_line(axes: Axes, signal: Signal, values: Array | None = None, **look: Any) -> None:
    """Draw a signal, or other values at its instants."""
    t, shown = signal.drawn(values)
    axes.plot(t, shown, drawstyle="steps-post" if signal.held else "default", **look)


def limit_time(axes: Axes, t: Array) -> None:
    """Show these times and no others."""
    if len(t) > 1:
        axes.set_xlim(float(t[0]), float(t[-1]))


def by_unit(signals: Sequence[Signal]) -> list[list[Signal]]:
    """Return signals in groups of one unit, in the order in which units come first."""
    groups: dict[str, list[Signal]] = {}
    for signal in signals:
        groups.setdefault(signal.unit, []).append(signal)
    return list(groups.values())


def widen(axes: Axes, values: Sequence[float], part: float = 0.06) -> None:
    """Bring values into sight, with a little room beyond."""
    low, high = axes.get_ylim()
    inside = [value for value in values if np.isfinite(value)]
    if inside:
        low, high = min(low, *inside), max(high, *inside)
        room = part * (high - low)
        axes.set_ylim(low - room, high + room)
