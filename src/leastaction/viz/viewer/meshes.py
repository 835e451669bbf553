"""Meshes of shapes: read from their files, and made of few enough triangles for a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics.arrays import Array
from leastaction.viz.viewer.collada import ColouredMesh, read_collada
from leastaction.viz.viewer.solids import Solid, Triangles

MOST_TRIANGLES = 90_000  # of all meshes of a page: about a megabyte of it
_FEWEST_TRIANGLES = 60  # of one mesh that had as many


def meshes_of(shape: Shape) -> tuple[ColouredMesh, ...]:
    """Return the pieces of a mesh in the axes of its shape, unscaled, each with its colour where the file has one.

    Raises `ArgumentError`: the file is not there, cannot be read, or nothing here reads its format.
    """
    if shape.vertices is not None and shape.triangles is not None:
        return (ColouredMesh(Solid(shape.vertices, np.asarray(shape.triangles, dtype=np.int64)), None),)
    assert shape.file is not None
    path = Path(shape.file)
    if not path.is_file():
        raise ArgumentError(
            f"the shape of {shape.frame!r} has its mesh in {path}, which is not there; give the folder of the meshes "
            "where the model is loaded (packages=), or leave the shape out"
        )
    return _read(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=256)
def _read(path: Path, _changed: int) -> tuple[ColouredMesh, ...]:
    """Read the meshes of a file."""
    if path.suffix.lower() == ".dae":
        return read_collada(path)
    try:
        import trimesh
    except ImportError as error:
        raise ArgumentError(
            f"{path.name}: meshes are read by trimesh, which is not installed. "
            "Install it (pip install 'leastaction[models]')"
        ) from error
    try:
        read: Any = trimesh.load(path, force="mesh", process=False)
        vertices, triangles = np.asarray(read.vertices, dtype=float), np.asarray(read.faces, dtype=np.int64)
    except Exception as error:  # whatever a reader says of a damaged file
        raise ArgumentError(f"{path}: this mesh cannot be read: {error}") from error
    if not len(triangles):
        raise ArgumentError(f"{path}: this mesh has no triangles")
    return (ColouredMesh(Solid(vertices, triangles), None),)


def decimated(meshes: Sequence[tuple[Solid, float]], most: int = MOST_TRIANGLES) -> list[Solid]:
    """Return meshes with at most so many triangles together, coarser all alike.

    ``meshes``: each with the length (m) of its unit. Vertices in the same cell of a grid become the one that lies best
    on the planes of the triangles there; the grid is as coarse as is needed, and as fine for all.
    """
    whole = [welded(solid) for solid, _ in meshes]
    if triangle_count(whole) <= most:
        return whole
    sizes = [
        float(np.linalg.norm(np.ptp(solid.p, axis=0))) * unit for solid, (_, unit) in zip(whole, meshes, strict=True)
    ]
    cell = max(sizes) / 200.0
    best = whole
    for _ in range(7):
        trial = [_within(solid, cell / unit) for solid, (_, unit) in zip(whole, meshes, strict=True)]
        count = triangle_count(trial)
        best = trial if count <= most or triangle_count(best) > most else best
        if 0.8 * most <= count <= most:
            break
        cell *= float(np.sqrt(count / (0.92 * most)))  # so many triangles cover a surface
    return best


def _within(solid: Solid, cell: float) -> Solid:
    """Return a mesh at a cell's size; one that would vanish keeps a few triangles."""
    found = _clustered(solid, cell)
    if len(found.triangles) < min(_FEWEST_TRIANGLES, len(solid.triangles)):
        return _clustered(solid, min(cell, float(np.linalg.norm(np.ptp(solid.p, axis=0))) / 12.0))
    return found


def welded(solid: Solid) -> Solid:
    """Return a mesh whose vertices at the same place are one, as files of loose triangles need; none is degenerate."""
    step = max(float(np.ptp(solid.p, axis=0).max()), 1e-12) * 1e-6
    return _merged(solid.p, np.rint((solid.p - solid.p.min(axis=0)) / step).astype(np.int64), solid.triangles)


def _clustered(solid: Solid, cell: float) -> Solid:
    """Return a mesh with the vertices of each cell merged, where the planes of its triangles meet best."""
    p, triangles = solid.p, solid.triangles
    keys = np.floor((p - p.min(axis=0)) / cell).astype(np.int64)
    _, place = np.unique(_packed(keys), return_inverse=True)
    count = int(place.max()) + 1
    a, b, c = (p[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)  # as long as twice the area, which weighs it
    area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(area, 1e-300)[:, None]
    total = np.stack([np.bincount(place, p[:, k], count) for k in range(3)], -1)
    mean = np.asarray(total / np.bincount(place, minlength=count)[:, None], dtype=float)
    H, g = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in range(3):
        at = place[triangles[:, corner]]
        off = np.sum(unit * (a - mean[at]), axis=1) * area
        for i in range(3):
            g[:, i] += np.bincount(at, off * unit[:, i], count)
            for j in range(3):
                H[:, i, j] += np.bincount(at, area * unit[:, i] * unit[:, j], count)
    trace = np.maximum(np.trace(H, axis1=1, axis2=2), 1e-300)
    H += 1e-2 * trace[:, None, None] * np.eye(3)
    moved = np.linalg.solve(H, g[..., None])[..., 0]
    return _merged((mean + np.clip(moved, -0.6 * cell, 0.6 * cell))[place], keys, triangles)


def _merged(p: Array, keys: Triangles, triangles: Triangles) -> Solid:
    """Return a mesh with one vertex for each key, and without the triangles that vanish."""
    _, first, place = np.unique(_packed(keys), return_index=True, return_inverse=True)
    moved = place[triangles]
    kept = (moved[:, 0] != moved[:, 1]) & (moved[:, 1] != moved[:, 2]) & (moved[:, 2] != moved[:, 0])
    moved = moved[kept]
    _, once = np.unique(_packed(np.sort(moved, axis=1)), return_index=True)
    moved = moved[np.sort(once)]
    used, index = np.unique(moved, return_inverse=True)
    return Solid(p[first][used], index.reshape(-1, 3))


def _packed(keys: Triangles) -> Triangles:
    """Return three whole numbers below 2^21 as one each."""
    return np.asarray((keys[:, 0] << 42) | (keys[:, 1] << 21) | keys[:, 2])


def triangle_count(solids: Iterable[Solid]) -> int:
    """Return how many triangles meshes have together."""
    return sum(len(solid.triangles) for solid in solids)
