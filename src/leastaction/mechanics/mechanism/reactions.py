"""The wrench in every joint: what holds together what is before it and what is behind.

Before each joint six prescribed coordinates are put in, at zero and at rest: three slides and three turns of what is
behind it. What keeps them where they are is the wrench that goes through the joint, with all that elements do on both
sides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from leastaction import _core
from leastaction.mechanics.description.frames import rx, ry, rz, tx, ty, tz
from leastaction.mechanics.mechanism.arguments import angles_only
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.path_motion import poses_of
from leastaction.numerics.arrays import Array

_CUTS = (tx, ty, tz, rx, ry, rz)


def reactions(
    m: Mechanism, q: Array, v: Array, a: Array, u: Array, lam: Array, t: Array | None = None
) -> dict[str, Array]:
    """Return the wrenches (N, 6) in all joints, by the name of the frame that each moves.

    ``q``, ``v``, ``a`` (N, nq): configurations, velocities and accelerations. ``u`` (N, n_inputs): inputs. ``lam`` (N,
    nc): multipliers, of which the force is ``Dh^T lam``. ``t`` (N,): times (s), zero if not given. Of each: the force
    (N), then the torque (N m) about the origin of the frame, in world axes, with which what is before the joint acts on
    what is behind it.
    """
    angles_only(m, "reactions")
    cut = _cut(m)
    column = {name: i for i, name in enumerate(cut.variables)}
    places = [column[name] for name in m.variables]
    at, speed, rate = (np.zeros((len(q), cut.nq)) for _ in range(3))
    for to, of in ((at, q), (speed, v), (rate, a)):
        to[:, places] = of
    equations = [m.constraints.index(name) for name in cut.constraints]
    dynamics = _core.Continuous(cut.core, 0.0, 0.0)
    when = None if t is None else np.ascontiguousarray(t)
    forces = np.asarray(
        dynamics.inverse_dynamics(
            at, speed, rate, np.ascontiguousarray(u), np.ascontiguousarray(lam[:, equations]), 1, when
        )
    )
    joints, found = m.core.joint_poses(np.ascontiguousarray(q)), {}
    for index, placed in enumerate(m.tree.frames):
        if not placed.frame.variables:
            continue
        wrench = forces[:, [column[_name(placed.name, cut_by.__name__)] for cut_by in _CUTS]].reshape(-1, 2, 3)
        before, here = poses_of(m.tree, placed.parent, joints), poses_of(m.tree, index, joints)
        force, torque = np.einsum("nij,nkj->kni", before[:, :3, :3], wrench)
        torque = torque + np.cross(before[:, :3, 3] - here[:, :3, 3], force)
        found[placed.name] = np.concatenate([force, torque], axis=1)
    return found


def _name(frame: str, slide: str) -> str:
    return f"{frame} cut {slide}"


def _cut(m: Mechanism) -> Mechanism:
    """Return the mechanism with six prescribed coordinates before each joint."""
    behind: dict[int, list[Any]] = {i: [] for i in range(len(m.tree.frames))}
    tree = list(enumerate(m.tree.frames))
    for index, placed in reversed(tree[1:]):
        own: list[Any] = [replace(placed.frame, name=placed.name, group=None)]
        if behind[index]:
            own.append(behind[index])
        if placed.frame.variables:
            for slide in reversed(_CUTS):
                own = [slide(_name(placed.name, slide.__name__), kinematic=True), own]
        behind[placed.parent] = own + behind[placed.parent]
    return Mechanism(behind[0], list(m.elements.values()), inputs=m.inputs)
