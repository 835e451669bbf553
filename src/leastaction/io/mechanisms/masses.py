"""Masses and inertias of files: rounding is zero, and what no body can have is refused or mended.

A second moment of mass ``S = tr(I)/2 - I`` has no negative eigenvalue where the mass is positive; the nearest inertia
that a body can have is that of S without its negative part. An inertia that only breaks the triangle inequality moves
well, and stays as it is where files are taken strictly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from leastaction.errors import ModelFileError
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.parts import JointPart, LinkPart, MassPart, Robot
from leastaction.mechanics.description.bodies import INERTIA_TOLERANCE
from leastaction.numerics.arrays import Array

_ROUNDING = 1e-15  # kg m^2: moments below it are rounding of whatever wrote the file
_SHARE, _RADIUS = 1e-5, 0.05  # of the whole mass, and as a ball of this radius (m): what a massless link is given
_ADVICE = "correct the file, or load it with inertia='repair', which takes the nearest that a body can have"


def checked(robot: Robot, repair: bool) -> tuple[Robot, list[LeftOut]]:
    """Return a robot whose masses can be, and what was changed for it; raise `ModelFileError` if that is not wanted."""
    changes: list[LeftOut] = []
    links = [
        link if link.mass is None else replace(link, mass=_body(link.name, link.mass, repair, changes))
        for link in robot.links
    ]
    if repair:
        links = _with_small_masses(links, changes)
    return replace(robot, links=tuple(links)), changes


def _body(name: str, part: MassPart, repair: bool, changes: list[LeftOut]) -> MassPart:
    if part.mass < 0.0:
        if not repair:
            raise ModelFileError(f"link {name!r}: its mass is {part.mass:g} kg, and none is negative; {_ADVICE}")
        changes.append(LeftOut(f"mass of {name!r}", f"{part.mass:g} kg is negative: it has none now"))
        return MassPart(0.0, part.com, np.zeros((3, 3)))
    moments, axes = np.linalg.eigh(part.inertia)
    text = ", ".join(f"{moment:.4g}" for moment in moments)
    slack = max(INERTIA_TOLERANCE * float(np.abs(moments).max()), _ROUNDING)
    negative = moments[0] < -slack
    if negative and not repair:
        raise ModelFileError(
            f"link {name!r}: its inertia has the principal moments {text} kg m^2, and none is negative; {_ADVICE}"
        )
    if repair and (negative or moments[2] > moments[0] + moments[1] + slack):
        second = np.maximum(moments.sum() / 2.0 - moments, 0.0)
        moments = second.sum() - second
        changes.append(LeftOut(f"inertia of {name!r}", f"no body has the principal moments {text} kg m^2: the nearest"))
    elif moments[0] < 0.0:
        moments = np.maximum(moments, 0.0)
    else:
        return part
    return MassPart(part.mass, part.com, (axes * moments) @ axes.T)


def _with_small_masses(links: Sequence[LinkPart], changes: list[LeftOut]) -> list[LinkPart]:
    """Give a small mass to links that move none, judged where the file draws them."""
    poses: list[Array] = []
    for link in links:
        poses.append(link.pose if link.parent < 0 else poses[link.parent] @ link.pose)
    sums = [_spatial(link.mass, pose) for link, pose in zip(links, poses, strict=True)]
    for index in reversed(range(len(links))):
        if links[index].parent >= 0:
            sums[links[index].parent] = sums[links[index].parent] + sums[index]
    mass = sum(link.mass.mass for link in links if link.mass is not None) or 1.0
    small = MassPart(_SHARE * mass, np.zeros(3), 0.4 * _SHARE * mass * _RADIUS**2 * np.eye(3))
    result = list(links)
    for index, (link, pose, total) in enumerate(zip(links, poses, sums, strict=True)):
        twists = [twist for joint in link.joints if not _geared(joint) for twist in _twists(joint, pose)]
        if all(twist @ total @ twist > 1e-13 * _scale(total, twist) for twist in twists):
            continue
        result[index] = replace(link, mass=small if link.mass is None else _sum(link.mass, small))
        changes.append(LeftOut(f"masslessness of {link.name!r}", f"it moves no mass: it has {small.mass:.2g} kg now"))
    return result


def _geared(joint: JointPart) -> bool:
    """Return whether a rotor gives a joint an inertia of its own."""
    return joint.kind in ("hinge", "slide") and joint.armature > 0.0


def _sum(first: MassPart, second: MassPart) -> MassPart:
    return MassPart(first.mass + second.mass, first.com, first.inertia + second.inertia)


def _scale(total: Array, twist: Array) -> float:
    return float(np.trace(total)) * float(twist @ twist) + 1e-300


def _spatial(part: MassPart | None, pose: Array) -> Array:
    """Return the spatial inertia (6, 6), for twists [v; w], about the world's origin."""
    if part is None:
        return np.zeros((6, 6))
    R = pose[:3, :3]
    C = _cross(R @ part.com + pose[:3, 3])
    return np.block(
        [[part.mass * np.eye(3), part.mass * C.T], [part.mass * C, R @ part.inertia @ R.T + part.mass * C @ C.T]]
    )


def _twists(joint: JointPart, pose: Array) -> list[Array]:
    R, p = pose[:3, :3], pose[:3, :3] @ joint.point + pose[:3, 3]
    slides = [np.concatenate([axis, np.zeros(3)]) for axis in (R @ joint.axis)[None]]
    turns = [np.concatenate([np.cross(p, axis), axis]) for axis in (R @ joint.axis)[None]]
    every = [np.concatenate([np.cross(p, axis), axis]) for axis in np.eye(3)]
    if joint.kind == "free":
        return every + [np.concatenate([axis, np.zeros(3)]) for axis in np.eye(3)]
    return {"slide": slides, "hinge": turns, "ball": every}[joint.kind]


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
