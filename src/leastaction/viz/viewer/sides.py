"""Which way is up for a mechanism, and from which side it is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array, as_array

_PARALLEL = 1e-6
_AXES = {sign + name: k for k, name in enumerate("xyz") for sign in ("", "-")}


def upward(mechanism: Mechanism, up: str | Sequence[float] | None, normal: Array | None) -> Array:
    """Return the unit vector that points up, (3,).

    ``up``: as it was asked for, an axis such as "y" or "-z", or three numbers. If it was not, it is against gravity;
    without gravity z, or y where z is the ``normal`` of a plane mechanism.

    Raises `ArgumentError`: what was asked for is no direction.
    """
    if isinstance(up, str):
        if up not in _AXES:
            raise ArgumentError(f"up: got {up!r}, expected one of {', '.join(sorted(_AXES))}, or three numbers")
        return np.asarray(np.eye(3)[_AXES[up]] * (-1.0 if up.startswith("-") else 1.0))
    if up is not None:
        given = as_array(up, "up", (3,))
        if not given.any():
            raise ArgumentError("up: got three zeros, expected a direction such as 'z' or (0, 1, 0)")
        return np.asarray(given / np.linalg.norm(given))
    for element in mechanism.elements.values():
        if element.down is not None:
            down = np.array(element.down)
            return np.asarray(-down / np.linalg.norm(down))
    flat = normal is not None and abs(normal[2]) > 1.0 - _PARALLEL
    return np.array([0.0, 1.0, 0.0]) if flat else np.array([0.0, 0.0, 1.0])


def plane_normal(mechanism: Mechanism, q: Array) -> Array | None:
    """Return the unit normal of the plane in which everything moves, (3,); None if there is no such plane.

    All joints turn about it and slide across it. ``q`` (nq,): any configuration, as the axes of such a mechanism stay.
    """
    turns, slides = [], []
    for joint in mechanism.tree.joints:
        v, w = joint.twist[:3], joint.twist[3:]
        pose = mechanism.frame_pose(q, mechanism.tree.frames[joint.frame].name)
        size = np.linalg.norm(w)
        if size < _PARALLEL * np.linalg.norm(v):
            slides.append(pose[:3, :3] @ v / np.linalg.norm(v))
        elif abs(v @ w) > _PARALLEL * size * max(float(np.linalg.norm(v)), 1e-12):
            return None  # a screw
        else:
            turns.append(pose[:3, :3] @ w / size)
    if turns:
        normal = turns[0]
    elif len(slides) > 1:
        _, s, axes = np.linalg.svd(np.array(slides))
        if s[1] < _PARALLEL or (len(s) > 2 and s[2] > _PARALLEL):
            return None
        normal = axes[2] if len(axes) > 2 else np.cross(*axes[:2])
    else:
        return None
    along = all(np.linalg.norm(np.cross(normal, turn)) < _PARALLEL for turn in turns)
    return normal if along and all(abs(normal @ slide) < _PARALLEL for slide in slides) else None


def upright(up: Array) -> Array:
    """Return the rotation (3, 3) that turns a direction to z, the shortest way; x stays to the right where it can."""
    x, y, z = np.eye(3)
    if up @ z > 1.0 - _PARALLEL:
        return np.eye(3)
    right = x if abs(up @ x) < 0.9 else y
    right = right - (right @ up) * up
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(up, right), up))


def side(normal: Array | None, turn: Array) -> tuple[float, float] | None:
    """Return azimuth and elevation (degrees) from which a plane is seen from its side; None for another plane.

    ``turn`` (3, 3): that of `upright`. Of the two sides the one on which the first axis in the plane points right.
    """
    if normal is None:
        return None
    n = turn @ normal
    if abs(n[2]) > 1e-3:  # a plane that lies on the floor is seen from above
        return (-90.0, 80.0) if abs(n[2]) > 1.0 - 1e-3 else None
    right = np.cross([0.0, 0.0, 1.0], n)  # of who stands where the normal points to
    n = n if right[np.argmax(np.abs(right))] > 0.0 else -n
    return float(np.degrees(np.arctan2(n[1], n[0]))), 3.0
