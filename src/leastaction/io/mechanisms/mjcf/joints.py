"""The joints of an MJCF: degrees, limits, references, frames around them."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.errors import ModelFileError
from leastaction.io.mechanisms.mjcf.spec import frames_before, is_limited, mujoco_module
from leastaction.io.mechanisms.parts import JointPart, Range


def joint_part(joint: Any, name: str, spec: Any) -> JointPart:
    """Return a joint of the specification as a part, in radians, in the frame of its body."""
    types = mujoco_module().mjtJoint
    kind = {
        int(types.mjJNT_HINGE): "hinge",
        int(types.mjJNT_SLIDE): "slide",
        int(types.mjJNT_BALL): "ball",
        int(types.mjJNT_FREE): "free",
    }[int(joint.type)]
    around = frames_before(joint, spec)
    axis, point = np.array(joint.axis, dtype=np.float64), np.array(joint.pos, dtype=np.float64)
    length = float(np.linalg.norm(axis))
    if kind in ("hinge", "slide") and length == 0.0:
        raise ModelFileError(f"joint {name!r}: its axis is zero; expected a direction, such as '0 0 1'")
    turns = kind in ("hinge", "ball")
    unit = np.pi / 180.0 if turns and joint.compiler.degree else 1.0
    limited = is_limited(joint.limited, joint.range, joint.compiler)
    limit: Range = (None, None)
    if limited:
        limit = (unit * float(joint.range[0]), unit * float(joint.range[1]))
    effort: Range = (None, None)
    if is_limited(joint.actfrclimited, joint.actfrcrange, joint.compiler):
        effort = (float(joint.actfrcrange[0]), float(joint.actfrcrange[1]))
    settles = (float(joint.springdamper[0]), float(joint.springdamper[1]))
    timed = min(settles) > 0.0
    if kind == "free":
        point, unit = np.zeros(3), 1.0
    else:
        point = around[:3, :3] @ point + around[:3, 3]
    return JointPart(
        name=name,
        kind=kind,  # type: ignore[arg-type]
        axis=around[:3, :3] @ axis / (length or 1.0),
        point=point,
        reference=unit * float(joint.ref) if kind in ("hinge", "slide") else 0.0,
        range=limit,
        effort=effort,
        damping=() if timed else tuple(map(float, joint.damping)),
        stiffness=() if timed else tuple(map(float, joint.stiffness)),
        rest=unit * float(joint.springref),
        armature=float(joint.armature),
        friction=float(joint.frictionloss),
        settles=settles if timed else None,
    )
