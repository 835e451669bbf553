"""glTF 2.0 (.glb): scenes with their motion, for other programs.

One node for each thing, with an animation where it moves. glTF has y up, and so has the root node's turn.
https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import itertools
import json
import struct
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array
from leastaction.numerics.rotations import continued
from leastaction.viz.scene import Scene
from leastaction.viz.viewer import things as placing
from leastaction.viz.viewer.collada import Colour
from leastaction.viz.viewer.page_data import quaternions
from leastaction.viz.viewer.solids import Solid
from leastaction.viz.viewer.stage import Stage, staged
from leastaction.viz.viewer.things import LIGHT_LOOK, Thing

_UPRIGHT: Final = [-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5))]  # z to y
_FLOAT, _INDEX = 5126, 5125


def glb(scenes: Sequence[Scene]) -> bytes:
    """Return scenes side by side as one binary glTF file, their bodies, strings and rails in motion."""
    writer = _Writer()
    stages = staged(scenes)
    apart = 0.0
    for i, stage in enumerate(stages):
        apart += 0.75 * (stage.size + stages[i - 1].size) if i else 0.0
        writer.add(stage, np.array([apart, 0.0, 0.0]))
    return writer.file()


def _lasting(stage: Stage, time: float) -> list[Thing]:
    """Return what is there all the time, in the same order at any time."""
    size = stage.size
    found = placing.bodies(stage, time) + placing.rails(stage, time)
    for cord in stage.scene.cords:
        places = [placing.at_time(stage.scene.points[name], stage.scene.t, time) for name in cord.path]
        for a, b in itertools.pairwise(places):
            found += placing.cord_things(cord.kind, a, b, 0.002 * size, size, LIGHT_LOOK.soft, slack=False)
    return found


class _Writer:
    """A file in the making: the JSON part and the binary one."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.nodes: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self.roots: list[int] = []
        self._known: dict[Any, int] = {}

    def add(self, stage: Stage, place: Array) -> None:
        """Add a stage, moved aside by a place."""
        keep = stage.samples()
        times = stage.scene.t[keep]
        poses = [_lasting(stage, float(time)) for time in times]
        clock = self._accessor((times - times[0])[:, None], "SCALAR") if len(times) > 1 else -1
        children = []
        for k, thing in enumerate(poses[0]):
            placed = np.array([_split(at[k]) for at in poses])  # (times, 10): place, turn, scale
            turns = continued(placed[:, 3:7])
            node = {
                "mesh": self._mesh(thing),
                "translation": placed[0, :3].tolist(),
                "rotation": turns[0].tolist(),
                "scale": placed[0, 7:].tolist(),
            }
            children.append(len(self.nodes))
            self.nodes.append(node)
            if clock < 0:
                continue
            for path, values in (("translation", placed[:, :3]), ("rotation", turns), ("scale", placed[:, 7:])):
                if np.ptp(values, axis=0).max() > 1e-6 * max(stage.size, 1.0):
                    self.channels.append(
                        {"sampler": len(self.samplers), "target": {"node": children[-1], "path": path}}
                    )
                    output = self._accessor(values, "VEC4" if path == "rotation" else "VEC3")
                    self.samplers.append({"input": clock, "output": output, "interpolation": "LINEAR"})
        self.roots.append(len(self.nodes))
        self.nodes.append(
            {"name": stage.scene.title, "rotation": _UPRIGHT, "translation": place.tolist(), "children": children}
        )

    def _mesh(self, thing: Thing) -> int:
        """Return the index of a thing's mesh in its colour; thickness is part of it, as nodes only scale."""
        shape = _scales(thing)
        length = round(float(np.linalg.norm(thing.A[:, 2])), 4)
        key = (id(thing.solid), round(thing.width, 9), length, thing.colour, *np.round(shape, 9).tolist())
        if key not in self._known:
            p, n, triangles = _cut(thing, shape)
            primitive = {
                "attributes": {"POSITION": self._accessor(p, "VEC3", bounds=True), "NORMAL": self._accessor(n, "VEC3")},
                "indices": self._accessor(triangles.reshape(-1, 1), "SCALAR", kind=_INDEX),
                "material": self._material(thing.colour),
            }
            self._known[key] = len(self.meshes)
            self.meshes.append({"primitives": [primitive]})
        return self._known[key]

    def _material(self, colour: Colour) -> int:
        if colour not in self._known:
            self._known[colour] = len(self.materials)
            linear = [c**2.2 for c in colour[:3]]
            surface = {"baseColorFactor": [*linear, colour[3]], "metallicFactor": 0.0, "roughnessFactor": 0.7}
            see_through = {"alphaMode": "BLEND"} if colour[3] < 1.0 else {}
            self.materials.append({"pbrMetallicRoughness": surface, "doubleSided": True, **see_through})
        return self._known[colour]

    def _accessor(self, values: NDArray[Any], kind_of: str, *, kind: int = _FLOAT, bounds: bool = False) -> int:
        content = np.ascontiguousarray(values, dtype="<f4" if kind == _FLOAT else "<u4")
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": content.nbytes})
        self.binary += content.tobytes()
        found = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(content), "type": kind_of}
        if bounds or kind_of == "SCALAR":
            found |= {"min": content.min(axis=0).tolist(), "max": content.max(axis=0).tolist()}
        self.accessors.append(found)
        return len(self.accessors) - 1

    def file(self) -> bytes:
        """Return the whole file."""
        content: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "leastaction"},
            "scene": 0,
            "scenes": [{"nodes": self.roots}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.binary)}],
        }
        if self.channels:
            content["animations"] = [{"name": "motion", "channels": self.channels, "samplers": self.samplers}]
        text = json.dumps(content, separators=(",", ":")).encode("utf-8")
        text += b" " * (-len(text) % 4)
        parts = b""
        for kind, part in ((b"JSON", text), (b"BIN\0", bytes(self.binary) + b"\0" * (-len(self.binary) % 4))):
            parts += struct.pack("<I", len(part)) + kind + part
        return struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts


