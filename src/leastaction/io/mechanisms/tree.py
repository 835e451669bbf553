"""The tree of frames of a robot: links, their joints one behind the other, sites."""

from __future__ import annotations

import numpy as np

from leastaction.io.mechanisms import rotations
from leastaction.io.mechanisms.names import Names, fresh
from leastaction.io.mechanisms.parts import JointPart, LinkPart, MassPart, Robot
from leastaction.mechanics import Body, pose, prismatic, revolute, world
from leastaction.mechanics.description.branch import Branch
from leastaction.mechanics.description.frames import FrameOptions


def tree_of(robot: Robot, names: Names) -> Branch:
    """Return the frames of a robot; a link is the frame of its name, with its body, behind its last joint."""
    root = world(robot.world)
    taken = {*names.bodies.values(), *names.sites.values()}
    places: list[Branch] = []
    for site in robot.sites:
        root.pose(site.pose, name=names.sites[site.name])
    for link in robot.links:
        before = root if link.parent < 0 else places[link.parent]
        place = _link(before, link, names, taken)
        for site in link.sites:
            place.pose(site.pose, name=names.sites[site.name])
        places.append(place)
    return root


def _link(place: Branch, link: LinkPart, names: Names, taken: set[str]) -> Branch:
    last = FrameOptions(name=link.name, bodies=() if link.mass is None else (body_of(link.mass),))
    if not link.joints:
        return place.put(pose(link.pose, **last))
    if link.joints[0].kind != "free" and not np.array_equal(link.pose, np.eye(4)):
        place = place.put(pose(link.pose, name=fresh(f"{link.name}.base", taken, "'")))
    for joint in link.joints[:-1]:
        place = _joint(place, joint, names, FrameOptions(name=fresh(f"{joint.name}.frame", taken, "'")))
    return _joint(place, link.joints[-1], names, last)


def _joint(place: Branch, joint: JointPart, names: Names, options: FrameOptions) -> Branch:
    if joint.kind in ("ball", "free"):
        return rotations.put(place, joint, options)
    value = names.values[joint.name] - joint.reference
    if joint.kind == "slide":
        return place.put(prismatic(value, axis=joint.axis, **options))
    turn = value - 2.0 * np.pi * float(np.round(value.offset / (2.0 * np.pi)))  # whole turns are none
    return place.put(revolute(turn, axis=joint.axis, point=joint.point, **options))


def body_of(part: MassPart) -> Body:
    """Return the body of a mass; what no real body has was looked at before."""
    return Body(part.mass, com=part.com, inertia=part.inertia, allow_nonphysical=True)
