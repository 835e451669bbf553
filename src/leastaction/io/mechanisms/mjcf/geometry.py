"""Mass properties of primitives and meshes of unit density, about their own axes.

Each is a `Moments`: how much there is (volume, or area of a shell), its centre, and the inertia about that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from leastaction.numerics.arrays import Array


@dataclass(frozen=True)
class Moments:
    """Volume (m^3) or area (m^2), centre (m) and inertia (3, 3) about it, at unit density."""

    amount: float
    center: Array
    inertia: Array


def _about(amount: float, moments: list[float]) -> Moments:
    return Moments(amount, np.zeros(3), np.diag(moments))


def solid(kind: str, size: Array) -> Moments:
    """Return the moments of a full primitive: half sizes as MuJoCo's, of a "capsule" radius and half length."""
    if kind == "sphere":
        v = 4.0 / 3.0 * np.pi * size[0] ** 3
        return _about(v, [0.4 * v * size[0] ** 2] * 3)
    if kind == "ellipsoid":
        v = 4.0 / 3.0 * np.pi * float(np.prod(size))
        xx, yy, zz = size**2
        return _about(v, [v / 5.0 * (yy + zz), v / 5.0 * (xx + zz), v / 5.0 * (xx + yy)])
    if kind == "box":
        v = 8.0 * float(np.prod(size))
        xx, yy, zz = size**2
        return _about(v, [v / 3.0 * (yy + zz), v / 3.0 * (xx + zz), v / 3.0 * (xx + yy)])
    r, h = float(size[0]), 2.0 * float(size[1])
    v = np.pi * r**2 * h
    across, axial = v * (3.0 * r**2 + h**2) / 12.0, v * r**2 / 2.0
    if kind == "cylinder":
        return _about(v, [across, across, axial])
    ends = 4.0 / 3.0 * np.pi * r**3  # both half balls; each has its centre 3/8 r beyond the cylinder's end
    across += ends * (0.4 * r**2 + h**2 / 4.0 + 3.0 / 8.0 * r * h)
    return _about(v + ends, [across, across, axial + 0.4 * ends * r**2])


def shell(kind: str, size: Array) -> Moments:
    """Return the moments of a primitive's surface; of an "ellipsoid" that between two of nearly the same size."""
    if kind == "ellipsoid":
        return _thin(size)
    if kind == "sphere":
        a = 4.0 * np.pi * size[0] ** 2
        return _about(a, [2.0 / 3.0 * a * size[0] ** 2] * 3)
    if kind == "box":
        x, y, z = size
        sides = [(0, 4.0 * y * z), (1, 4.0 * x * z), (2, 4.0 * x * y)]
        total, second = 0.0, np.zeros(3)
        for axis, area in sides:
            part = size**2 / 3.0
            part[axis] = size[axis] ** 2
            total, second = total + 2.0 * area, second + 2.0 * area * part
        return _about(total, list(second.sum() - second))
    r, h = float(size[0]), 2.0 * float(size[1])
    tube = 2.0 * np.pi * r * h
    across, axial = tube * (r**2 / 2.0 + h**2 / 12.0), tube * r**2
    if kind == "cylinder":
        lids = 2.0 * np.pi * r**2
        return _about(tube + lids, [across + lids * (r**2 / 4.0 + h**2 / 4.0)] * 2 + [axial + lids * r**2 / 2.0])
    ends = 4.0 * np.pi * r**2  # both half spheres; each has its centre r/2 beyond the cylinder's end
    across += ends * (2.0 / 3.0 * r**2 + h**2 / 4.0 + r * h / 2.0)
    return _about(tube + ends, [across, across, axial + 2.0 / 3.0 * ends * r**2])


def _thin(size: Array) -> Moments:
    outer, inner = solid("ellipsoid", size * (1.0 + 1e-6)), solid("ellipsoid", size * (1.0 - 1e-6))
    p = 1.6075  # Thomsen's approximation of the area, as MuJoCo's
    x, y, z = size**p
    area = 4.0 * np.pi * ((x * y + x * z + y * z) / 3.0) ** (1.0 / p)
    factor = area / (outer.amount - inner.amount)
    return Moments(area, np.zeros(3), (outer.inertia - inner.inertia) * factor)


MeshMass = Literal["convex", "exact", "legacy", "shell"]


def mesh(vertices: Array, triangles: npt.NDArray[np.int64], how: MeshMass) -> Moments:
    """Return the moments of a mesh: of what its surface encloses, of the surface, or as MuJoCo's legacy has it.

    ``how``: "exact" sums pyramids over the triangles, with sign; "legacy" without, so that what is hollow counts twice;
    "shell" takes the surface; for "convex" give the triangles of the hull.
    """
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1) / 2.0
    centers = corners.mean(axis=1)
    total = float(areas.sum())
    if total == 0.0:
        return Moments(0.0, np.zeros(3), np.zeros((3, 3)))
    middle = areas @ centers / total
    if how == "shell":
        second = _second(corners - middle, areas, 1.0 / 12.0)
        return Moments(total, middle, np.trace(second) * np.eye(3) - second)
    volumes = np.einsum("ij,ij->i", centers - middle, cross) / 6.0
    if how == "legacy":
        volumes = np.abs(volumes)
    volume = float(volumes.sum())
    if volume == 0.0:
        return Moments(0.0, middle, np.zeros((3, 3)))
    center = volumes @ (0.75 * centers + 0.25 * middle) / volume
    parts = np.einsum("ij,ij->i", centers - center, cross) / 6.0
    if how == "legacy":
        parts = np.abs(parts)
    second = _second(corners - center, parts, 1.0 / 20.0)
    return Moments(float(parts.sum()), center, np.trace(second) * np.eye(3) - second)


def _second(corners: Array, weights: Array, factor: float) -> Array:
    """Return the second moments of triangles, or of pyramids from the origin to them, of these weights."""
    sums = corners.sum(axis=1)
    each = np.einsum("nki,nkj->nij", corners, corners) + sums[:, :, None] * sums[:, None, :]
    second: Array = factor * np.einsum("n,nij->ij", weights, each)
    return second
