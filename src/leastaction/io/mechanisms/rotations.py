"""Ball and free joints: the one place that knows how their rotations are written.

They have a unit quaternion (w, x, y, z) from the frame before the joint, and as velocity the angular velocity in the
axes of the link, which is how files write them too; or, where that is asked for, three angles about x, then y, then z.
"""

from __future__ import annotations

import numpy as np

from leastaction.io.mechanisms.parts import JointPart
from leastaction.io.mechanisms.poses import rotation_of
from leastaction.mechanics import ball, free
from leastaction.mechanics.description.branch import Branch
from leastaction.mechanics.description.frames import FrameOptions
from leastaction.numerics.arrays import Array
from leastaction.numerics.rotations import of_matrix

_SLIDES = (".x", ".y", ".z")
_ANGLES, _RATES, _QUATERNION = (".rx", ".ry", ".rz"), (".wx", ".wy", ".wz"), (".qw", ".qx", ".qy", ".qz")


def variables_of(joint: JointPart) -> tuple[str, ...]:
    """Return the variables of a ball or a free joint, in the order of the file's velocities."""
    return _named(joint, _RATES if joint.axes == "quaternion" else _ANGLES)


def coordinates_of(joint: JointPart) -> tuple[str, ...]:
    """Return the names of what a configuration holds of a ball or a free joint, in the order of the file."""
    return _named(joint, _QUATERNION if joint.axes == "quaternion" else _ANGLES)


def _named(joint: JointPart, turns: tuple[str, ...]) -> tuple[str, ...]:
    endings = _SLIDES + turns if joint.kind == "free" else turns
    return tuple(joint.name + ending for ending in endings)


def put(place: Branch, joint: JointPart, options: FrameOptions) -> Branch:
    """Put a ball or a free joint on a place and return the place behind it."""
    make = free if joint.kind == "free" else ball
    shifted = bool(joint.point.any())
    inner = FrameOptions(name=f"{joint.name}.pivot") if shifted else options
    if shifted:
        place = place.pose(translation=joint.point)
    place = place.put(make(joint.name, axes=joint.axes, **inner))
    return place.pose(translation=-joint.point, **options) if shifted else place


def size_in_file(joint: JointPart) -> int:
    """Return how many numbers the configuration of a joint takes in a file."""
    return {"hinge": 1, "slide": 1, "ball": 4, "free": 7}[joint.kind]


def configuration_of(joint: JointPart, numbers: Array) -> dict[str, float]:
    """Return the coordinates of a ball or a free joint from place (m) and quaternion as the file writes them."""
    return _at(joint, numbers[:-4], rotation_of(numbers[-4:]))


def velocity_of(joint: JointPart, q: dict[str, float], numbers: Array) -> dict[str, float]:
    """Return the velocities of the variables from that of the place and the angular velocity in the link."""
    names, turns = variables_of(joint), np.array(numbers[-3:], dtype=np.float64)
    if joint.axes != "quaternion":
        E = rates_to_angular(np.array([q[name] for name in names[-3:]]))
        turns = np.asarray(np.linalg.lstsq(E, turns, rcond=None)[0])
    return dict(zip(names, map(float, [*numbers[:-3], *turns]), strict=True))


def reference_of(joint: JointPart, pose: Array) -> dict[str, float]:
    """Return the coordinates where the link is as the file draws it; ``pose``: of the link, for a free joint."""
    return _at(joint, pose[:3, 3], pose[:3, :3]) if joint.kind == "free" else _at(joint, np.zeros(0), np.eye(3))


def _at(joint: JointPart, place: Array, R: Array) -> dict[str, float]:
    turns = of_matrix(R) if joint.axes == "quaternion" else angles_of(R)
    return dict(zip(coordinates_of(joint), map(float, [*place, *turns]), strict=True))


def angles_of(R: Array) -> Array:
    """Return the angles (a, b, c) of ``R = Rx(a) Ry(b) Rz(c)``."""
    b = np.arcsin(np.clip(R[0, 2], -1.0, 1.0))
    if abs(R[0, 2]) > 1.0 - 1e-12:  # the outer and the inner axis are one: all of the turn goes to the inner one
        return np.array([0.0, b, np.arctan2(R[1, 0], R[1, 1])])
    return np.array([np.arctan2(-R[1, 2], R[2, 2]), b, np.arctan2(-R[0, 1], R[0, 0])])


def rates_to_angular(angles: Array) -> Array:
    """Return E (3, 3) of the angular velocity ``w = E rates`` in the turned axes."""
    _, b, c = angles
    return np.array(
        [
            [np.cos(b) * np.cos(c), np.sin(c), 0.0],
            [-np.cos(b) * np.sin(c), np.cos(c), 0.0],
            [np.sin(b), 0.0, 1.0],
        ]
    )
