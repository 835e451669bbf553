"""A scene as one self-contained HTML page: no file from anywhere else, no WebGL, no server."""

from __future__ import annotations

import base64
import html
import json
import math
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array
from leastaction.numerics.files import write_text
from leastaction.viz.scene import Scene

# A screen shows 60 pictures a second and the page interpolates, so finer samples would only make it larger.
_SAMPLES_PER_SECOND: Final = 50.0
_CODES: Final = 65535


def animation_page(scene: Scene, *, azimuth: float = 50.0) -> str:
    """Return an HTML page that plays a scene in any browser, straight from the disk.

    The page turns with the mouse, zooms with the wheel, plays, pauses, slows down and scrubs; it shows the mechanism,
    its cords coloured by tension (slack ones dashed), the reference pose as a translucent ghost, the paths of chosen
    points, the time and the tracking error. Appending ``#t=2.5`` to its address opens it paused at 2.5 s;
    ``theme=dark`` and ``yaw=90`` work the same way.

    Parameters
    ----------
    scene
        What to draw.
    azimuth
        Direction from which the scene is first seen, degrees about the vertical from the x axis.

    Returns
    -------
    str
        The page. Positions are rounded to 1/65535 of the scene's size (0.2 mm for a scene of 12 m)
        and sampled at 50 Hz.
    """
    keep = _samples(scene.t)
    points = _stack(scene.points, keep)
    ghost = _stack(scene.ghost, keep) if scene.ghost else None
    cloud = points if ghost is None else np.concatenate((points, ghost), axis=1)
    low = cloud.min(axis=(0, 1))
    step = np.maximum(cloud.max(axis=(0, 1)) - low, 1e-6) / _CODES
    index = {name: i for i, name in enumerate(scene.points)}
    ghost_index = {name: i for i, name in enumerate(scene.ghost or {})}
    times = scene.t[keep]
    pulls = {cord.name: scene.tension_at(cord.name, times) for cord in scene.cords} if scene.tension else {}
    # The box of one pose, not of the whole path: the camera follows.
    extent = points.max(axis=1) - points.min(axis=1)
    height = float(points[..., 2].max() - scene.floor)
    size = max(float(np.linalg.norm(np.median(extent, axis=0))), height, 1e-3)
    data: dict[str, Any] = {
        "t": _encode(times, "<f4"),
        "low": low.tolist(),
        "step": step.tolist(),
        "points": {"names": list(index), "codes": _quantise(points, low, step)},
        "ghost": None if ghost is None else {"names": list(ghost_index), "codes": _quantise(ghost, low, step)},
        "bones": [[index[bone.start], index[bone.end], bone.radius] for bone in scene.bones],
        "ghostBones": [
            [ghost_index[bone.start], ghost_index[bone.end], bone.radius]
            for bone in scene.bones
            if bone.start in ghost_index and bone.end in ghost_index
        ],
        "cords": [[index[cord.start], index[cord.end], cord.name] for cord in scene.cords],
        "tension": [_encode(pull, "<f4") for pull in pulls.values()] if pulls else None,
        "top": max([1e-9, *(float(np.quantile(pull, 0.995)) for pull in pulls.values())]),
        "error": None if scene.error is None else _encode(scene.error[keep], "<f4"),
        "traces": [index[name] for name in scene.traces],
        "focus": index[scene.followed],
        "floor": scene.floor,
        "middle": scene.floor + 0.5 * height,
        "height": float(np.median(points[:, index[scene.followed], 2])),
        "size": size,
        "grid": 10.0 ** math.floor(math.log10(size))
        * (0.5 if size < 10.0 ** math.floor(math.log10(size)) * 5.0 else 2.0),
        "azimuth": math.radians(azimuth),
    }
    template = resources.files("leastaction.viz").joinpath("animation_page.html").read_text(encoding="utf-8")
    # Inside a script element only "<" could end the data early.
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    return template.replace("{{title}}", html.escape(scene.title)).replace("{{data}}", text)


def write_animation(scene: Scene, path: str | os.PathLike[str], *, azimuth: float = 50.0) -> Path:
    """Write `animation_page` to a file, whole or not at all.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; nothing was changed.
    """
    return write_text(path, animation_page(scene, azimuth=azimuth))


def _samples(t: Array) -> NDArray[np.intp]:
    """Return the indices of the times to keep: about 50 a second, first and last included."""
    count = min(t.size, max(2, math.ceil(float(t[-1] - t[0]) * _SAMPLES_PER_SECOND) + 1))
    moments = np.linspace(t[0], t[-1], count)
    right = np.clip(np.searchsorted(t, moments), 1, t.size - 1)
    return np.unique(np.where(moments - t[right - 1] < t[right] - moments, right - 1, right))


def _stack(paths: Mapping[str, Array], keep: NDArray[np.intp]) -> Array:
    """Return the kept positions as one array, (samples, points, 3)."""
    return np.stack([path[keep] for path in paths.values()], axis=1)


def _quantise(cloud: Array, low: Array, step: Array) -> str:
    """Return positions as 16-bit codes, base 64."""
    return _encode(np.rint((cloud - low) / step), "<u2")


def _encode(values: Array, dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=dtype).tobytes()).decode("ascii")
