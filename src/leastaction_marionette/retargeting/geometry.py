"""Directions, frames and rotation angles of many instants at once."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from leastaction.io import axis_rotation
from leastaction.numerics import Array


def unit(vector: Array) -> Array:
    """`vector` (..., 3) scaled to length one; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.asarray(vector / np.maximum(length, 1e-300), dtype=np.float64)


def angle_between(first: Array, second: Array) -> Array:
    """Angle (...) in radians between unit vectors (..., 3), accurate for small angles too."""
    apart = np.linalg.norm(first - second, axis=-1)
    together = np.linalg.norm(first + second, axis=-1)
    return np.asarray(2.0 * np.arctan2(apart, together), dtype=np.float64)


def smooth_step(value: Array, low: float, high: float) -> Array:
    """0 below `low`, 1 above `high`, a cubic with zero slope at both ends between."""
    share = np.clip((value - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def frame(x: Array, z: Array) -> Array:
    """Right-handed frames (F, 3, 3), axes in the columns.

    ``x`` (F, 3): direction to which the frame's x axis comes as near as possible; not along `z`. ``z`` (F, 3): the
    frame's z axis, of length one.
    """
    x = unit(x - z * np.sum(x * z, axis=1, keepdims=True))
    return np.stack([x, np.cross(z, x), z], axis=2)


def rotation_zyx(angles: Array) -> Array:
    """Rotations (F, 3, 3) Rz Ry Rx of angles rz, ry, rx (F, 3) in radians."""
    return axis_rotation(2, angles[:, 0]) @ axis_rotation(1, angles[:, 1]) @ axis_rotation(0, angles[:, 2])


def quaternions(rotation: Array) -> Array:
    """Unit quaternions (F, 4) of rotations (F, 3, 3), scalar first, without jumps from one to the next."""
    found = np.roll(Rotation.from_matrix(rotation).as_quat(), 1, axis=1)
    found[1:] *= np.cumprod(np.sign(np.sum(found[1:] * found[:-1], axis=1)))[:, None]
    return np.asarray(found)


def euler_zyx(rotation: Array) -> Array:
    """Angles rz, ry, rx (F, 3) in radians with R = Rz Ry Rx, continuous in time.

    Every rotation has two such triples, and full turns besides; each instant takes the one nearest
    to the instant before, the first one that with ry between -90 and 90 degrees. Where ry is 90
    degrees either way only rx -+ rz is determined, and rz stays where it was.

    ``rotation`` (F, 3, 3).
    """
    level = np.hypot(rotation[:, 0, 0], rotation[:, 1, 0])
    rz = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    ry = np.arctan2(-rotation[:, 2, 0], level)
    rx = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    angles = np.stack([rz, ry, rx], axis=1)
    for now in range(angles.shape[0]):
        before = angles[now - 1] if now else np.zeros(3)
        if level[now] < 1e-7:
            sign = np.sign(rotation[now, 2, 0])
            turn = np.arctan2(-sign * rotation[now, 0, 1], rotation[now, 1, 1])
            angles[now] = before[0], angles[now, 1], turn - sign * before[0]
        if now:
            first = angles[now]
            second = np.array([first[0] + np.pi, np.pi - first[1], first[2] + np.pi])
            both = np.stack([first, second])
            both -= 2.0 * np.pi * np.round((both - before) / (2.0 * np.pi))
            angles[now] = both[np.argmin(np.sum((both - before) ** 2, axis=1))]
    return angles
