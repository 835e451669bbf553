"""Elements of ball and free joints: damping, springs, dry friction and rotors, about the axes of the link."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.parts import JointPart, LinkPart, MassPart, Robot
from leastaction.io.mechanisms.rotations import variables_of
from leastaction.mechanics import Armature, CoulombFriction, JointSpring
from leastaction.mechanics.elements import Element


def with_rotors(robot: Robot) -> Robot:
    """Return the robot with the armatures of joints that turn against the world as inertia of their links."""
    return replace(robot, links=tuple(_with_rotor(link) for link in robot.links))


def _with_rotor(link: LinkPart) -> LinkPart:
    if not _is_rotor(link):
        return link
    own = MassPart(0.0, np.zeros(3), np.zeros((3, 3))) if link.mass is None else link.mass
    return replace(link, mass=replace(own, inertia=own.inertia + link.joints[-1].armature * np.eye(3)))


def _is_rotor(link: LinkPart) -> bool:
    """Return whether the armature of the last joint of a link opposes turns of the link against the world."""
    if not link.joints or link.parent >= 0 or any(joint.kind != "slide" for joint in link.joints[:-1]):
        return False
    last = link.joints[-1]
    return last.kind in ("ball", "free") and last.axes == "quaternion" and last.armature > 0.0


def elements_of(robot: Robot, joint: JointPart, friction_speed: float) -> tuple[list[Element], list[LeftOut]]:
    """Return the elements of a ball or a free joint but linear damping, and what is left out of it.

    Coefficients of the file are those of each slide, and of each turn about an axis of the link.
    """
    names = variables_of(joint)
    if joint.axes != "quaternion":
        return [], _left_out(joint, f"a {joint.kind} joint has three angles here, and this is not about any of them")
    rotor = any(_is_rotor(link) and link.joints[-1] is joint for link in robot.links)
    elements: list[Element] = []
    if joint.friction > 0.0:
        elements += [CoulombFriction(n, joint.friction, friction_speed, name=f"friction.{n}") for n in names]
    stiff = joint.stiffness[0] if joint.stiffness else 0.0
    if joint.kind == "ball" and stiff > 0.0:
        elements += [JointSpring(name, stiff, name=f"spring.{name}") for name in names]
    if rotor:
        elements += [Armature(name, joint.armature, name=f"armature.{name}") for name in names[:-3]]
    pulls_back = "it pulls to where the file draws the link" if joint.kind == "free" else "springs are linear here"
    is_spring = joint.kind == "ball" and stiff >= 0.0 and not any(joint.stiffness[1:])
    rest = replace(
        joint,
        damping=joint.damping[1:],
        stiffness=() if is_spring else joint.stiffness,
        armature=0.0 if rotor else joint.armature,
        friction=min(joint.friction, 0.0),
        range=(None, None) if joint.kind == "ball" else joint.range,
    )
    why = {
        "damping": "damping is linear here",
        "stiffness": pulls_back,
        "armature": "what it turns against moves too",
        "frictionloss": "it drives the motion on",
        "springdamper": "it depends on what the joint moves, in each direction",
        "range": "a free joint has none",
    }
    return elements, _left_out(rest, "", **why)


def _left_out(joint: JointPart, every: str, **why: str) -> list[LeftOut]:
    """Return what a joint has, with the reason why it is left out: that of all, or of each."""
    what = {
        "damping": any(joint.damping),
        "stiffness": any(joint.stiffness),
        "armature": joint.armature != 0.0,
        "frictionloss": joint.friction != 0.0,
        "springdamper": joint.settles is not None,
        "range": joint.range != (None, None),
    }
    return [LeftOut(f"{n} of the joint {joint.name!r}", every or why[n]) for n, there in what.items() if there]
