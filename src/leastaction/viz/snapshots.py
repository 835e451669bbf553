"""A strip of poses from one run: the still picture of an animation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_count, as_number
from leastaction.numerics.public import public
from leastaction.viz.figures import GREY, INK, PALE, PURPLE, Margins, heading, panel_grid, styled
from leastaction.viz.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WOOD_NEAR: Final = (0.90, 0.74, 0.54)
_WOOD_FAR: Final = (0.66, 0.48, 0.31)
_PALE_GREEN: Final = "#A6DCCB"
_WOOD_EDGE: Final = "#7A5532"
_LOW: Final = (0.32, 0.48, 0.64)
_HIGH: Final = (0.90, 0.62, 0.0)
_DASHES: Final = (0, (3, 2))


@public
@styled
def plot_snapshots(
    scene: Scene,
    *,
    count: int = 7,
    times: ArrayLike | None = None,
    azimuth: float = 30.0,
    elevation: float = 8.0,
    ceiling: float | None = None,
    title: str = "",
) -> Figure:
    """Draw several poses side by side, each with its cords and the reference pose behind it.

    Parameters
    ----------
    scene
        What to draw.
    count
        How many poses, evenly over the whole time.
    times
        The times of the poses, s, instead of ``count``.
    azimuth, elevation
        Direction from which it is seen, degrees: about the vertical from the x axis, and above the horizon.
    ceiling
        Height above the floor at which the picture ends, m; everything when None.
    title
        Heading, or none.

    Returns
    -------
    Figure
        One row of poses in a common scale, each with its time.

    Raises
    ------
    ArgumentError
        There is no pose to draw, or a time lies outside the scene.
    """
    as_count(count, "count", 0)
    as_number(azimuth, "azimuth")
    as_number(elevation, "elevation")
    if ceiling is not None:
        as_number(ceiling, "ceiling", above=0.0)
    moments = np.atleast_1d(
        np.linspace(scene.t[0], scene.t[-1], min(count, len(scene.t)))
        if times is None
        else as_array(times, "times", (None,), ())
    )
    if moments.size == 0 or moments.min() < scene.t[0] or moments.max() > scene.t[-1]:
        raise ArgumentError(
            f"the poses must be at one or more times in {scene.t[0]:g} to {scene.t[-1]:g} s, got {moments.tolist()}"
        )
    view = _view(math.radians(azimuth), math.radians(elevation))
    index = [int(np.abs(scene.t - time).argmin()) for time in moments]
    poses = [_flatten(scene, scene.points, k, view) for k in index]
    ghosts = [_flatten(scene, scene.ghost or {}, k, view) for k in index]
    floor = scene.floor * view[1][2]
    bottom = min(floor, *(p[1] for pose in poses for p in pose.values()))
    top = max(p[1] for pose in poses for p in pose.values())
    if ceiling is not None:
        top = min(top, floor + ceiling)
    sides = [side for pose in poses for side in _sides(scene, pose, top)]
    centre, reach = 0.5 * (max(sides) + min(sides)), 0.5 * (max(sides) - min(sides)) + 0.05
    pitch, margin = 1.9 * reach, 0.03 * (top - bottom)
    width, height = pitch * len(poses) + 0.25 * reach, top - bottom + 4.0 * margin
    inches = 11.9 / width
    room = 0.4 if title else 0.05
    figure, panels = panel_grid(
        1, 1, panel=(11.9, height * inches), margins=Margins(left=0.05, right=0.05, top=room, bottom=0.3)
    )
    axes = panels[0][0]
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-0.5 * pitch - 0.125 * reach, pitch * (len(poses) - 0.5) + 0.125 * reach)
    axes.set_ylim(bottom - 3.0 * margin, top + margin)
    axes.axhline(floor, color=PALE, linewidth=1.0, zorder=0)
    tensions = [scene.tension_at(cord.name, scene.t) for cord in scene.cords]
    strongest = max([1e-9, *(float(np.quantile(tension, 0.995)) for tension in tensions)])
    for i, (k, pose, ghost) in enumerate(zip(index, poses, ghosts, strict=True)):
        place = i * pitch - centre
        _draw_pose(axes, scene, pose, place, ghost=ghost)
        for cord in scene.cords:
            pull = float(scene.tension_at(cord.name, scene.t[k : k + 1])[0])
            known = scene.tension is not None
            ends = pose[cord.start], pose[cord.end]
            _draw_cord(axes, *ends, place, pull, strongest, known=known)
        label = f"{scene.t[k]:.2f} s"
        axes.text(i * pitch, bottom - 2.0 * margin, label, ha="center", va="center", color=INK)
    _legend(figure, scene, strongest)
    if title:
        heading(figure, title)
    return figure


def _legend(figure: Figure, scene: Scene, strongest: float) -> None:
    """Say under the poses what the colours mean."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Patch | Line2D] = []
    if scene.ghost:
        entries.append(Patch(facecolor=_PALE_GREEN, edgecolor="none", label="reference"))
    if scene.tension:
        entries += [
            Line2D([], [], color=_LOW, linewidth=0.8, label="tension 0 N"),
            Line2D([], [], color=_HIGH, linewidth=1.8, label=f"{strongest:.3g} N"),
            Line2D([], [], color=PURPLE, linewidth=0.8, linestyle=_DASHES, label="slack"),
        ]
    if entries:
        figure.legend(handles=entries, loc="lower center", ncols=len(entries), borderaxespad=0.3)


