"""What is asked of a file when it is loaded: masses that it leaves out, joints that are welded, a base that is free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from leastaction.errors import ArgumentError, some, unknown
from leastaction.io.mechanisms.parts import Axes, JointPart, LinkPart, MassPart, Mimic, Robot
from leastaction.mechanics import Body
from leastaction.numerics.arrays import require_instance, require_mapping


def with_bodies(robot: Robot, bodies: Mapping[str, Body]) -> Robot:
    """Return the robot with other masses of some links, by name."""
    require_mapping(bodies, "bodies", "{'hand': Body(0.4)}")
    links = {link.name: link for link in robot.links}
    for name, body in bodies.items():
        if name not in links:
            raise unknown("link", name, links, "bodies")
        require_instance(body, f"bodies: {name!r}", Body)
        links[name] = replace(links[name], mass=MassPart(body.mass, body.com, body.inertia))
    return replace(robot, links=tuple(links.values()))


def with_free_base(robot: Robot) -> Robot:
    """Return the robot with its root free in space, by a joint that is called as the root is."""
    roots = [index for index, link in enumerate(robot.links) if link.parent < 0]
    if len(roots) != 1 or robot.links[roots[0]].joints:
        what = (
            f"{len(roots)} links stand on the world" if len(roots) != 1 else "its root already moves against the world"
        )
        raise ArgumentError(f"floating=True: {what}, and one that stands still is to be let free; leave it out")
    free = _already_free(robot, roots[0])
    if free:
        raise ArgumentError(
            f"floating=True: {some([repr(name) for name in free])} {'is' if len(free) == 1 else 'are'} free in space "
            "by the file, and nothing with a mass stands still; leave it out"
        )
    links = list(robot.links)
    root = links[roots[0]]
    links[roots[0]] = replace(root, joints=(JointPart(name=root.name, kind="free"),))
    return replace(robot, links=tuple(links))


def _already_free(robot: Robot, root: int) -> list[str]:
    """Return the links that the file lets free from its root, where nothing else hangs on it that has a mass."""
    still, moving = {root}, list[LinkPart]()
    for index, link in enumerate(robot.links):
        if link.parent in still and not link.joints:
            still.add(index)
        elif link.parent in still:
            moving.append(link)
    heavy = any(robot.links[index].mass is not None for index in still)
    free = all(link.joints[0].kind == "free" for link in moving)
    return [link.name for link in moving] if free and not heavy else []


def with_axes(robot: Robot, axes: Axes) -> Robot:
    """Return the robot with ball and free joints that turn by a quaternion, or by angles."""
    links = (replace(link, joints=tuple(replace(joint, axes=axes) for joint in link.joints)) for link in robot.links)
    return replace(robot, links=tuple(links))


def with_fixed(robot: Robot, fixed: Sequence[str]) -> Robot:
    """Return the robot with joints welded where they are at their reference; what follows them stands still too."""
    if isinstance(fixed, str):
        raise ArgumentError(f"fixed: expected a list of joints, got {fixed!r}; write [{fixed!r}]")
    for name in fixed:
        if name not in robot.joints:
            raise unknown("joint", name, robot.joints, "fixed")
    links = tuple(
        replace(link, joints=tuple(_follower(joint, robot, fixed) for joint in link.joints if joint.name not in fixed))
        for link in robot.links
    )
    return replace(robot, links=links)


def _follower(joint: JointPart, robot: Robot, fixed: Sequence[str]) -> JointPart:
    """Return a joint, as a constant where it follows one that is fixed."""
    factor, offset, at = 1.0, 0.0, joint
    seen: set[str] = set()
    while at.mimic is not None and at.mimic.joint in robot.joints and at.name not in seen:
        seen.add(at.name)
        factor, offset = factor * at.mimic.factor, offset + factor * at.mimic.offset
        at = robot.joints[at.mimic.joint]
        if at.name in fixed:
            return replace(joint, mimic=Mimic("", 0.0, factor * at.reference + offset))
    return joint
