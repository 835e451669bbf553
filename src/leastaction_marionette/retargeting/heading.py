"""Which way a captured person stands, faces and goes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import numpy as np

from leastaction.errors import ArgumentError, MotionFileError
from leastaction.io import Capture, Motion, axis_rotation
from leastaction.numerics import Array, as_choice
from leastaction_marionette.choices import Axis, Heading
from leastaction_marionette.retargeting.geometry import unit

_SLOW = 0.25  # Hz
_ERECT = 1.8  # of 2 is the upright direction of a skeleton that stands along an axis
_GROUND = (-0.2, 0.3)  # lengths of a leg, where the lowest joint of one who stands or lies on the ground is


def up_axis(points: Mapping[str, Array], rest: Mapping[str, Array]) -> Axis:
    """The capture's axis nearest to the person's mean upright direction, or that of the skeleton of one who lies.

    ``points``: places (F, 3) by role. ``rest``: those (1, 3) of the skeleton before it is posed, which tip the scales
    where the poses do not: of a person who turns somersaults. Of one who lies, they are all that says where up is. That
    is told from a skeleton that the file turns up by two signs: the ground is at zero along the skeleton's axis and not
    along the other, or the other points down one of the file's axes.
    """
    by_skeleton = _upright(rest)
    posed = _nearest_axis(_upright(points) + 0.5 * by_skeleton)
    skeleton = _nearest_axis(by_skeleton)
    if posed[-1] == skeleton[-1] or np.max(np.abs(by_skeleton)) < _ERECT:
        return posed
    grounded = _grounded(points, skeleton) and not _grounded(points, posed)
    return skeleton if grounded or posed.startswith("-") else posed


def _grounded(points: Mapping[str, Array], up: Axis) -> bool:
    """Whether the lowest of the joints, somewhen, is about as high over zero as a joint on the ground."""
    lowest = min(float(np.min(place @ _axis_vector(up))) for place in points.values())
    least, most = _GROUND
    return least < lowest / leg_length(points) < most


def _upright(points: Mapping[str, Array]) -> Array:
    """Mean upright direction (3,), half by the spine and half by the legs."""
    ankles = 0.5 * (points["left_ankle"] + points["right_ankle"])
    spine = np.mean(unit(points["spine_top"] - points["pelvis"]), axis=0)
    return np.asarray(spine + np.mean(unit(points["pelvis"] - ankles), axis=0))


def forward_axis(points: Mapping[str, Array], up: Axis) -> Axis:
    """The capture's level axis nearest to the way that the person faces, in the mean, or else at first."""
    level = unit(facing(points))
    level[:, np.abs(_axis_vector(up)) > 0.5] = 0.0
    mean = np.mean(level, axis=0)
    if np.max(np.abs(mean)) < 0.1:
        mean = _first_level(level)
    return _nearest_axis(mean)


def _first_level(level: Array) -> Array:
    """The first of some directions (F, d) that is clearly level; without one the most level of them."""
    length = np.linalg.norm(level, axis=1)
    clear = np.flatnonzero(length > 0.5)
    return np.asarray(level[clear[0] if clear.size else int(np.argmax(length))])


def facing(points: Mapping[str, Array]) -> Array:
    """Direction (F, 3) in which hips and shoulders face: up along the spine x to the right."""
    return np.cross(points["spine_top"] - points["pelvis"], right(points))


def right(points: Mapping[str, Array]) -> Array:
    """Direction (F, 3) to the person's right: half by the hips, half by the shoulders."""
    return unit(points["right_hip"] - points["left_hip"]) + unit(points["right_shoulder"] - points["left_shoulder"])


def _nearest_axis(vector: Array) -> Axis:
    index = int(np.argmax(np.abs(vector)))
    names: tuple[Axis, ...] = ("x", "y", "z", "-x", "-y", "-z")
    return names[index if vector[index] > 0.0 else index + 3]


def _axis_vector(axis: Axis) -> Array:
    as_choice(axis, "axis", get_args(Axis))
    vector = np.zeros(3)
    vector["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return vector


def world_from(up: Axis, forward: Axis) -> Array:
    """Rotation that lays the capture's forward axis on +y and its up axis on +z."""
    y, z = _axis_vector(forward), _axis_vector(up)
    if abs(float(y @ z)) > 0.5:
        raise ArgumentError(f"up and forward: got {up} and {forward}, expected two different axes")
    return np.stack([np.cross(y, z), y, z])


def heading_angle(capture: Capture, heading: Heading, points: Mapping[str, Array]) -> float:
    """Turn about z, in radians, that brings the chosen direction of `points`, z up, to +y."""
    as_choice(heading, "heading", get_args(Heading))
    if heading == "axis":
        return 0.0
    if heading == "travel":
        way = (points["pelvis"][-1] - points["pelvis"][0])[:2]
        if np.linalg.norm(way) < 0.3 * leg_length(points):
            raise MotionFileError(
                f"{capture.path}: the person hardly leaves the spot, so there is no direction of "
                "travel; use heading='facing'"
            )
    else:
        level = unit(facing(points))[:, :2]
        way = np.sum(unit(level) * (np.linalg.norm(level, axis=1) > 0.3)[:, None], axis=0)
        if np.linalg.norm(way) < 0.1 * len(level):
            way = _first_level(level)
    return float(np.pi / 2.0 - np.arctan2(way[1], way[0]))


def straightened(t: Array, yaw: Array, place: Array) -> tuple[Array, Array]:
    """Return heading (F,) and place over the ground (F, 2) of a motion whose slow turns are taken out.

    What goes on below a quarter of a hertz is the path's; steps turn the pelvis faster. The way made good in each
    instant is kept, so that a walk in a circle becomes one of the same length straight ahead.
    """
    slow = Motion(("yaw",), t, yaw[:, None]).low_pass(_SLOW)["yaw"]
    middle = -0.5 * (slow[1:] + slow[:-1])
    turn = axis_rotation(2, middle)[:, :2, :2]
    way = np.einsum("fij,fj->fi", turn, np.diff(place, axis=0))
    return yaw - slow, place[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(way, axis=0)])


def leg_length(points: Mapping[str, Array]) -> float:
    """Mean length of hip to knee to ankle, both sides and all frames."""
    lengths = [
        np.linalg.norm(points[f"{side}_{b}"] - points[f"{side}_{a}"], axis=1)
        for side in ("left", "right")
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    return 0.5 * float(np.mean(np.sum(lengths, axis=0)))
