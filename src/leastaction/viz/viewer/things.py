"""What of a stage is painted at a time: meshes placed in space, as the page paints them too (page/scene.js)."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.viz.scene import JointMark, Scene
from leastaction.viz.viewer import solids
from leastaction.viz.viewer.collada import Colour
from leastaction.viz.viewer.solids import Solid
from leastaction.viz.viewer.stage import Stage

_WOOD: Colour = (0.84, 0.66, 0.45, 1.0)
_METAL: Colour = (0.55, 0.58, 0.63, 1.0)


@dataclass(frozen=True)
class Look3D:
    """The colours of pictures, those of the page's two themes (page/style.css and page/view.js)."""

    sky: Array
    paper: Array
    line: Array
    soft: Colour
    accent: Colour
    slack: Colour
    ghost: Colour
    push: Colour
    reaction: Colour
    low: Array
    ambient: Array
    earth: Array
    shade: float


def _colour(text: str, alpha: float = 1.0) -> Colour:
    r, g, b = (int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return (r, g, b, alpha)


def _rgb(text: str) -> Array:
    return np.array(_colour(text)[:3])


LIGHT_LOOK = Look3D(
    sky=_rgb("#ffffff"),
    paper=_rgb("#f4f5f7"),
    line=_rgb("#c3c9d1"),
    soft=_colour("#626b77"),
    accent=_colour("#0072b2"),
    slack=_colour("#c2187e"),
    ghost=_colour("#009e73", 0.42),
    push=_colour("#d55e00"),
    reaction=_colour("#7b5bb5"),
    low=np.array([0.32, 0.48, 0.64]),
    ambient=np.array([0.54, 0.57, 0.62]),
    earth=np.array([0.27, 0.25, 0.24]),
    shade=0.2,
)
DARK_LOOK = Look3D(
    sky=_rgb("#20252d"),
    paper=_rgb("#14171c"),
    line=_rgb("#3d4551"),
    soft=_colour("#a3adb9"),
    accent=_colour("#56b4e9"),
    slack=_colour("#ff6ec7"),
    ghost=_colour("#2fd0a0", 0.42),
    push=_colour("#ff9d5c"),
    reaction=_colour("#b79cf0"),
    low=np.array([0.42, 0.6, 0.77]),
    ambient=np.array([0.42, 0.46, 0.54]),
    earth=np.array([0.14, 0.14, 0.15]),
    shade=0.4,
)
_HIGH = np.array([0.9, 0.62, 0.0])


@dataclass(frozen=True)
class Thing:
    """A mesh in space: ``A`` (3, 4) places it, ``width`` is that of its offsets, ``flat`` how little light does."""

    solid: Solid
    A: Array
    width: float
    colour: Colour
    flat: float = 0.0

    @cached_property
    def turn(self) -> Array:
        """What turns its normals, (3, 3)."""
        if self.solid.n is None:
            x, y, z = self.A[:, :3].T
            sign = np.sign(x @ np.cross(y, z)) or 1.0
            return sign * np.column_stack((np.cross(y, z), np.cross(z, x), np.cross(x, y)))
        lengths = np.linalg.norm(self.A[:, :3], axis=0)
        turn = self.A[:, :3] / np.maximum(lengths, 1e-300)
        if lengths[2] < 1e-9:
            turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])
        return np.asarray(turn)

    @cached_property
    def vertices(self) -> Array:
        """Where its vertices are, (n, 3)."""
        placed = self.solid.p @ self.A[:, :3].T + self.A[:, 3]
        return placed if self.solid.n is None else placed + self.width * self.solid.n @ self.turn.T

    @cached_property
    def normals(self) -> Array:
        """Normals at its vertices, (n, 3): the sum of those of the triangles around, by their areas."""
        if self.solid.n is not None:
            return np.asarray(self.solid.n @ self.turn.T)
        p, index = self.solid.p, self.solid.triangles
        f = np.cross(p[index[:, 1]] - p[index[:, 0]], p[index[:, 2]] - p[index[:, 0]])
        n = np.stack([sum(np.bincount(index[:, c], f[:, k], len(p)) for c in range(3)) for k in range(3)], -1)
        turned = n @ self.turn.T
        return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1), 1e-300)[:, None])