def _factored(thing: Thing) -> tuple[Array, Array]:
    """Return the axes (3, 3), right-handed, and the scale (3,) of a thing's placement."""
    scale = np.linalg.norm(thing.A[:, :3], axis=0)
    axes = thing.A[:, :3] / np.maximum(scale, 1e-300)
    if scale[2] < 1e-9:
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    if np.linalg.det(axes) < 0.0:  # a mirrored mesh
        axes[:, 0], scale[0] = -axes[:, 0], -scale[0]
    return axes, scale


def _scales(thing: Thing) -> Array:
    """Return the part of a thing's scale that its mesh keeps for itself, (3,).

    That is the scale of a rigid thing; of a line between two points, which has offsets, its node stretches along z.
    """
    return _factored(thing)[1] * ([1.0, 1.0, 1.0] if thing.solid.n is None else [1.0, 1.0, 0.0])


def _cut(thing: Thing, shape: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return vertices, normals and triangles of a thing's mesh; at sharp edges each side has vertices of its own."""
    solid: Solid = thing.solid
    index = solid.triangles
    scale = np.where(shape != 0.0, shape, max(float(np.linalg.norm(thing.A[:, 2])), 1e-9))
    local = Thing(solid, np.column_stack((np.diag(scale), np.zeros(3))), thing.width, thing.colour)
    p, smooth = local.vertices, local.normals
    sharp = np.cross(p[index[:, 1]] - p[index[:, 0]], p[index[:, 2]] - p[index[:, 0]])
    sharp /= np.maximum(np.linalg.norm(sharp, axis=1), 1e-300)[:, None]
    corner = smooth[index]
    corner = np.where((np.einsum("ijk,ik->ij", corner, sharp) < 0.65)[..., None], sharp[:, None], corner)
    flat = np.concatenate((p[index], corner), axis=2).reshape(-1, 6)
    unique, place = np.unique(np.round(flat, 7), axis=0, return_inverse=True)
    normals = unique[:, 3:] / np.maximum(np.linalg.norm(unique[:, 3:], axis=1), 1e-300)[:, None]
    points = unique[:, :3].copy()
    if shape[2] == 0.0:
        points[:, 2] /= scale[2]
    return points, normals, place.reshape(-1, 3)


def _split(thing: Thing) -> Array:
    """Return place (3), turn as a quaternion (4) and scale (3) of a thing's node."""
    axes, scale = _factored(thing)
    own = [1.0, 1.0, 1.0] if thing.solid.n is None else [1.0, 1.0, max(scale[2], 1e-9)]
    return np.concatenate((thing.A[:, 3], quaternions(axes[None])[0], own))
