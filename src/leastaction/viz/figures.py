"""What all figures share: fonts, colour-blind-safe colours, a figure without pyplot, whole files."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import as_number
from leastaction.numerics.files import write_bytes
from leastaction.numerics.public import public

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")
R = TypeVar("R")

# Okabe and Ito's palette, https://jfly.uni-koeln.de/color/
BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
VERMILION: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
INK: Final = "#22262B"
GREY: Final = "#8A9099"
PALE: Final = "#C9CED6"

_STYLE: Final[dict[Any, Any]] = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.titlepad": 4.0,
    "axes.titley": 1.0,
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E6E9ED",
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "axes.prop_cycle": f"cycler('color', {[BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK]})",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.solid_capstyle": "round",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@contextmanager
def _style() -> Iterator[None]:
    import matplotlib as mpl

    with mpl.rc_context(_STYLE):
        yield


@public
def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Draw in this package's style and leave the caller's matplotlib settings as they were."""

    @wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        with _style():
            return draw(*args, **kwargs)

    return wrapper


@public
def new_figure(width: float, height: float, *, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """Return an empty figure of this size in inches, tied to no display and no global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Space around and between the panels of a grid, inches."""

    left: float = 0.75
    right: float = 0.15
    top: float = 0.65
    bottom: float = 0.5
    across: float = 0.6
    down: float = 0.4


def panel_grid(
    rows: int,
    columns: int,
    *,
    panel: tuple[float, float],
    margins: Margins,
    width_ratios: Sequence[float] | None = None,
) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure and its grid of panels, all over one time axis.

    The places are computed, not found by a layout engine, which takes longer than all the drawing.

    ``rows``, ``columns``: size of the grid. ``panel``: mean width and height of a panel, inches. ``margins``: space
    around and between them. ``width_ratios``: widths of the columns relative to each other.
    """
    width = margins.left + columns * panel[0] + (columns - 1) * margins.across + margins.right
    height = margins.top + rows * panel[1] + (rows - 1) * margins.down + margins.bottom
    figure = new_figure(width, height, layout=None)
    panels = figure.subplots(
        rows,
        columns,
        sharex=True,
        squeeze=False,
        width_ratios=width_ratios,
        gridspec_kw={
            "left": margins.left / width,
            "right": 1.0 - margins.right / width,
            "top": 1.0 - margins.top / height,
            "bottom": margins.bottom / height,
            "wspace": margins.across / panel[0],
            "hspace": margins.down / panel[1],
        },
    )
    return figure, panels


def heading(figure: Figure, text: str) -> None:
    """Write a heading into the upper left corner."""
    height = figure.get_size_inches()[1]
    figure.text(0.012, 1.0 - 0.1 / height, text, ha="left", va="top", fontsize=12)


def at_least(axes: Axes, span: float) -> None:
    """Widen the y range to ``span`` about its middle, so that noise does not fill the panel.

    The middle is a round number where that leaves all in sight, so that neighbours have the same ticks.
    """
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        tick = 0.25 * span
        if (rounded := tick * round(middle / tick)) - 0.5 * span <= low and high <= rounded + 0.5 * span:
            middle = rounded
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


@public
def save_png(figure: Figure | Sequence[Figure], path: str | os.PathLike[str], *, dpi: float = 150.0) -> Path:
    """Write a figure, or several under each other, as a PNG file, whole or not at all.

    Parameters
    ----------
    figure
        A figure of one of the ``plot_*`` functions, or any other; or several.
    path
        The file to write.
    dpi
        Dots per inch; a figure is 8 to 12 inches wide. Of several all become as wide as the widest.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; nothing was changed.
    """
    figures = list(figure) if isinstance(figure, Sequence) else [figure]
    if not figures:
        raise ArgumentError("save_png: got no figures, expected one at least")
    for each in figures:
        if not callable(getattr(each, "savefig", None)):
            raise ArgumentError(f"figure: got {type(each).__name__}, expected a figure, as `plot_run` returns one")
    as_number(dpi, "dpi", least=10.0, below=2000.0)
    buffer = io.BytesIO()
    with _style():
        if len(figures) == 1:
            figures[0].savefig(buffer, format="png", dpi=dpi, pil_kwargs={"compress_level": 3})
        else:
            _write_stacked(figures, buffer, dpi)
    return write_bytes(path, buffer.getvalue())


def _write_stacked(figures: Sequence[Figure], buffer: io.BytesIO, dpi: float) -> None:
    from matplotlib.image import imread, imsave

    images, inches = [], max(figure.get_size_inches()[0] for figure in figures)
    for figure in figures:  # all as wide as the widest
        one, wider = io.BytesIO(), inches / figure.get_size_inches()[0]
        figure.savefig(one, format="png", dpi=dpi * wider, pil_kwargs={"compress_level": 1})
        one.seek(0)
        images.append(imread(one)[:, :, :3])
    width = max(image.shape[1] for image in images)
    white = [np.pad(i, ((0, 0), (0, width - i.shape[1]), (0, 0)), constant_values=1.0) for i in images]
    imsave(buffer, np.vstack(white), format="png")