def between(a: Array, b: Array, thick: float = 1.0) -> Array:
    """Return the placement (3, 4) from a to b along z, so thick across."""
    d = b - a
    size = float(np.linalg.norm(d))
    z = d / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack((thick * x, thick * np.cross(z, x), d, 0.5 * (a + b)))


def at_time(values: Array, t: Array, time: float) -> Array:
    """Return what is known at times (n, ...) at another, on straight lines."""
    k = int(np.clip(np.searchsorted(t, time, side="right") - 1, 0, max(len(t) - 2, 0)))
    if len(t) == 1:
        return np.asarray(values[0])
    w = float(np.clip((time - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0))
    return np.asarray(values[k] * (1.0 - w) + values[k + 1] * w)


def pose_at(poses: Array, t: Array, time: float) -> Array:
    """Return a pose (4, 4) at a time; the rotation between two is made orthogonal again."""
    pose = at_time(poses, t, time)
    u, _, v = np.linalg.svd(pose[:3, :3])
    pose = pose.copy()
    pose[:3, :3] = u @ v
    return pose


def bodies(stage: Stage, time: float, *, ghost: Colour | None = None) -> list[Thing]:
    """Return the shapes and bones at a time, or those of the reference."""
    scene, t = stage.scene, stage.scene.t
    poses = scene.poses if ghost is None else scene.ghost_poses or {}
    points = scene.points if ghost is None else scene.ghost or {}
    flat = 0.0 if ghost is None else 0.5
    now = {name: pose_at(pose, t, time) for name, pose in poses.items()}
    found = [
        Thing(d.solid, (now[d.frame] @ d.matrix)[:3], d.width, ghost or d.colour, flat)
        for d in stage.drawn
        if d.frame in now
    ]
    for bone in scene.bones:
        if bone.start in points and bone.end in points:
            a, b = (at_time(points[name], t, time) for name in (bone.start, bone.end))
            found.append(Thing(solids.capsule(), between(a, b), bone.radius, ghost or bone.color or _WOOD, flat))
    return found


def cords(stage: Stage, time: float, look: Look3D, thin: Callable[[Array, float], float]) -> list[Thing]:
    """Return strings and springs at a time. ``thin(place, pixels)``: half the thickness of what is so many thick."""
    scene, size = stage.scene, stage.size
    top = scene.top_tension
    found = []
    for cord in scene.cords:
        known = cord.name in (scene.tension or {})
        pull = float(scene.tension_at(cord.name, np.array([time]))[0]) if known else 0.0
        part = float(np.clip(pull / top, 0.0, 1.0))
        slack = known and pull < 0.0 and cord.kind in ("string", "motor")
        shade = part if cord.kind == "string" else min(abs(pull) / top, 1.0)
        r, g, b = look.low + shade * (_HIGH - look.low)
        colour = look.slack if slack else (r, g, b, 1.0) if known else look.soft if cord.kind == "string" else _METAL
        places = [at_time(scene.points[name], scene.t, time) for name in cord.path]
        for a, b in itertools.pairwise(places):
            line = thin(0.5 * (a + b), 1.6 + 1.8 * part if known else 1.8)
            found += cord_things(cord.kind, a, b, line, size, colour, slack=slack)
        if cord.kind == "string":
            for place, pixels in ((places[-1], 8.0), (places[0], 4.4)):
                ball = np.column_stack((thin(place, pixels) * np.eye(3), place))
                found.append(Thing(solids.sphere(), ball, 0.0, colour, 0.55))
    return found


def cord_things(kind: str, a: Array, b: Array, line: float, size: float, colour: Colour, *, slack: bool) -> list[Thing]:
    """Return one piece of a cord."""
    if kind == "spring":
        return [Thing(solids.coil(), between(a, b, 0.028 * size), max(0.0045 * size, 0.8 * line), colour)]
    if kind == "rod":
        return [Thing(solids.capsule(), between(a, b), max(0.006 * size, line), colour)]
    if kind == "string":
        if not slack:
            return [Thing(solids.capsule(), between(a, b), line, colour, 0.55)]
        dashes = max(2, int(np.linalg.norm(b - a) / (12.0 * line)))
        ends = [(a + k / dashes * (b - a), a + (k + 0.55) / dashes * (b - a)) for k in range(dashes)]
        return [Thing(solids.capsule(), between(*each), line, colour, 0.55) for each in ends]
    middle = between(a + 0.3 * (b - a), a + 0.65 * (b - a), (0.026 if kind == "motor" else 0.018) * size)
    return [
        Thing(solids.capsule(), between(a, b), max(0.006 * size, line), colour),
        Thing(solids.cylinder(), middle, 0.0, colour),
    ]


def _axis(stage: Stage, mark: JointMark, time: float) -> tuple[Array, Array]:
    """Return a point and the direction of a joint's axis at a time."""
    pose = pose_at(stage.scene.poses[mark.frame], stage.scene.t, time)
    return pose[:3, :3] @ mark.point + pose[:3, 3], pose[:3, :3] @ mark.axis


def rails(stage: Stage, time: float) -> list[Thing]:
    """Return the rails of slides."""
    found = []
    for mark in stage.scene.marks:
        if mark.kind == "slide":
            p, d = _axis(stage, mark, time)
            ends = p + mark.reach[0] * d, p + mark.reach[1] * d
            found.append(Thing(solids.capsule(), between(*ends), 0.0055 * stage.size, _METAL))
    return found


def joints(stage: Stage, time: float, look: Look3D) -> list[Thing]:
    """Return the other joints, and their axes."""
    r = 0.011 * stage.size
    found = []
    for mark in stage.scene.marks:
        p, d = _axis(stage, mark, time)
        if mark.kind == "ball":
            found.append(Thing(solids.sphere(), np.column_stack((1.6 * r * np.eye(3), p)), 0.0, look.accent))
        elif mark.kind == "hinge":
            found.append(Thing(solids.cylinder(), between(p - 2 * r * d, p + 2 * r * d, r), 0.0, look.accent))
            found.append(Thing(solids.capsule(), between(p - 7 * r * d, p + 7 * r * d), 0.12 * r, look.accent, 0.6))
    return found


def arrows(stage: Stage, time: float, look: Look3D, thin: Callable[[Array, float], float]) -> list[Thing]:
    """Return forces, torques and reactions at a time; the strongest of each kind is 0.3 of the scene's size."""
    scene = stage.scene
    strongest, found = scene.strongest, []
    for each in scene.arrows:
        p = at_time(each.place, scene.t, time)
        v = at_time(each.vector, scene.t, time) * (0.3 * stage.size / strongest[each.kind])
        length = float(np.linalg.norm(v))
        if length < 1e-9:
            continue
        colour = look.reaction if each.kind == "reaction" else look.push
        r, d = thin(p, 3.2), v / length
        head = min(0.5 * length, 9.0 * r)
        found.append(Thing(solids.capsule(), between(p, p + v - head * d), r, colour, 0.5))
        for back in (1.0, 1.6) if each.kind == "torque" else (1.0,):
            base = p + v - back * head * d
            cone = between(base, base + head * d, 3.0 * r)
            cone[:, 3] = base
            found.append(Thing(solids.cone(), cone, 0.0, colour, 0.5))
    return found


def traces(stage: Stage, time: float, look: Look3D, thin: Callable[[Array, float], float]) -> list[Thing]:
    """Return the paths of the last 1.2 s, paler the older."""
    scene: Scene = stage.scene
    found = []
    times = np.linspace(max(time - 1.2, float(scene.t[0])), time, 49)
    for group, colour in ((scene.ghost or {}, look.ghost), (scene.points, look.accent)):
        for name in scene.traces:
            if name not in group or scene.t.size < 2:
                continue
            path = np.column_stack([np.interp(times, scene.t, column) for column in group[name].T])
            for s, (a, b) in enumerate(itertools.pairwise(path)):
                if np.linalg.norm(b - a) > 1e-7:
                    faded = (*colour[:3], 0.75 * (s + 1) / 48)
                    found.append(Thing(solids.capsule(), between(a, b), thin(b, 1.9), faded, 1.0))
    return found
