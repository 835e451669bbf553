"""Which way a captured person stands, faces and goes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np

from leastaction.apps.marionette.retargeting.geometry import unit
from leastaction.errors import ArgumentError, MotionFileError
from leastaction.io.motion.capture import Capture
from leastaction.numerics.arrays import Array

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
Heading = Literal["facing", "travel", "axis"]


def up_axis(capture: Capture, points: Mapping[str, Array]) -> Axis:
    """The capture's axis nearest to the person's mean upright direction."""
    ankles = 0.5 * (points["left_ankle"] + points["right_ankle"])
    upright = np.mean(unit(points["spine_top"] - points["pelvis"]), axis=0)
    upright = upright + np.mean(unit(points["pelvis"] - ankles), axis=0)
    if np.max(np.abs(upright)) < 0.5:
        raise MotionFileError(f"{capture.path}: which way is up cannot be told from the poses; give the axis (up=...)")
    return _nearest_axis(upright)


def forward_axis(capture: Capture, points: Mapping[str, Array], up: Axis) -> Axis:
    """The capture's level axis nearest to the person's mean facing direction."""
    mean = np.mean(unit(facing(points)), axis=0)
    mean[np.abs(_axis_vector(up)) > 0.5] = 0.0
    if np.max(np.abs(mean)) < 0.1:
        raise MotionFileError(
            f"{capture.path}: the person faces every way alike, which way is forward cannot be "
            "told; give the axis (forward=...)"
        )
    return _nearest_axis(mean)


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
    if axis not in get_args(Axis):
        raise ArgumentError(f"axis: got {axis!r}, expected one of {', '.join(get_args(Axis))}")
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
    if heading not in get_args(Heading):
        raise ArgumentError(f"heading: got {heading!r}, expected one of {', '.join(get_args(Heading))}")
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
        way = np.sum(unit(facing(points)[:, :2]), axis=0)
    return float(np.pi / 2.0 - np.arctan2(way[1], way[0]))


def leg_length(points: Mapping[str, Array]) -> float:
    """Mean length of hip to knee to ankle, both sides and all frames."""
    lengths = [
        np.linalg.norm(points[f"{side}_{b}"] - points[f"{side}_{a}"], axis=1)
        for side in ("left", "right")
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    return 0.5 * float(np.mean(np.sum(lengths, axis=0)))
