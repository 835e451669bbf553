"""`Names`: what the names of a file have become in the mechanism.

What makes elements of actuators, tendons and equality constraints asks here, and nowhere else: frames of bodies and
sites, the value of a joint as an expression of variables, names of inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from leastaction.errors import ModelFileError, unknown
from leastaction.io.mechanisms import rotations
from leastaction.io.mechanisms.parts import JointPart, Robot
from leastaction.mechanics import var
from leastaction.mechanics.description.affine import Affine


@dataclass(frozen=True)
class Names:
    """Names of a file and what they are in the mechanism.

    ``world``: The frame of the world. ``bodies``, ``sites``: The frame of each body and site. ``values``: The value of
    each hinge and slide, as the file counts it: a variable; of a joint that follows another an expression of that
    one's; of a joint that was fixed a number (``value.terms`` is empty). ``joints``: The joints that move, those of
    several variables too. ``all_joints``: Those of the file, in its order, the fixed ones too.
    """

    world: str
    bodies: Mapping[str, str]
    sites: Mapping[str, str]
    values: Mapping[str, Affine]
    joints: Mapping[str, JointPart]
    all_joints: tuple[JointPart, ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """Every variable, in the order of the joints."""
        found: dict[str, None] = {}
        for name, joint in self.joints.items():
            if joint.kind in ("ball", "free"):
                found.update(dict.fromkeys(rotations.variables_of(joint)))
            else:
                found.update(dict.fromkeys(self.values[name].names))
        return tuple(found)

    def is_own(self, name: str) -> bool:
        """Return whether a hinge or a slide has a variable of its own, of its name."""
        value = self.values[name]
        return value.plain and value.names == (name,)

    def input(self, name: str) -> str:
        """Return the name of the input of an actuator: its own, or with ``.input`` where a variable has that."""
        return f"{name}.input" if name in self.variables else name


def settle(robot: Robot, file: Robot) -> Names:
    """Return the names of a robot's frames and the values of its joints, those that follow others resolved.

    ``file``: the robot as the file says it, before joints were fixed.
    """
    joints = robot.joints
    bodies = {link.name: link.name for link in robot.links} | {robot.world: robot.world}
    taken = set(bodies)
    sites: dict[str, str] = {}
    for site in [*robot.sites, *(site for link in robot.links for site in link.sites)]:
        sites[site.name] = fresh(site.name, taken, ".site")
    values: dict[str, Affine] = {}
    for name, joint in joints.items():
        if joint.kind in ("hinge", "slide"):
            values[name] = _value(name, joints, ())
    for name, joint in file.joints.items():
        if name not in joints and joint.kind in ("hinge", "slide"):
            values[name] = Affine((), joint.reference)
    return Names(robot.world, bodies, sites, values, joints, tuple(file.joints.values()))


def fresh(name: str, taken: set[str], ending: str) -> str:
    """Return a name that is not taken, with an ending where it is, and take it."""
    while name in taken:
        name += ending
    taken.add(name)
    return name


def _value(name: str, joints: Mapping[str, JointPart], on_the_way: Sequence[str]) -> Affine:
    joint = joints[name]
    if joint.mimic is None:
        return var(name)
    if joint.mimic.factor == 0.0:
        return Affine((), joint.mimic.offset)
    if name in on_the_way:
        raise ModelFileError(f"the joints {' -> '.join([*on_the_way, name])} follow each other in a circle")
    other = joint.mimic.joint
    if other not in joints:
        raise ModelFileError(f"joint {name!r} follows {unknown('joint', other, joints)!s}")
    if joints[other].kind not in ("hinge", "slide"):
        raise ModelFileError(
            f"joint {name!r} follows {other!r}, a joint of several variables; it can follow one of one"
        )
    return joint.mimic.factor * _value(other, joints, (*on_the_way, name)) + joint.mimic.offset
