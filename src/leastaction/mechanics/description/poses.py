"""Constant poses: as a frame of a description, and of joints that do not move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.frames import Frame, bodies_of
from leastaction.numerics.arrays import Array, as_array, shape_of
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public

# A rotation matrix that was typed or stored with fewer digits than this is refused, not guessed at.
ROTATION_TOLERANCE = 1e-8
# One that was made orthonormal stays as it is: it comes back from a file bit by bit.
_ROUNDING = 1e-14


@public
def pose(
    matrix: ArrayLike | None = None,
    *,
    translation: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
    name: str | None = None,
    mass: float | None = None,
    com: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    bodies: Sequence[Body] = (),
) -> Frame:
    """Place a frame by a constant pose in its parent.

    Parameters
    ----------
    matrix : array_like, shape (4, 4), optional
        The homogeneous matrix that takes coordinates in the frame to coordinates in its parent. With neither
        this nor a translation or rotation, a frame that has a name or bodies coincides with its parent.
    translation : array_like, shape (3,), optional
        Origin of the frame in its parent (m), instead of a matrix.
    rotation : array_like, shape (3, 3), optional
        Axes of the frame in its parent as columns, instead of a matrix.
    name, mass, com, inertia, bodies
        As in `FrameOptions`.

    Raises
    ------
    DescriptionError
        If both forms or nothing at all is given, a number is not finite, or the rotation is not one. A rotation within
        1e-8 of orthonormal is taken as the nearest orthonormal one.
    """
    what = "pose" if name is None else f"pose {check_name(name, 'the name of a pose')!r}"
    if matrix is not None and (translation is not None or rotation is not None):
        raise DescriptionError(f"{what}: give either a matrix or translation= and rotation=, not both")
    if all(given is None for given in (matrix, translation, rotation, name, mass)) and not bodies:
        raise DescriptionError(
            f"{what}: give a 4x4 matrix, or translation= or rotation= or both; or a name= or a mass= for a "
            "frame that coincides with its parent"
        )
    placed = np.eye(4)
    if matrix is not None:
        placed = as_array(matrix, f"{what}: matrix", (4, 4), error=DescriptionError).copy()
        if not np.array_equal(placed[3], [0.0, 0.0, 0.0, 1.0]):
            raise DescriptionError(f"{what}: the last row of a pose is [0, 0, 0, 1], got {placed[3].tolist()}")
    if translation is not None:
        placed[:3, 3] = as_array(translation, f"{what}: translation", (3,), error=DescriptionError)
    if rotation is not None:
        advice = "a matrix; give angles as rz(yaw), ry(pitch), rx(roll)" if shape_of(rotation) == (3,) else ""
        placed[:3, :3] = as_array(rotation, f"{what}: rotation", (3, 3), meaning=advice, error=DescriptionError)
    placed[:3, :3] = _nearest_rotation(placed[:3, :3], what)
    placed.setflags(write=False)
    return Frame("pose", matrix=placed, name=name, bodies=bodies_of(what, mass, com, inertia, bodies))


def _nearest_rotation(rotation: Array, what: str) -> Array:
    # Numbers whose squares overflow are as far from a rotation as any.
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not error <= ROTATION_TOLERANCE:
        raise DescriptionError(
            f"{what}: the rotation is not orthonormal: R^T R differs from the identity by "
            f"{error:.2g}, more than {ROTATION_TOLERANCE:g}. Give more digits, or build it from rx, ry, rz"
        )
    if np.linalg.det(rotation) < 0.0:
        raise DescriptionError(f"{what}: the rotation has determinant -1: it is a reflection. Use right-handed axes")
    if error < _ROUNDING:
        return rotation
    left, _, right = np.linalg.svd(rotation)
    nearest: Array = left @ right
    return nearest


def constant_matrix(transform: str, value: float) -> Array:
    """Return the pose (4, 4) of a primitive transformation by a constant coordinate (m or rad)."""
    matrix = np.eye(4)
    axis = "xyz".index(transform[1])
    if transform[0] == "t":
        matrix[axis, 3] = value
    else:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = np.cos(value), np.sin(value)
        matrix[i, i] = matrix[j, j] = cosine
        matrix[i, j], matrix[j, i] = -sine, sine
    return matrix


def exponential(twist: Array, coordinate: float) -> Array:
    """Return the motion ``exp(hat(twist) coordinate)`` (4, 4) of a twist [v; w] by a constant coordinate."""
    v, w = twist[:3], twist[3:]
    rate = float(np.linalg.norm(w))
    matrix = np.eye(4)
    if rate == 0.0:
        matrix[:3, 3] = v * coordinate
        return matrix
    x, y, z = w / rate
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = rate * coordinate
    # 1 - cos without the cancellation at small angles.
    sine, versine = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
    matrix[:3, :3] += sine * K + versine * (K @ K)
    along = angle * np.eye(3) + versine * K + (angle - sine) * (K @ K)
    matrix[:3, 3] = along @ (v / rate)
    return matrix
