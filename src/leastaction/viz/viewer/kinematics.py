"""How the joints of a mechanism move its frames, as plain data: the page has a slider for each variable."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array


def kinematics(m: Mechanism, q: Array, turn: Array, frames: Iterable[str], size: float) -> dict[str, Any] | None:
    """Return what the page moves a mechanism by; None for one that sliders would tear apart.

    That is one with constraints, or with a rotation that is a quaternion.

    ``q`` (nq,): where it stands. ``turn`` (3, 3): what makes it upright. ``frames``: those that are drawn. ``size``: of
    the mechanism (m), as far as slides go.

    The result has ``variables`` [name, value, low, high], ``joints`` [parent, pose, twist, terms, offset] with parents
    before children and terms [variable, factor], and ``frames`` {name: [joint, pose]}; poses are (3, 4) by columns.
    """
    if m.nc > 0 or m.nq == 0 or m.tree.rotations:
        return None
    whole = np.eye(4)
    whole[:3, :3] = turn
    index = {name: i for i, name in enumerate(m.variables)}
    turns = {name for joint in m.tree.joints if joint.twist[3:].any() for name in joint.variables}
    joints = [
        [
            joint.parent,
            _columns(whole @ joint.pose if joint.parent < 0 else joint.pose),
            joint.twist.tolist(),
            [[index[name], factor] for name, factor in joint.coordinate.terms],
            joint.coordinate.offset,
        ]
        for joint in m.tree.joints
    ]
    placed = {name: m.tree.frames[m.tree.index[name]] for name in frames}
    reach = {name: np.pi if name in turns else size for name in m.variables}
    return {
        "variables": [
            [name, float(x), float(min(-reach[name], x)), float(max(reach[name], x))]
            for name, x in zip(m.variables, q, strict=True)
        ],
        "joints": joints,
        "frames": {
            name: [at.joint, _columns(whole @ at.pose if at.joint < 0 else at.pose)] for name, at in placed.items()
        },
    }


def _columns(pose: Array) -> list[float]:
    return [float(f"{x:.9g}") for x in pose[:3].T.ravel()]
