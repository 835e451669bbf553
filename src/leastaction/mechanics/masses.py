"""Refuse dynamic variables that move no mass, before the equations of motion meet them.

`check_structure` looks at the tree alone; `check_inertia` at the compiled mechanism, and finds what only
the numbers show: a rotation whose axis passes through every point mass that it turns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction import _core
from leastaction.errors import DescriptionError
from leastaction.mechanics.arguments import Array
from leastaction.mechanics.tree import WORLD, Joint, Tree

# Bound on the rounding of an inertia, as a multiple of the unit roundoff and of the terms that it sums.
ROUNDING = 256.0 * float(np.finfo(np.float64).eps)


def check_structure(tree: Tree) -> None:
    """Raise a `DescriptionError` if nothing beyond the joint of a dynamic variable has mass."""
    matter = np.zeros((len(tree.joints), 2))
    for joint, body, _ in tree.bodies():
        if joint != WORLD:
            matter[joint] += body.mass, np.trace(body.inertia)
    for spec, (mass, inertia) in zip(tree.joints, tree.subtree_sums(matter), strict=True):
        turns = bool(spec.twist[3:].any())
        if not spec.kinematic and mass == 0.0 and not (turns and inertia > 0.0):
            raise _massless(tree, spec, "where nothing has a mass")


def check_inertia(tree: Tree, variables: Sequence[str], core: _core.Mechanism) -> None:
    """Raise a `DescriptionError` if the inertia that a dynamic variable sees vanishes everywhere.

    Two configurations of no special shape tell: what vanishes at both vanishes everywhere.
    """
    order = {name: index for index, name in enumerate(variables)}
    columns = [order[joint.variable] for joint in tree.joints]
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(variables)))
    seen = np.zeros(len(tree.joints), dtype=bool)
    for q in samples:
        inertia = np.diag(core.hessian(q, np.zeros(len(q)))[2])[columns]
        seen |= inertia > _rounding(tree, core.joint_poses(q[None, :])[0])
    for spec, has_inertia in zip(tree.joints, seen, strict=True):
        if not spec.kinematic and not has_inertia:
            raise _massless(tree, spec, "whose point masses all lie on its axis")


def _rounding(tree: Tree, poses: Array) -> Array:
    """Bound on the rounding of the inertia that each joint sees, summed in world coordinates."""
    terms = np.zeros((len(tree.joints), 2))
    for joint, body, pose in tree.bodies():
        if joint != WORLD:
            centre = (poses[joint] @ pose)[:3] @ np.append(body.com, 1.0)
            terms[joint] += body.mass, body.mass * (centre @ centre) + np.trace(body.inertia)
    mass, inertia = tree.subtree_sums(terms).T
    origins = np.array([pose[:3, 3] for pose in poses]).reshape(-1, 3)
    bound: Array = ROUNDING * (inertia + mass * np.sum(origins**2, axis=1))
    return bound


def _massless(tree: Tree, joint: Joint, why: str) -> DescriptionError:
    return DescriptionError(
        f"massless dynamic variable {joint.variable!r}: it moves the frame "
        f"{tree.frames[joint.frame].name!r} and what hangs on it, {why}, so no acceleration of it is "
        "determined. Put a mass (or an inertia) there, make the variable kinematic, or remove the frame"
    )
