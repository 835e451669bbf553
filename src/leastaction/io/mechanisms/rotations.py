"""Ball and free joints: the one place that knows how their rotations are written as variables.

They have three angles, about x, then y, then z. Files write them as unit quaternions (w, x, y, z), and their velocity
as angular velocity in the axes of the link.
"""

from __future__ import annotations

import numpy as np

from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.parts import JointPart
from leastaction.io.mechanisms.poses import rotation_of
from leastaction.mechanics import ball, free
from leastaction.mechanics.description.branch import Branch
from leastaction.mechanics.description.frames import FrameOptions
from leastaction.numerics.arrays import Array

_SLIDES = (".x", ".y", ".z")
_TURNS = (".rx", ".ry", ".rz")


def variables_of(joint: JointPart) -> tuple[str, ...]:
    """Return the variables of a ball or a free joint, in the order of the file's velocities."""
    endings = _SLIDES + _TURNS if joint.kind == "free" else _TURNS
    return tuple(joint.name + ending for ending in endings)


def put(place: Branch, joint: JointPart, options: FrameOptions) -> Branch:
    """Put a ball or a free joint on a place and return the place behind it."""
    make = free if joint.kind == "free" else ball
    shifted = bool(joint.point.any())
    inner = FrameOptions(name=f"{joint.name}.pivot") if shifted else options
    if shifted:
        place = place.pose(translation=joint.point)
    place = place.put(make(joint.name, **inner))
    return place.pose(translation=-joint.point, **options) if shifted else place


def size_in_file(joint: JointPart) -> int:
    """Return how many numbers the configuration of a joint takes in a file."""
    return {"hinge": 1, "slide": 1, "ball": 4, "free": 7}[joint.kind]


def configuration_of(joint: JointPart, numbers: Array) -> dict[str, float]:
    """Return the variables of a ball or a free joint from place (m) and quaternion as the file writes them."""
    values = [*numbers[:-4], *angles_of(rotation_of(numbers[-4:]))]
    return dict(zip(variables_of(joint), map(float, values), strict=True))


def velocity_of(joint: JointPart, q: dict[str, float], numbers: Array) -> dict[str, float]:
    """Return the rates of the variables from the velocity of the place and the angular velocity in the link."""
    names = variables_of(joint)
    E = rates_to_angular(np.array([q[name] for name in names[-3:]]))
    turns = np.linalg.lstsq(E, numbers[-3:], rcond=None)[0]
    return dict(zip(names, map(float, [*numbers[:-3], *turns]), strict=True))


def reference_of(joint: JointPart, pose: Array) -> dict[str, float]:
    """Return the variables where the link is as the file draws it; ``pose``: of the link, for a free joint."""
    values = [*pose[:3, 3], *angles_of(pose[:3, :3])] if joint.kind == "free" else [0.0] * 3
    return dict(zip(variables_of(joint), map(float, values), strict=True))


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


def left_out_of(joint: JointPart) -> list[LeftOut]:
    """Return what a ball or free joint has in its file that angles cannot say."""
    what = [
        ("damping", any(joint.damping)),
        ("stiffness", any(joint.stiffness)),
        ("armature", joint.armature != 0.0),
        ("frictionloss", joint.friction != 0.0),
        ("springdamper", joint.settles is not None),
        ("range", joint.range != (None, None)),
    ]
    why = f"a {joint.kind} joint has three angles, and this is not about any of them"
    return [LeftOut(f"{name} of the joint {joint.name!r}", why) for name, there in what if there]
