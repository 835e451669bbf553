"""Triangle meshes: the unit primitives that scenes are drawn with.

A vertex stands at ``p + w n``: ``p`` is scaled with the thing that is drawn, ``w n`` keeps its thickness ``w`` however
long that is. Most meshes have no ``n``; a capsule and a coil have.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen

Triangles = NDArray[np.int64]


@dataclass(frozen=True)
class Solid(Frozen):
    """A mesh: ``p`` (n, 3) places, ``triangles`` (m, 3) indices, ``n`` (n, 3) offsets by thickness, or None."""

    p: Array
    triangles: Triangles
    n: Array | None = None


def _surface(rows: int, columns: int, *, closed: bool) -> Triangles:
    """Return the triangles of a grid of rows by columns of vertices; columns meet where it is closed."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns if closed else columns - 1), indexing="ij")
    k = (j + 1) % columns
    a, b, c, d = i * columns + j, i * columns + k, (i + 1) * columns + k, (i + 1) * columns + j
    return np.stack((np.stack((a, b, c), -1), np.stack((a, c, d), -1))).reshape(-1, 3)


def _around(count: int) -> Array:
    """Return unit vectors around z, (count, 3)."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack((np.cos(angle), np.sin(angle), np.zeros(count)))


def _turned(profile: Array, columns: int) -> tuple[Array, Triangles]:
    """Return the surface of a profile of (radius, height) turned about z."""
    ring = _around(columns)
    p = profile[:, None, :1] * ring + profile[:, None, 1:] * np.array([0.0, 0.0, 1.0])
    return p.reshape(-1, 3), _surface(len(profile), columns, closed=True)


@cache
def box() -> Solid:
    """Return the cube of side 1."""
    p = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    # Each face has vertices of its own, as its edges are sharp.
    corners = np.concatenate([p[list(quad)] for quad in quads])
    index = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(6)])
    return Solid(corners, index)


@cache
def sphere() -> Solid:
    """Return the sphere of radius 1."""
    angle = np.linspace(-0.5, 0.5, 15) * np.pi
    return Solid(*_turned(np.column_stack((np.cos(angle), np.sin(angle))), 28))


@cache
def cylinder() -> Solid:
    """Return the cylinder of radius 1 along z, from -1/2 to 1/2."""
    low, high = [0.0, -0.5], [0.0, 0.5]
    parts = [np.array(part) for part in ([low, [1.0, -0.5]], [[1.0, -0.5], [1.0, 0.5]], [[1.0, 0.5], high])]
    return _joined([_turned(part, 32) for part in parts])


@cache
def cone() -> Solid:
    """Return the cone of radius 1 about z, with its base at 0 and its tip at 1."""
    return _joined(
        [_turned(np.array(part), 24) for part in ([[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]])]
    )


@cache
def capsule() -> Solid:
    """Return the bar along z from -1/2 to 1/2, round and of thickness w."""
    angle = np.concatenate((np.linspace(-0.5, 0.0, 6), np.linspace(0.0, 0.5, 6))) * np.pi
    n, triangles = _turned(np.column_stack((np.cos(angle), np.sin(angle))), 18)
    height = np.repeat(np.where(np.arange(len(angle)) < 6, -0.5, 0.5), 18)
    return Solid(np.column_stack((np.zeros((len(height), 2)), height)), triangles, n)


@cache
def coil() -> Solid:
    """Return the spring along z from -1/2 to 1/2, of radius 1 with straight ends and a wire of thickness w."""
    turns, end = 8.0, 0.12
    s = np.linspace(0.0, 1.0, 161)
    inner = np.clip((s - end) / (1.0 - 2.0 * end), 0.0, 1.0)
    radius = np.clip(np.minimum(s - 0.5 * end, 1.0 - 0.5 * end - s) / (0.5 * end), 0.0, 1.0)
    angle = 2.0 * np.pi * turns * inner
    out = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(len(s))))
    centre = radius[:, None] * out + np.outer(s - 0.5, [0.0, 0.0, 1.0])
    # A wire's cross-section is across it: along the radius and z on the turns, in the plane on the straight ends.
    side = np.where(radius[:, None] > 0.5, [0.0, 0.0, 1.0], np.cross([0.0, 0.0, 1.0], out))
    around = _around(7)[None]
    n = around[..., :1] * out[:, None] + around[..., 1:2] * side[:, None]
    p = np.repeat(centre, 7, axis=0)
    return Solid(p, _surface(len(s), 7, closed=True), n.reshape(-1, 3))


def _joined(parts: list[tuple[Array, Triangles]]) -> Solid:
    """Return surfaces as one mesh; their edges stay sharp."""
    starts = np.cumsum([0, *(len(p) for p, _ in parts[:-1])])
    return Solid(
        np.concatenate([p for p, _ in parts]),
        np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts, strict=True)]),
    )