def _view(azimuth: float, elevation: float) -> Array:
    """Return the rows right, up and towards the viewer of an orthographic view."""
    c, s = math.cos(elevation), math.sin(elevation)
    return np.array(
        [
            [-math.sin(azimuth), math.cos(azimuth), 0.0],
            [-s * math.cos(azimuth), -s * math.sin(azimuth), c],
            [c * math.cos(azimuth), c * math.sin(azimuth), s],
        ]
    )


def _flatten(scene: Scene, points: Mapping[str, Array], k: int, view: Array) -> dict[str, Array]:
    """Return right, up and nearness of every point, seen from beside the followed point.

    Moving with that point over the ground keeps a walk away from the viewer from looking like a climb.
    """
    origin = scene.points[scene.followed][k] * (1.0, 1.0, 0.0)
    return {name: view @ (path[k] - origin) for name, path in points.items()}


def _sides(scene: Scene, pose: Mapping[str, Array], top: float) -> Iterator[float]:
    """Yield how far to the right everything reaches that is to be seen below the top."""
    for bone in scene.bones:
        for name in (bone.start, bone.end):
            yield pose[name][0] - bone.radius
            yield pose[name][0] + bone.radius
    for cord in scene.cords:
        a, b = pose[cord.start], pose[cord.end]
        share = 1.0 if b[1] <= top else (top - a[1]) / (b[1] - a[1])
        yield a[0] + max(0.0, share) * (b[0] - a[0])


def _draw_pose(
    axes: Axes, scene: Scene, pose: Mapping[str, Array], place: float, *, ghost: Mapping[str, Array]
) -> None:
    """Draw the reference pose as one flat shape and the bones from the farthest to the nearest."""
    from matplotlib.patches import Polygon

    for bone in scene.bones:
        if bone.start in ghost and bone.end in ghost:
            # An opaque pale green, so that overlapping limbs do not darken each other.
            outline = _capsule(ghost[bone.start], ghost[bone.end], 1.1 * bone.radius, place)
            axes.add_artist(Polygon(outline, facecolor=_PALE_GREEN, edgecolor="none", zorder=1))
    depth = {bone: float(pose[bone.start][2] + pose[bone.end][2]) for bone in scene.bones}
    near, far = max(depth.values(), default=0.0), min(depth.values(), default=0.0)
    for i, bone in enumerate(sorted(scene.bones, key=depth.__getitem__)):
        share = (near - depth[bone]) / max(near - far, 1e-9)
        outline = _capsule(pose[bone.start], pose[bone.end], bone.radius, place)
        colour = _between(_WOOD_NEAR, _WOOD_FAR, share)
        patch = Polygon(outline, facecolor=colour, edgecolor=_WOOD_EDGE, linewidth=0.6)
        patch.set_zorder(3.0 + i / (len(depth) + 1))
        axes.add_artist(patch)  # not add_patch, which looks for new limits each time


def _capsule(a: Array, b: Array, radius: float, place: float) -> Array:
    """Return the outline of a rounded bar between two points on the paper, (2 n, 2)."""
    angle = math.atan2(b[1] - a[1], b[0] - a[0])
    turn = angle + np.linspace(0.5 * math.pi, 1.5 * math.pi, 24)
    cap = radius * np.column_stack((np.cos(turn), np.sin(turn)))
    outline = np.concatenate((a[:2] + cap, b[:2] - cap))
    outline[:, 0] += place
    return outline


def _between(a: tuple[float, float, float], b: tuple[float, float, float], share: float) -> tuple[float, ...]:
    """Mix two colours."""
    return tuple(x + share * (y - x) for x, y in zip(a, b, strict=True))


def _draw_cord(
    axes: Axes, start: Array, end: Array, place: float, pull: float, strongest: float, *, known: bool
) -> None:
    """Draw one cord, coloured by its tension, dashed where slack."""
    share = min(1.0, max(0.0, pull / strongest))
    slack = known and pull < 0.0
    colour = PURPLE if slack else _between(_LOW, _HIGH, share) if known else GREY
    axes.plot(
        (start[0] + place, end[0] + place),
        (start[1], end[1]),
        color=colour,
        linewidth=0.8 + 1.0 * share,
        linestyle=_DASHES if slack else "-",
        zorder=5,
    )
    axes.plot(end[0] + place, end[1], "o", color=colour, markersize=2.5, zorder=5)
