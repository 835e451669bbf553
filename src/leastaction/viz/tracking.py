"""Reference and achieved motion, joint by joint, and the error of each as numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import as_names
from leastaction.numerics.public import public
from leastaction.viz.figures import BLUE, ORANGE, Margins, at_least, heading, panel_grid, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS: Final = 4
# Smallest range of a panel, so that a joint that hardly moves looks like one.
_SPAN_DEGREES: Final = 10.0
_SPAN_METRES: Final = 0.1
_MARGINS: Final = Margins(left=1.2, across=0.85, down=0.38)


@public
@dataclass(frozen=True, kw_only=True)
class TrackingErrors:
    """How far each variable is from its reference.

    Parameters
    ----------
    names
        Names of the variables.
    units
        Unit of each error, ``"deg"`` or ``"m"``.
    rms, largest
        Root mean square over time, and the largest absolute error, in those units; one entry per variable.
    joint_rms
        Root mean square over time and over all angles, degrees; 0 without angles.
    over_time
        Root mean square over all angles at each time, (N+1,), degrees.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    rms: Array
    largest: Array
    joint_rms: float
    over_time: Array


def _checked(
    reference: npt.ArrayLike, achieved: npt.ArrayLike, names: Sequence[str], lengths: Sequence[str]
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Return both motions in degrees and metres and which columns are angles."""
    one, other = np.asarray(reference, dtype=float), np.asarray(achieved, dtype=float)
    if other.ndim != 2 or one.shape != other.shape or other.shape[1] != len(names):
        raise ArgumentError(
            f"reference {one.shape} and achieved {other.shape} must both be (N+1, {len(names)}): one column per name"
        )
    if unknown := [name for name in lengths if name not in names]:
        raise ArgumentError(f"lengths names {', '.join(unknown)}, which are not among {', '.join(names)}")
    angle = np.array([name not in lengths for name in names], dtype=bool)
    scale = np.where(angle, 180.0 / math.pi, 1.0)
    return one * scale, other * scale, angle


@public
def tracking_errors(
    reference: npt.ArrayLike, achieved: npt.ArrayLike, names: Sequence[str], *, lengths: Sequence[str] = ()
) -> TrackingErrors:
    """Measure the tracking error of each variable.

    Parameters
    ----------
    reference, achieved
        The two motions, (N+1, n), rad or m.
    names
        Names of the columns.
    lengths
        Names of the columns that are lengths (m); the others are angles.

    Returns
    -------
    TrackingErrors
        Errors in degrees and metres.

    Raises
    ------
    ArgumentError
        The shapes and names do not fit.
    """
    one, other, angle = _checked(reference, achieved, names, lengths)
    error = other - one
    squares = error[:, angle] ** 2
    over_time = np.sqrt(squares.mean(axis=1)) if angle.any() else np.zeros(len(error))
    return TrackingErrors(
        names=tuple(names),
        units=tuple("deg" if flag else "m" for flag in angle),
        rms=np.sqrt((error**2).mean(axis=0)),
        largest=np.abs(error).max(axis=0),
        joint_rms=float(np.sqrt(squares.mean())) if angle.any() else 0.0,
        over_time=over_time,
    )


@public
@styled
def plot_tracking(
    t: npt.ArrayLike,
    reference: npt.ArrayLike,
    achieved: npt.ArrayLike,
    names: Sequence[str],
    *,
    lengths: Sequence[str] = (),
    groups: Mapping[str, Sequence[str]] | None = None,
    title: str = "Tracking",
) -> Figure:
    """Draw reference and achieved motion as small panels, one per variable.

    Parameters
    ----------
    t
        Times, (N+1,), s.
    reference, achieved
        The two motions, (N+1, n), rad or m; angles are drawn in degrees.
    names
        Names of the columns.
    lengths
        Names of the columns that are lengths (m); the others are angles.
    groups
        Heading of each row of panels and the names in it. A row longer than four goes on in the next one. Without it,
        the variables follow each other in the order given. Variables in no group are not drawn.
    title
        Heading; the overall error is added.

    Returns
    -------
    Figure
        Panels with their rms errors as titles.

    Raises
    ------
    ArgumentError
        The shapes and names do not fit, or a group names an unknown variable.
    """
    times = np.asarray(t, dtype=float)
    one, other, angle = _checked(reference, achieved, names, lengths)
    if times.shape != (len(other),):
        raise ArgumentError(f"t has shape {times.shape}, expected ({len(other)},) as the motions")
    errors = tracking_errors(reference, achieved, names, lengths=lengths)
    rows = _rows(groups if groups is not None else {"": names}, names)
    columns = max(len(row) for _, row in rows)

    figure, panels = panel_grid(len(rows), columns, panel=(2.1, 1.15), margins=_MARGINS)
    for (label, row), line in zip(rows, panels, strict=True):
        for axes in line[len(row) :]:
            axes.set_axis_off()
        for name, axes in zip(row, line, strict=False):
            i = list(names).index(name)
            axes.plot(times, one[:, i], color=ORANGE, linewidth=2.6, alpha=0.9, label="reference")
            axes.plot(times, other[:, i], color=BLUE, linewidth=1.1, label="achieved")
            at_least(axes, _SPAN_DEGREES if angle[i] else _SPAN_METRES)
            axes.set_title(name, fontweight="bold")
            axes.set_title(f"rms {errors.rms[i]:.2f}°" if angle[i] else f"rms {errors.rms[i]:.4f} m", loc="right")
            axes.yaxis.set_major_formatter("{x:g}°" if angle[i] else "{x:g} m")
            axes.yaxis.get_major_locator().set_params(nbins=4)
            axes.margins(x=0.0)
        if label:
            place = -1.05 / 2.1, 0.5
            style = {"rotation": 90, "fontweight": "bold", "ha": "center", "va": "center"}
            line[0].text(*place, label, transform=line[0].transAxes, **style)
    _time_labels(panels, rows)
    heading(figure, _heading(title, errors))
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=2, borderaxespad=0.6)
    return figure


def _heading(title: str, errors: TrackingErrors) -> str:
    """Title with the overall angle error, where there are angles."""
    return f"{title}: rms {errors.joint_rms:.2f}° over all joint angles" if "deg" in errors.units else title


def _rows(groups: Mapping[str, Sequence[str]], names: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Break the groups into rows of panels."""
    rows: list[tuple[str, list[str]]] = []
    for label, members in groups.items():
        if unknown := [name for name in as_names(members, f"groups: {label!r}", "names") if name not in names]:
            raise ArgumentError(f"group {label!r} names {', '.join(unknown)}, which are not among {', '.join(names)}")
        rows.extend(
            (label if start == 0 else "", list(members[start : start + _COLUMNS]))
            for start in range(0, len(members), _COLUMNS)
        )
    if not rows:
        raise ArgumentError("there is nothing to draw: give at least one variable name")
    return rows


def _time_labels(panels: npt.NDArray[np.object_], rows: Sequence[tuple[str, list[str]]]) -> None:
    """Label the time axis under the lowest panel of each column."""
    for column in range(panels.shape[1]):
        lowest = max(k for k, (_, row) in enumerate(rows) if len(row) > column)
        axes: Axes = panels[lowest][column]
        axes.set_xlabel("time (s)")
        axes.tick_params(labelbottom=True)
