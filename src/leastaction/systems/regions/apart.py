"""How far parts of space are apart: whether a point can be in both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from leastaction.numerics.arrays import Array


class ConvexSolid(NamedTuple):
    """Boxes along the axes, corners (n, 3), and all that is within a distance of them: a ball is that of a point."""

    low: Array
    high: Array
    radius: float = 0.0


class Side(NamedTuple):
    """One side of a plane, ``normal . p >= offset``, with a normal of length one."""

    normal: Array
    offset: float


class Hole(NamedTuple):
    """All but balls, with centres (n, 3)."""

    center: Array
    radius: float


Shape = ConvexSolid | Side | Hole


def apart(one: Shape, other: Shape) -> Array:
    """Return how far two parts of space are apart (n,); not above zero where they meet, by how much may be wrong."""
    for a, b in ((one, other), (other, one)):
        if isinstance(a, ConvexSolid) and isinstance(b, Hole):
            farthest = np.maximum(np.abs(a.low - b.center), np.abs(a.high - b.center))
            return np.asarray(b.radius - np.linalg.norm(farthest, axis=1) - a.radius)
        if isinstance(a, ConvexSolid) and isinstance(b, Side):
            corner = np.where(b.normal > 0.0, a.high, a.low)[:, b.normal != 0.0]
            return np.asarray(b.offset - corner @ b.normal[b.normal != 0.0] - a.radius)
    if isinstance(one, ConvexSolid) and isinstance(other, ConvexSolid):
        between = np.maximum(np.maximum(one.low - other.high, other.low - one.high), 0.0)
        return np.asarray(np.linalg.norm(between, axis=1) - one.radius - other.radius)
    if isinstance(one, Side) and isinstance(other, Side) and one.normal @ other.normal < -1.0 + 1e-12:
        return np.array([one.offset + other.offset])
    return np.array([-np.inf])
