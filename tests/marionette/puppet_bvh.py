"""Writes BVH files of a person with the puppet's proportions, in any convention of such files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from leastaction_marionette import VARIABLES, Proportions

FloatArray = NDArray[np.float64]

CMU_NAMES = {
    "left_hip": "LeftUpLeg",
    "left_knee": "LeftLeg",
    "left_ankle": "LeftFoot",
    "right_hip": "RightUpLeg",
    "right_knee": "RightLeg",
    "right_ankle": "RightFoot",
    "left_shoulder": "LeftArm",
    "left_elbow": "LeftForeArm",
    "left_wrist": "LeftHand",
    "right_shoulder": "RightArm",
    "right_elbow": "RightForeArm",
    "right_wrist": "RightHand",
}

#: Columns are the puppet's x (right), y (forward), z (up) in the axes of the file.
Y_UP = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
Z_UP = np.eye(3)
Z_UP_FACING_MINUS_X = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Convention:
    """How the file is written; the default is that of the CMU conversions, but in metres."""

    axes: FloatArray = field(default_factory=lambda: Y_UP)
    order: str = "ZYX"
    unit: float = 1.0
    positions_everywhere: bool = False
    names: Mapping[str, str] = field(default_factory=lambda: CMU_NAMES)


def waving(n_frames: int = 60, dt: float = 0.02) -> FloatArray:
    """Values (F, 22) of the puppet's variables for a lively motion with all joints bent.

    The pelvis starts above the origin, has mean height zero, and faces +y in the mean.
    """
    t = dt * np.arange(n_frames)
    wave = np.sin(2.0 * np.pi * t / (dt * n_frames))
    q = np.zeros((n_frames, len(VARIABLES)))
    for column, name in enumerate(VARIABLES):
        q[:, column] = 0.3 * np.sin(2.0 * np.pi * t + 0.7 * column) + 0.1 * np.cos(column)
        if "knee" in name:
            q[:, column] = -0.9 + 0.5 * q[:, column]
        elif "elbow" in name:
            q[:, column] = 0.9 + 0.5 * q[:, column]
        elif name.startswith("torso_r"):
            q[:, column] = 0.2 * wave
    q[:, :3] -= q[0, :3]
    q[:, 2] -= np.mean(q[:, 2])
    return q


def write_puppet(
    path: Path,
    q: FloatArray,
    *,
    frame_time: float = 0.02,
    convention: Convention | None = None,
) -> Path:
    """Write the puppet in the poses `q` (F, 22) as a BVH file."""
    how = convention or Convention()
    sizes = Proportions()
    value = {name: q[:, column] for column, name in enumerate(VARIABLES)}
    position = [f"{axis}position" for axis in "XYZ"]
    rotation = [f"{axis}rotation" for axis in how.order]
    text: list[str] = ["HIERARCHY"]
    columns: list[FloatArray] = []

    def local(turn: FloatArray) -> FloatArray:
        matrix = how.axes @ turn @ how.axes.T
        return np.asarray(Rotation.from_matrix(matrix).as_euler(how.order, degrees=True))

    def opened(kind: str, name: str, offset: FloatArray, turn: FloatArray) -> None:
        place = how.axes @ offset / how.unit
        channels = rotation
        if kind == "ROOT":
            columns.append(q[:, :3] @ how.axes.T / how.unit)
        if kind == "ROOT" or how.positions_everywhere:
            channels = position + rotation
        if kind == "JOINT" and how.positions_everywhere:
            columns.append(np.tile(place, (len(q), 1)))
        columns.append(local(turn))
        text.extend([f"{kind} {name}", "{", "OFFSET " + " ".join(map(repr, place.tolist()))])
        text.append(f"CHANNELS {len(channels)} " + " ".join(channels))

    def turned(*names: str) -> FloatArray:
        axes = "".join(name[-1].upper() for name in names)
        angles = np.stack([value[name] for name in names], axis=1)
        return np.asarray(Rotation.from_euler(axes, angles).as_matrix())

    still = np.tile(np.eye(3), (len(q), 1, 1))
    opened("ROOT", "Hips", np.zeros(3), turned("torso_rz", "torso_ry", "torso_rx"))
    for side in ("left", "right"):
        for limb, joints in (
            ("leg", ("hip", "knee", "ankle")),
            ("arm", ("shoulder", "elbow", "wrist")),
        ):
            root, hinge, end = joints
            first, second = sizes.bones(limb)  # type: ignore[arg-type]
            base = np.array(sizes.attachment(side, limb))  # type: ignore[arg-type]
            letter = side[0]
            turn = turned(*(f"{letter}{root}_r{axis}" for axis in "zyx"))
            bend = turned(f"{letter}{hinge}_rx")
            opened("JOINT", how.names[f"{side}_{root}"], base, turn)
            opened("JOINT", how.names[f"{side}_{hinge}"], np.array([0, 0, -first]), bend)
            opened("JOINT", how.names[f"{side}_{end}"], np.array([0, 0, -second]), still)
            text.extend(["End Site", "{", "OFFSET 0 0 0", "}", "}", "}", "}"])
    text.append("}")
    text.extend(["MOTION", f"Frames: {len(q)}", f"Frame Time: {frame_time!r}"])
    text.extend(" ".join(map(repr, row)) for row in np.concatenate(columns, axis=1).tolist())
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return path
