"""A motion as pictures beside each other."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.mechanics.description.shapes import Shape
from leastaction.mechanics.mechanism.trajectory import BaseTrajectory
from leastaction.numerics.arrays import as_array
from leastaction.numerics.public import public
from leastaction.viz.figures import heading, new_figure, styled
from leastaction.viz.panels import WIDTH
from leastaction.viz.signals import Source, check_source
from leastaction.viz.viewer.movies import Painted, png
from leastaction.viz.viewer.show import show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COUNT: Final = 4
_DPI: Final = 150  # pixels an inch of the pictures
_ASPECT: Final = 1.5  # width by height
_TITLE, _GAP = 0.42, 0.06  # inches


@public
@styled
def plot_poses(
    run: Source,
    times: npt.ArrayLike | None = None,
    *,
    reference: BaseTrajectory[Any] | npt.ArrayLike | None = None,
    shapes: Sequence[Shape] | None = None,
    traces: Sequence[str] = (),
    title: str = "",
) -> Figure:
    """Draw a motion as pictures beside each other, as `leastaction.show` does.

    Parameters
    ----------
    run : Trajectory, ContinuousTrajectory or OptimizationResult
        A run, or a result of a mechanism's system.
    times : array_like (n,), optional
        Times of the pictures (s); four, evenly over the run, if left out.
    reference : run or array_like (N+1, nq), optional
        Drawn pale behind it, as `leastaction.show` does.
    shapes : sequence of Shape, optional
        What frames look like, as of `leastaction.show`.
    traces : sequence of str, optional
        Frames whose paths are drawn.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        8 inches wide, each picture with its time.

    Raises
    ------
    ArgumentError
        For what is no run, a result that is of no mechanism, or times outside of the run.
    """
    from matplotlib.image import imread

    check_source(run, "plot_poses")
    begin, end = float(run.t[0]), float(run.t[-1])
    moments = np.linspace(begin, end, _COUNT) if times is None else as_array(times, "times", (None,))
    if not len(moments) or moments.min() < begin or moments.max() > end:
        raise ArgumentError(f"times: got {moments.tolist()}, expected some from {begin:g} to {end:g} s")
    scenes: Sequence[Any] = show(run, reference=reference, shapes=shapes, traces=traces).scenes
    top = _TITLE if title else 0.0
    width = (WIDTH - (len(moments) - 1) * _GAP) / len(moments)
    height = width / _ASPECT
    whole = top + height + 0.26
    figure = new_figure(WIDTH, whole, layout=None)
    size = round(width * _DPI), round(height * _DPI)
    for i, moment in enumerate(moments):
        picture = png(scenes, Painted(), at=float(moment), size=size)
        axes = figure.add_axes((i * (width + _GAP) / WIDTH, 0.0, width / WIDTH, height / whole))
        axes.imshow(imread(io.BytesIO(picture)), interpolation="lanczos")
        axes.set_axis_off()
        axes.set_title(f"{moment:.4g} s", loc="center")
    if title:
        heading(figure, title)
    return figure
