"""Limits of a file as bounds for an optimisation: places, speeds, torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.io.mechanisms.names import Names
from leastaction.io.mechanisms.parts import JointPart
from leastaction.mechanics import JointForce, Mechanism
from leastaction.optimal import Bound
from leastaction.systems import Oriented


def limits_of_joints(names: Names) -> list[Bound]:
    """Return the bounds of where the joints may be, and how fast."""
    places, speeds = [], []
    for name, value in names.values.items():
        if not value.terms:
            continue
        joint = names.joints[name]
        on = value.names[0] if value.plain else dict(value.terms)
        low, high = (None if bound is None else bound - value.offset for bound in joint.range)
        if low is not None or high is not None:
            places.append(Bound(on, low, high, of="variable"))
        if joint.speed is not None:
            speeds.append(Bound(on, -joint.speed, joint.speed, of="rate"))
    return places + speeds


def limits_of_rotations(names: Names, mechanism: Mechanism) -> list[Oriented]:
    """Return the cones of ball joints: the largest angle between the frames before and behind them."""
    frames, found = mechanism.tree.frames, []
    for group, indices in mechanism.tree.compositions:
        joint = names.joints.get(group.name)
        angle = None if joint is None or joint.kind != "ball" or joint.axes != "quaternion" else joint.range[1]
        if angle is not None and 0.0 < angle < np.pi:
            before = frames[frames[indices[0]].parent].name
            found.append(Oriented(frames[indices[-1]].name, np.eye(3), within=angle, origin=before))
    return found


def limits_of_motors(motors: Mapping[str, JointForce], joints: Mapping[str, JointPart]) -> list[Bound]:
    """Return the bounds of the inputs of motors, by the joint of each."""
    efforts = [(motor.input, joints[name].effort) for name, motor in motors.items()]
    return [Bound(name, low, high, of="input") for name, (low, high) in efforts if (low, high) != (None, None)]
