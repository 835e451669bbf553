"""What a page is given: scenes as numbers, quantised and in base 64."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array
from leastaction.numerics.rotations import continued
from leastaction.viz.viewer import solids
from leastaction.viz.viewer.solids import Solid
from leastaction.viz.viewer.stage import Stage

_CODES: Final = 65535
_LINES: Final = {"string": solids.capsule, "rod": solids.capsule, "spring": solids.coil}


def page_data(stages: Sequence[Stage]) -> dict[str, Any]:
    """Return what the page reads: the scenes side by side, and the meshes that they share."""
    meshes = _Meshes()
    panels = [_panel(stage, meshes, 1.0 / len(stages)) for stage in stages]
    size = max(stage.size for stage in stages)
    power = 10.0 ** math.floor(math.log10(size))
    first = stages[0].scene
    return {
        "panels": panels,
        "begin": min(float(stage.scene.t[0]) for stage in stages),
        "end": max(float(stage.scene.t[-1]) for stage in stages),
        "size": size,
        "grid": power * (0.25 if size < 2.5 * power else 0.5 if size < 5.0 * power else 1.0),
        "azimuth": math.radians(first.azimuth),
        "elevation": math.radians(first.elevation),
        "nearer": first.nearer,
        "meshes": meshes.encoded(),
    }


class _Meshes:
    """Meshes by what they are, each once; the page knows them by their places in the list."""

    def __init__(self) -> None:
        self._index: dict[int, int] = {}
        self._solids: list[Solid] = []
        for unit in (solids.capsule(), solids.cylinder(), solids.sphere(), solids.cone()):
            self.index(unit)

    def index(self, solid: Solid) -> int:
        if id(solid) not in self._index:
            self._index[id(solid)] = len(self._solids)
            self._solids.append(solid)
        return self._index[id(solid)]

    def encoded(self) -> list[dict[str, Any]]:
        found = []
        for solid in self._solids:
            low = solid.p.min(axis=0)
            step = np.maximum(np.ptp(solid.p, axis=0), 1e-9) / _CODES
            found.append(
                {
                    "low": low.tolist(),
                    "step": step.tolist(),
                    "p": _encode(np.rint((solid.p - low) / step), "<u2"),
                    "n": None if solid.n is None else _encode(np.rint(solid.n * 127.0), "<i1"),
                    "wide": len(solid.p) > _CODES,
                    "i": _encode(solid.triangles, "<u4" if len(solid.p) > _CODES else "<u2"),
                }
            )
        return found


def _panel(stage: Stage, meshes: _Meshes, share: float) -> dict[str, Any]:
    scene = stage.scene
    keep = stage.samples(share)
    times = scene.t[keep]
    used = {name for line in scene.bones for name in (line.start, line.end)} | {scene.followed, *scene.traces}
    used |= {name for cord in scene.cords for name in cord.path}
    points = {name: path[keep] for name, path in scene.points.items() if name in used}
    poses = {name: pose[keep] for name, pose in scene.poses.items()}
    ghost = {name: path[keep] for name, path in (scene.ghost or {}).items()}
    ghost_poses = {name: pose[keep] for name, pose in (scene.ghost_poses or {}).items()}
    everything = [*points.values(), *ghost.values()]
    everything += [pose[:, :3, 3] for pose in (*poses.values(), *ghost_poses.values())]
    cloud = np.stack(everything, axis=1)
    low = cloud.min(axis=(0, 1))
    step = np.maximum(np.ptp(cloud, axis=(0, 1)), 1e-6) / _CODES
    index = {name: i for i, name in enumerate(points)}
    place = {name: i for i, name in enumerate(poses)}
    ghost_index = {name: i for i, name in enumerate(ghost)}
    pulls = {c.name: scene.tension_at(c.name, times) for c in scene.cords if c.name in (scene.tension or {})}
    return {
        "title": scene.title,
        "t": _encode(times, "<f4"),
        "low": low.tolist(),
        "step": step.tolist(),
        "points": {"names": list(points), "codes": _places(points, low, step)},
        "poses": {"names": list(poses), **_attitudes(poses, low, step)},
        "ghost": {"names": list(ghost), "codes": _places(ghost, low, step)} if ghost else None,
        "ghostPoses": {"names": list(ghost_poses), **_attitudes(ghost_poses, low, step)} if ghost_poses else None,
        "solids": [
            [place[d.frame], meshes.index(d.solid), _rounded(d.matrix[:3].T), d.width, _rounded(d.colour)]
            for d in stage.drawn
        ],
        "bones": [[index[b.start], index[b.end], b.radius, b.color and _rounded(b.color)] for b in scene.bones],
        "ghostBones": [
            [ghost_index[bone.start], ghost_index[bone.end], bone.radius]
            for bone in scene.bones
            if bone.start in ghost_index and bone.end in ghost_index
        ],
        "cords": [
            [[index[name] for name in c.path], c.name, c.kind, meshes.index(_LINES.get(c.kind, solids.capsule)())]
            for c in scene.cords
        ],
        "tension": [_encode(pulls[c.name], "<f4") if c.name in pulls else None for c in scene.cords] if pulls else None,
        "top": scene.top_tension,
        "error": None if scene.error is None else _encode(scene.error[keep], "<f4"),
        "traces": [index[name] for name in scene.traces],
        "arrows": [
            [arrow.name, arrow.kind, _encode(arrow.place[keep], "<f4"), _encode(arrow.vector[keep], "<f4")]
            for arrow in scene.arrows
        ],
        "strongest": scene.strongest,
        "marks": [
            [mark.name, mark.kind, place[mark.frame], _rounded(mark.point), _rounded(mark.axis), list(mark.reach)]
            for mark in scene.marks
        ],
        "kinematics": scene.kinematics,
        "limits": [[limit.name, [list(span) for span in limit.spans]] for limit in scene.limits],
        "focus": index[scene.focus] if scene.focus else -1,
        "spot": stage.centre.tolist(),
        "floor": stage.floor,
        "middle": stage.floor + 0.5 * stage.height,
        "height": float(np.median(scene.points[scene.focus][:, 2]) if scene.focus else stage.centre[2]),
        "size": stage.size,
    }


def _places(paths: Mapping[str, Array], low: Array, step: Array) -> str:
    """Return positions as 16-bit codes, (samples, points, 3)."""
    return _encode(np.rint((np.stack(list(paths.values()), axis=1) - low) / step), "<u2")


def _attitudes(poses: Mapping[str, Array], low: Array, step: Array) -> dict[str, str]:
    """Return poses as codes of places and of unit quaternions [x, y, z, w], neighbours on the same side."""
    if not poses:
        return {"codes": "", "turns": ""}
    turns = np.stack([quaternions(pose[:, :3, :3]) for pose in poses.values()], axis=1)
    origins = {name: pose[:, :3, 3] for name, pose in poses.items()}
    return {"codes": _places(origins, low, step), "turns": _encode(np.rint(turns * 32767.0), "<i2")}


def quaternions(R: Array) -> Array:
    """Return the unit quaternions [x, y, z, w] of rotations (n, 3, 3); each is on the side of the one before."""
    from scipy.spatial.transform import Rotation

    return continued(np.asarray(Rotation.from_matrix(R).as_quat(), dtype=float))


def _rounded(values: Any) -> list[float]:
    return [float(f"{v:.7g}") for v in np.asarray(values, dtype=float).ravel()]


def _encode(values: Array | NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=dtype).tobytes()).decode("ascii")
