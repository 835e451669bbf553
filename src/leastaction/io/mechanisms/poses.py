"""Poses from what files write: quaternions, roll-pitch-yaw, an axis that two points span."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array


def rotation_of(quaternion: ArrayLike) -> Array:
    """Return the rotation (3, 3) of a quaternion (w, x, y, z) of any length; of zeros, none."""
    given = np.asarray(quaternion, dtype=np.float64)
    length = float(np.linalg.norm(given))
    if length == 0.0:
        return np.eye(3)
    w, x, y, z = given / length
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def of_roll_pitch_yaw(angles: Sequence[float]) -> Array:
    """Return the rotation ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_of(translation: ArrayLike, rotation: Array) -> Array:
    """Return the pose (4, 4) of a place and a rotation."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.asarray(translation, dtype=np.float64)
    return pose


def along(direction: Array) -> Array:
    """Return the rotation of least angle that brings z to a direction of any length but zero."""
    axis = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    cosine = float(axis[2])
    if cosine < -1.0 + 1e-14:
        return np.diag([1.0, -1.0, -1.0])
    v = np.array([-axis[1], axis[0], 0.0])
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    turned: Array = np.eye(3) + K + K @ K / (1.0 + cosine)
    return turned
