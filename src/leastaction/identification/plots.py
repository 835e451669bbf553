"""Measurements over the motion that was found, and what is left of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from leastaction.viz.figures import BLUE, GREY, ORANGE, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 4  # columns
_WIDE = 48  # letters of the title over a column


@styled
def draw_residuals(residuals: Sequence[Mapping[str, Any]], title: str) -> Figure:
    """Draw what `Identification.plot` says, of the residuals of every experiment."""
    shown = [(label, each) for channels in residuals for label, each in list(channels.items())[:_MOST]][: 2 * _MOST]
    columns = min(len(shown), _MOST)
    rows = -(-len(shown) // columns)
    figure = new_figure(3.6 * columns + 1.0, 3.6 * rows)
    heights = [2.0, 1.0] * rows
    panels = figure.subplots(2 * rows, columns, squeeze=False, sharex=False, height_ratios=heights)
    for i, (label, each) in enumerate(shown):
        top, bottom = panels[2 * (i // columns)][i % columns], panels[2 * (i // columns) + 1][i % columns]
        top.plot(each.t, each.measured, ".", color=GREY, markersize=3, label="measured")
        top.plot(each.t, each.predicted, color=BLUE, linewidth=1.4, label="found")
        top.set_title(label, fontsize=10)
        bottom.axhspan(-2.0, 2.0, color=GREY, alpha=0.15, linewidth=0)
        bottom.plot(each.t, each.scaled, ".", color=ORANGE if each.is_coloured else GREY, markersize=3)
        bottom.set_xlabel("t (s)")
        reach = max(4.0, float(np.nanmax(np.abs(each.scaled))))
        bottom.set_ylim(-1.1 * reach, 1.1 * reach)
        if i % columns == 0:
            bottom.set_ylabel("residual / sigma")
        if i == 0:
            top.legend(loc="best")
    for i in range(len(shown), rows * columns):
        panels[2 * (i // columns)][i % columns].set_axis_off()
        panels[2 * (i // columns) + 1][i % columns].set_axis_off()
    figure.suptitle("\n".join(fill(line, _WIDE * columns) for line in title.splitlines()), fontsize=10)
    return figure
