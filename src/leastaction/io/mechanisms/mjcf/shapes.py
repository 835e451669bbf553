"""What the bodies of an MJCF look like."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.io.mechanisms.mjcf.masses import PRIMITIVES, kind_of, size_of
from leastaction.io.mechanisms.mjcf.meshes import Meshes
from leastaction.io.mechanisms.mjcf.spec import pose_in_body
from leastaction.io.mechanisms.model import LeftOut
from leastaction.mechanics.description.shapes import Shape

_SHOWN = 3  # groups 0, 1 and 2 are for the eye, as MuJoCo's own viewer has it
_PLAIN = (0.5, 0.5, 0.5, 1.0)

Color = tuple[float, float, float, float]


def shapes_of(spec: Any, meshes: Meshes, bodies: Sequence[tuple[Any, str]], left_out: list[LeftOut]) -> list[Shape]:
    """Return the geoms that are meant to be seen, by the frame of their body; all of them if none is."""
    colors: dict[str, Color] = {material.name: _color(material.rgba) for material in spec.materials}
    every = [(geom, frame) for body, frame in bodies for geom in body.geoms]
    seen = [(geom, frame) for geom, frame in every if geom.group < _SHOWN] or every
    lost: dict[str, int] = {}
    shapes: list[Shape] = []
    for geom, frame in seen:
        shape = _shape(geom, frame, spec, meshes, colors, left_out)
        if shape is not None:
            shapes.append(shape)
        elif kind_of(geom) not in (*PRIMITIVES, "mesh"):
            lost[kind_of(geom)] = lost.get(kind_of(geom), 0) + 1
    left_out += [
        LeftOut(f"the look of {n} geoms of the kind {kind!r}", "no shape is like it") for kind, n in lost.items()
    ]
    return shapes


def _shape(
    geom: Any, frame: str, spec: Any, meshes: Meshes, colors: dict[str, Color], left_out: list[LeftOut]
) -> Shape | None:
    kind, pose, size = kind_of(geom), pose_in_body(geom, spec), size_of(geom)
    own = _color(geom.rgba)
    color = colors[geom.material] if own == _PLAIN and geom.material in colors else own
    if kind == "mesh":
        if geom.meshname not in meshes:
            return None
        at, scale = pose @ meshes.origin(geom.meshname), meshes.scale(geom.meshname)
        inline = meshes.inline(geom.meshname)
        file = None if inline is not None else meshes.file(geom.meshname)
        if inline is None and file is None:
            missing = LeftOut(f"mesh {meshes.wanted(geom.meshname)!r}", "the file was not found")
            if missing not in left_out:
                left_out.append(missing)
            return None
        vertices, triangles = (None, None) if inline is None else (inline.vertices, inline.triangles)
        return Shape(
            frame=frame, kind="mesh", size=scale, pose=at, color=color, file=file, vertices=vertices,
            triangles=triangles, name=geom.name,  # type: ignore[arg-type]
        )  # fmt: skip
    if kind not in PRIMITIVES or geom.meshname or size[0] <= 0.0:
        return None
    sizes = {
        "sphere": size[:1],
        "capsule": np.array([size[0], 2.0 * size[1]]),
        "cylinder": np.array([size[0], 2.0 * size[1]]),
        "ellipsoid": size,
        "box": 2.0 * size,
    }
    return Shape(frame=frame, kind=kind, size=sizes[kind], pose=pose, color=color, name=geom.name)  # type: ignore[arg-type]


def _color(rgba: Sequence[float]) -> Color:
    r, g, b, a = (round(float(part), 6) for part in rgba)
    return r, g, b, a
