"""Lengths and tensions of the strings, and the moments at which one would have to push."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.viz.figures import BLUE, GREEN, INK, VERMILION, Margins, at_least, heading, panel_grid, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPAN_METRES: Final = 0.1


@public
@styled
def plot_strings(
    t: ArrayLike, lengths: ArrayLike, tensions: ArrayLike, names: Sequence[str], *, title: str = "Strings"
) -> Figure:
    """Draw length and tension of each string.

    A distance constraint pushes as readily as it pulls, a string does not: where the tension is negative the real
    string would be slack, and the panel says so in red, with the share of the time.

    Parameters
    ----------
    t
        Times, (N+1,), s.
    lengths
        Lengths of the strings, (N+1, n), m.
    tensions
        Tensions, positive when the string pulls, (N, n) (one per step, drawn at the middle of the step) or (N+1, n), N.
    names
        Names of the strings.
    title
        Heading.

    Returns
    -------
    Figure
        One row per string: tension on the left and length on the right.

    Raises
    ------
    ArgumentError
        The shapes and names do not fit.
    """
    times, length, tension = (np.asarray(value, dtype=float) for value in (t, lengths, tensions))
    n = len(names)
    if length.shape != (times.size, n) or tension.shape not in ((times.size - 1, n), (times.size, n)) or n == 0:
        raise ArgumentError(
            f"lengths {length.shape} and tensions {tension.shape} do not fit {times.size} times and "
            f"{n} strings: expected "
            f"({times.size}, {n}) and ({times.size - 1}, {n})"
        )
    middles = times if len(tension) == times.size else 0.5 * (times[:-1] + times[1:])
    margins = Margins(across=1.1, down=0.36)
    ratios = (1.6, 1.0)
    figure, panels = panel_grid(n, 2, panel=(4.6, 1.0), margins=margins, width_ratios=ratios)
    for i, (name, (left, right)) in enumerate(zip(names, panels, strict=True)):
        pull = tension[:, i]
        slack = pull < 0.0
        for where, colour, alpha in ((~slack, BLUE, 0.15), (slack, VERMILION, 0.55)):
            left.fill_between(middles, 0.0, pull, where, color=colour, alpha=alpha, linewidth=0.0, interpolate=True)
        for begin, end in spans(middles, slack):
            left.axvspan(begin, end, color=VERMILION, alpha=0.13, linewidth=0.0)
        left.plot(middles, pull, color=BLUE, linewidth=1.2)
        left.plot(middles, np.where(slack, pull, np.nan), color=VERMILION, linewidth=1.6)
        left.axhline(0.0, color=INK, linewidth=0.7)
        # Zero is always in sight; a leg's and an arm's tensions differ tenfold, so each has its scale.
        low, high = min(0.0, float(pull.min())), max(0.1, float(pull.max()))
        left.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
        left.set_title(name, fontweight="bold")
        share = 100.0 * float(np.mean(slack))
        left.set_title(
            f"slack {share:.1f} % of the time" if share > 0.0 else f"never slack, least {pull.min():.1f} N",
            loc="right",
            color=VERMILION if share > 0.0 else INK,
        )
        left.yaxis.get_major_locator().set_params(nbins=4)
        right.plot(times, length[:, i], color=GREEN, linewidth=1.4)
        at_least(right, _SPAN_METRES)
        ends = [f"{end:.3f}" for end in (length[:, i].min(), length[:, i].max())]
        right.set_title(f"{' to '.join(dict.fromkeys(ends))} m", loc="right")
        right.yaxis.get_major_locator().set_params(nbins=4)
        right.margins(x=0.0)
        left.margins(x=0.0)
        left.set_ylabel("tension (N)")
        right.set_ylabel("length (m)")
        left.yaxis.set_label_coords(-0.55 / 5.66, 0.5)
        right.yaxis.set_label_coords(-0.6 / 3.54, 0.5)
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    heading(figure, title)
    return figure


def spans(times: Array, mask: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the intervals in which the mask holds, half a step wider so that one step shows."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    half = 0.5 * float(times[1] - times[0]) if times.size > 1 else 0.0
    return [(float(times[a]) - half, float(times[b - 1]) + half) for a, b in zip(edges[::2], edges[1::2], strict=True)]
