"""A scene made ready for drawing: its shapes as meshes, and how large and how high it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics.arrays import Array
from leastaction.viz.scene import Scene
from leastaction.viz.viewer import solids
from leastaction.viz.viewer.collada import Colour
from leastaction.viz.viewer.meshes import decimated, meshes_of
from leastaction.viz.viewer.sampling import needed
from leastaction.viz.viewer.solids import Solid

_SAMPLE_BYTES = 1_100_000  # of all motion in a page
_SHARP = 1e-3  # of the scene's size: how far a straight line between two samples may be off
_NO_COLOURS = ((0.62, 0.66, 0.71, 1.0), (1.0, 1.0, 1.0, 1.0))  # what shapes have to which nobody gave a colour
_UNIT = {
    "box": solids.box, "sphere": solids.sphere, "ellipsoid": solids.sphere, "cylinder": solids.cylinder,
    "capsule": solids.capsule,
}  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """A mesh on a frame: ``matrix`` (4, 4) places it there, ``width`` is that of its offsets."""

    solid: Solid
    frame: str
    matrix: Array
    width: float
    colour: Colour


@dataclass(frozen=True)
class Stage:
    """A scene with the meshes of its shapes. Everything else is asked of the scene."""

    scene: Scene
    drawn: tuple[Drawn, ...]

    @cached_property
    def _cloud(self) -> Array:
        """Corners of all that is drawn at up to 60 instants, (instants, corners, 3)."""
        scene = self.scene
        k = np.unique(np.linspace(0, scene.t.size - 1, 60).astype(int))
        scenery: list[Array] = []
        radius: dict[str, float] = {}
        for bone in scene.bones:
            for name in (bone.start, bone.end):
                radius[name] = max(radius.get(name, 0.0), bone.radius)
        parts = [
            scene.points[name][k][:, None] + r * np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
            for name, r in radius.items()
        ]
        for each in self.drawn:
            low, high = each.solid.p.min(axis=0), each.solid.p.max(axis=0)
            corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
            pose = scene.poses[each.frame][k]
            place = corners @ each.matrix[:3, :3].T + each.matrix[:3, 3]
            found = place @ pose[:, :3, :3].transpose(0, 2, 1) + pose[:, None, :3, 3]
            if each.width:
                half = np.array([0.0, 0.0, each.width])
                found = np.concatenate((found - half, found + half), axis=1)
            (scenery if each.frame == scene.base else parts).append(found)
        parts += _beside(parts, scenery)
        for mark in scene.marks:
            if mark.kind == "slide":
                pose = scene.poses[mark.frame][k]
                ends = mark.point + np.outer(mark.reach, mark.axis)
                parts.append(ends @ pose[:, :3, :3].transpose(0, 2, 1) + pose[:, None, :3, 3])
        if not parts:
            parts = [path[k][:, None] for path in scene.points.values()]
        return np.concatenate(parts, axis=1)

    @cached_property
    def floor(self) -> float:
        """Height of the floor (m): as given, or just under the lowest of what is drawn."""
        return self.scene.ground if self.scene.ground is not None else float(self._cloud[..., 2].min())

    @cached_property
    def centre(self) -> Array:
        """The middle of the box of all that is drawn, (3,)."""
        return np.asarray(0.5 * (self._cloud.min(axis=(0, 1)) + self._cloud.max(axis=(0, 1))))

    @cached_property
    def height(self) -> float:
        """Height above the floor of the highest that is drawn, strings too (m)."""
        tops = [path[:, 2].max() for path in self.scene.points.values()]
        return max(float(max(self._cloud[..., 2].max(), *tops)) - self.floor, 0.0)

    @cached_property
    def size(self) -> float:
        """Size of what is drawn (m): of one pose, not of the whole path, as the camera follows."""
        points = np.stack(list(self.scene.points.values()), axis=1)
        extent = np.ptp(self._cloud, axis=1)
        whole = np.ptp(points, axis=1)
        spread = max(float(np.linalg.norm(np.median(e, axis=0))) for e in (extent, whole))
        return max(spread, self.height, 1e-3)

    def samples(self, share: float = 1.0) -> NDArray[np.intp]:
        """Return the instants that are worth drawing; ``share``: of the room for motion in a page."""
        scene = self.scene
        if scene.t.size < 3:
            return np.arange(scene.t.size)
        places = [np.concatenate(list(group.values()), axis=1) for group in (scene.points, scene.ghost or {}) if group]
        lever = 0.15 * self.size
        for group in (scene.poses, scene.ghost_poses or {}):
            places += [
                np.concatenate((pose[:, :3, 3], lever * pose[:, :3, 0], lever * pose[:, :3, 1]), axis=1)
                for pose in group.values()
            ]
        moving = np.concatenate(places, axis=1)
        moving = moving[:, np.ptp(moving, axis=0) > 0.5 * _SHARP * self.size]
        curves = [scene.tension_at(cord.name, scene.t) for cord in scene.cords] if scene.tension else []
        curves += [scene.error] if scene.error is not None else []
        curves += [part for arrow in scene.arrows for part in arrow.vector.T]
        told = np.column_stack(curves) if curves else np.empty((scene.t.size, 0))
        told = told[:, np.ptp(told, axis=0) > 0.0]
        count = len(scene.points) * 6 + len(scene.poses) * 14 + (len(scene.ghost or {})) * 6
        count += len(scene.ghost_poses or {}) * 14 + 4 * told.shape[1] + 4
        most = max(2, int(share * _SAMPLE_BYTES / (count * 4 / 3)))
        sharp = 1.0
        while True:
            tolerance = np.concatenate((np.full(moving.shape[1], _SHARP * self.size), 0.02 * np.ptp(told, axis=0)))
            keep = needed(scene.t, np.hstack((moving, told)), sharp * tolerance)
            if len(keep) <= most:
                return keep
            sharp *= 1.2 * (len(keep) / most) ** 2  # a curve is off by the square of the step


def staged(scenes: Sequence[Scene]) -> tuple[Stage, ...]:
    """Make scenes ready, their meshes decimated together.

    Raises `ArgumentError`: a mesh cannot be read.
    """
    found: dict[int, list[tuple[Solid, Colour | None]]] = {}
    read: dict[int, tuple[Solid, float]] = {}
    for scene in scenes:
        for shape in scene.shapes:
            if shape.kind == "mesh":
                pieces = meshes_of(shape)
                found[id(shape)] = [(piece.solid, piece.colour) for piece in pieces]
                for piece in pieces:
                    read[id(piece.solid)] = (piece.solid, float(np.abs(shape.size).max()))
    small = dict(zip(read, decimated(list(read.values())) if read else (), strict=True))
    return tuple(
        Stage(scene, tuple(each for shape in scene.shapes for each in _drawn(shape, found.get(id(shape), []), small)))
        for scene in scenes
    )


def _beside(parts: Sequence[Array], scenery: Sequence[Array]) -> list[Array]:
    """Return what of the scenery reaches no farther from all parts than these are large; all where there are none."""
    if not parts:
        return list(scenery)
    low = np.min([part.min(axis=(0, 1)) for part in parts], axis=0)
    high = np.max([part.max(axis=(0, 1)) for part in parts], axis=0)
    reach = float(np.linalg.norm(high - low))
    return [each for each in scenery if (each > low - reach).all() and (each < high + reach).all()]


def _drawn(shape: Shape, pieces: list[tuple[Solid, Colour | None]], small: dict[int, Solid]) -> list[Drawn]:
    """Return what a shape is drawn as."""
    scale, width = np.ones(3), 0.0
    if shape.kind in ("box", "ellipsoid", "mesh"):
        scale = shape.size
    elif shape.kind == "sphere":
        scale = np.full(3, shape.size[0])
    elif shape.kind == "cylinder":
        scale = shape.size[[0, 0, 1]]
    else:
        scale, width = np.array([1.0, 1.0, shape.size[1]]), float(shape.size[0])
    matrix = shape.pose @ np.diag([*scale, 1.0])
    if shape.kind != "mesh":
        return [Drawn(_UNIT[shape.kind](), shape.frame, matrix, width, shape.color)]
    return [
        Drawn(
            small[id(solid)], shape.frame, matrix, 0.0, colour if colour and shape.color in _NO_COLOURS else shape.color
        )
        for solid, colour in pieces
    ]
