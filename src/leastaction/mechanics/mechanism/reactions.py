"""The wrench in every joint: what holds together what is before it and what is behind.

Before each joint six prescribed coordinates are put in, at zero and at rest: three slides and three turns of what is
behind it. What keeps them where they are is the wrench that goes through the joint, with all that elements do on both
sides. A rotation that is a quaternion is one joint.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from leastaction import _core
from leastaction.mechanics.description.frames import QUATERNION, rx, ry, rz, tx, ty, tz
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.path_motion import poses_of
from leastaction.numerics.arrays import Array

_CUTS = (tx, ty, tz, rx, ry, rz)


def reactions(
    m: Mechanism, q: Array, v: Array, a: Array, u: Array, lam: Array, t: Array | None = None
) -> dict[str, Array]:
    """Return the wrenches (N, 6) in all joints, by the name of the frame that each moves.

    ``q`` (N, nq), ``v``, ``a`` (N, nv): configurations, velocities and accelerations. ``u`` (N, n_inputs): inputs.
    ``lam`` (N, nc): multipliers, of which the force is ``Dh^T lam``. ``t`` (N,): times (s), zero if not given. Of each:
    the force (N), then the torque (N m) about the origin of the frame, in world axes, with which what is before the
    joint acts on what is behind it. A rotation that is a quaternion has one, by the name of the frame that it moves.
    """
    ends = _joints(m)
    cut = _cut(m, {first: m.tree.frames[last].name for last, first in ends.items()})
    column = {name: i for i, name in enumerate(cut.variables)}
    at, speed, rate = (np.zeros((len(q), n)) for n in (cut.nq, cut.nv, cut.nv))
    at[:, [cut.coordinates.index(name) for name in m.coordinates]] = q
    for to, of in ((speed, v), (rate, a)):
        to[:, [column[name] for name in m.variables]] = of
    equations = [m.constraints.index(name) for name in cut.constraints]
    dynamics = _core.Continuous(cut.core, 0.0, 0.0)
    when = None if t is None else np.ascontiguousarray(t)
    forces = np.asarray(
        dynamics.inverse_dynamics(
            at, speed, rate, np.ascontiguousarray(u), np.ascontiguousarray(lam[:, equations]), 1, when
        )
    )
    joints, found = m.core.joint_poses(np.ascontiguousarray(q)), {}
    for last, first in ends.items():
        name, parent = m.tree.frames[last].name, m.tree.frames[first].parent
        wrench = forces[:, [column[_name(name, cut_by.__name__)] for cut_by in _CUTS]].reshape(-1, 2, 3)
        before, here = poses_of(m.tree, parent, joints), poses_of(m.tree, last, joints)
        force, torque = np.einsum("nij,nkj->kni", before[:, :3, :3], wrench)
        torque = torque + np.cross(before[:, :3, 3] - here[:, :3, 3], force)
        found[name] = np.concatenate([force, torque], axis=1)
    return found


def _joints(m: Mechanism) -> dict[int, int]:
    """Return the frames that joints move, in order, each with the first of its frames: a quaternion has three."""
    firsts = {index: index for index, placed in enumerate(m.tree.frames) if placed.frame.variables}
    for group, indices in m.tree.compositions:
        if group.axes == QUATERNION:
            first, second, last = indices[-3:]
            del firsts[first], firsts[second]
            firsts[last] = first
    return firsts


def _name(frame: str, slide: str) -> str:
    return f"{frame} cut {slide}"


def _cut(m: Mechanism, cuts: dict[int, str]) -> Mechanism:
    """Return the mechanism with six prescribed coordinates before some frames, called after the frames given for it."""
    behind: dict[int, list[Any]] = {i: [] for i in range(len(m.tree.frames))}
    tree = list(enumerate(m.tree.frames))
    for index, placed in reversed(tree[1:]):
        group = placed.frame.group
        kept = group if group is not None and group.axes == QUATERNION else None
        own: list[Any] = [replace(placed.frame, name=placed.name, group=kept)]
        if behind[index]:
            own.append(behind[index])
        if index in cuts:
            for slide in reversed(_CUTS):
                own = [slide(_name(cuts[index], slide.__name__), kinematic=True), own]
        behind[placed.parent] = own + behind[placed.parent]
    return Mechanism(behind[0], list(m.elements.values()), inputs=m.inputs)
