"""MuJoCo's specification of an MJCF: a file as data, defaults and includes resolved, nothing compiled."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from leastaction.errors import MissingExtraError, ModelFileError
from leastaction.io.mechanisms.poses import along, pose_of, rotation_of
from leastaction.numerics.arrays import Array


def mujoco_module() -> Any:
    """Return the module ``mujoco``, or raise a `MissingExtraError` that says what to install."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError(
            "an MJCF is read through MuJoCo, which is not installed; install it with: pip install 'leastaction[models]'"
        ) from error
    if not hasattr(mujoco, "MjSpec"):
        raise MissingExtraError(
            "an MJCF is read through MuJoCo 4 or newer; install it with: pip install 'leastaction[models]'"
        )
    return mujoco


def read_spec(path: Path) -> Any:
    """Return the specification (``mujoco.MjSpec``) of an MJCF; raise `ModelFileError` where it is wrong."""
    mujoco = mujoco_module()
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        text = " ".join(str(error).split())
        found = re.search(r"line (\d+)", text)
        line = int(found.group(1)) if found else None
        at = f", line {line}" if line else ""
        raise ModelFileError(
            f"{path}{at}: {text.removeprefix('XML Error: ').removeprefix('Error: ')}", line=line
        ) from None


def pose_in_body(element: Any, spec: Any) -> Array:
    """Return the pose of a body, geom or site in its parent body, behind the frames that it is written in."""
    return frames_before(element, spec) @ own_pose(element, spec)


def own_pose(element: Any, spec: Any) -> Array:
    """Return the pose of an element in the frame or body around it; of one from a point to another, half-way."""
    ends = getattr(element, "fromto", None)
    if ends is not None and not math.isnan(ends[0]):
        first, second = np.array(ends[:3]), np.array(ends[3:])
        return pose_of((first + second) / 2.0, along(first - second))
    return pose_of(element.pos, orientation(element.quat, element.alt, element.compiler, spec))


def orientation(quat: Sequence[float], alt: Any, compiler: Any, spec: Any) -> Array:
    """Return the rotation of a quaternion, or of what an element says instead of one."""
    if alt.type != mujoco_module().mjtOrientation.mjORIENTATION_QUAT:
        quat = spec.resolve_orientation(degree=compiler.degree, sequence=compiler.eulerseq, orientation=alt)
    return rotation_of(quat)


def frames_before(element: Any, spec: Any) -> Array:
    """Return the pose, in its body, of the innermost ``<frame>`` that an element is written in."""
    pose, frame = np.eye(4), element.frame
    while frame is not None:
        pose, frame = own_pose(frame, spec) @ pose, frame.frame
    return pose


def is_limited(limited: Any, given: Sequence[float], compiler: Any) -> bool:
    """Return whether a range counts: where it says so, or by itself where the compiler may infer it."""
    kinds = mujoco_module().mjtLimited
    if limited == kinds.mjLIMITED_AUTO:
        return bool(compiler.autolimits) and float(given[0]) != float(given[1])
    return bool(limited == kinds.mjLIMITED_TRUE)
