"""Elements of joints: damping, springs, dry friction, rotors; and motors that were asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from leastaction.errors import ArgumentError, unknown
from leastaction.io.mechanisms import rotation_elements, rotations
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.io.mechanisms.parts import JointPart, Robot
from leastaction.mechanics import (
    Armature,
    CoulombFriction,
    Damping,
    JointForce,
    JointSpring,
    Mechanism,
    NonlinearDamping,
)
from leastaction.mechanics.description.affine import Affine
from leastaction.mechanics.elements import Element

FRICTION_SPEED = 0.01
"""Speed (rad/s or m/s) over which the dry friction of a joint turns round; files give none."""


def elements_of_joints(robot: Robot, names: Names) -> tuple[list[Element], list[LeftOut]]:
    """Return the elements of all joints and what is left out of them."""
    elements: list[Element] = []
    left_out: list[LeftOut] = []
    damping: dict[str, float] = {}
    for name, joint in names.joints.items():
        if joint.kind in ("ball", "free"):
            found, lost = rotation_elements.elements_of(robot, joint, FRICTION_SPEED)
            elements, left_out = elements + found, left_out + lost
            if joint.axes == "quaternion" and joint.damping and joint.damping[0] > 0.0:
                damping.update(dict.fromkeys(rotations.variables_of(joint), joint.damping[0]))
            continue
        value = names.values[name]
        if not value.terms:
            continue
        elements += _spring(joint, value, left_out)
        if any(joint.damping[1:]):
            elements += _damping(joint, names, left_out)
        elif any(joint.damping):
            for driver, factor in value.terms:  # the power of a coupled joint is that of its driver
                damping[driver] = damping.get(driver, 0.0) + joint.damping[0] * factor**2
        if joint.friction > 0.0 and names.is_own(name):
            elements.append(CoulombFriction(name, joint.friction, FRICTION_SPEED, name=f"friction.{name}"))
        elif joint.friction:
            why = "it drives the motion on" if joint.friction < 0.0 else f"the joint follows {', '.join(value.names)}"
            left_out.append(LeftOut(f"friction of the joint {name!r}", why))
        if joint.armature > 0.0:
            on = value.names[0] if value.plain else dict(value.terms)
            elements.append(Armature(on, joint.armature, name=f"armature.{name}"))
        elif joint.armature:
            left_out.append(LeftOut(f"armature of the joint {name!r}", "it is negative"))
    if damping:
        elements.insert(0, Damping(damping, name="damping"))
    return elements, left_out


def settling(names: Names, mechanism: Mechanism, reference: Mapping[str, float]) -> list[Element]:
    """Return the springs and dampers of joints that are to settle in some time: they depend on what the joint moves.

    ``reference``: the configuration whose inertias count.
    """
    elements: list[Element] = []
    damping: dict[str, float] = {}
    if not any(joint.settles for joint in names.joints.values()):
        return []
    mass_matrix = mechanism.mass_matrix(mechanism.configuration(reference))
    each = 1.0 / np.diag(np.linalg.inv(mass_matrix))  # where the others give way
    inertias = dict(zip(mechanism.variables, map(float, each), strict=True))
    for name, joint in names.joints.items():
        if joint.settles is not None and joint.kind in ("hinge", "slide") and names.is_own(name):
            time, ratio = joint.settles
            damping[name] = 2.0 * inertias[name] / time
            stiffness = inertias[name] / (time * ratio) ** 2
            elements.append(JointSpring(name, stiffness, joint.rest, name=f"spring.{name}"))
    return [*elements, Damping(damping, name="settling")] if damping else []


def _spring(joint: JointPart, value: Affine, left_out: list[LeftOut]) -> Iterable[Element]:
    if any(joint.stiffness[1:]):
        left_out.append(LeftOut(f"higher stiffness of the joint {joint.name!r}", "its spring is linear here"))
    if not joint.stiffness or joint.stiffness[0] == 0.0:
        return
    if joint.stiffness[0] < 0.0:
        left_out.append(LeftOut(f"stiffness of the joint {joint.name!r}", "it is negative: no spring"))
        return
    on = value.names[0] if value.plain else dict(value.terms)
    yield JointSpring(on, joint.stiffness[0], joint.rest - value.offset, name=f"spring.{joint.name}")


def _damping(joint: JointPart, names: Names, left_out: list[LeftOut]) -> Iterable[Element]:
    odd = list(joint.damping[::2])
    if any(joint.damping[1::2]):
        left_out.append(LeftOut(f"damping by v |v| of the joint {joint.name!r}", "damping has odd powers here"))
    while odd and odd[-1] == 0.0:
        odd.pop()
    if not odd:
        return
    if not names.is_own(joint.name):
        left_out.append(LeftOut(f"damping of the joint {joint.name!r}", "it is of higher powers, and follows another"))
        return
    if odd[-1] < 0.0:
        left_out.append(LeftOut(f"damping of the joint {joint.name!r}", "it drives fast motion on"))
        return
    yield NonlinearDamping(joint.name, odd, name=f"damping.{joint.name}")


def motors(names: Names, which: bool | Sequence[str] | None) -> dict[str, JointForce]:
    """Return a motor for each joint asked for: True for all, None for those whose effort is limited, or a list."""
    drivable = [name for name in names.values if names.is_own(name)]
    if isinstance(which, str):
        raise ArgumentError(f"motors: expected True, False or a list of joints, got {which!r}; write [{which!r}]")
    if which is None:
        which = [name for name in drivable if _limited(names.joints[name])]
    elif isinstance(which, bool):
        which = drivable if which else []
    for name in which:
        if name not in drivable:
            raise unknown("joint", name, drivable, "motors")
    found = {}
    for name in which:
        kind = "torque" if names.joints[name].kind == "hinge" else "force"
        found[name] = JointForce(name, f"{name}.{kind}", name=f"motor.{name}")
    return found


def _limited(joint: JointPart) -> bool:
    return any(bound is not None and bound != 0.0 for bound in joint.effort)
