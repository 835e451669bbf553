"""Refuse dynamic variables that move no mass, before the equations of motion meet them.

`check_structure` looks at the tree alone; `check_inertia` at the compiled mechanism, and finds what only
the numbers show: a rotation whose axis passes through every point mass that it turns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction import _core
from leastaction.errors import DescriptionError
from leastaction.mechanics.description.tree import WORLD, Tree
from leastaction.numerics.arrays import Array

# Bound on the rounding of an inertia, as a multiple of the unit roundoff and of the terms that it sums.
ROUNDING = 256.0 * float(np.finfo(np.float64).eps)
# Singular value of normalised factors below which couplings count as dependent.
DEPENDENT = 1e-9


def check_structure(tree: Tree) -> None:
    """Raise a `DescriptionError` if a dynamic variable, or a combination of them, moves nothing with mass."""
    # Whether there is any, not how much: sums of what is there could overflow.
    matter = np.zeros((len(tree.joints), 2))
    for joint, body, _ in tree.bodies():
        if joint != WORLD:
            matter[joint] += body.mass > 0.0, body.inertia.any()
    massive = [
        bool(mass or (inertia and joint.twist[3:].any()))
        for joint, (mass, inertia) in zip(tree.joints, tree.subtree_sums(matter), strict=True)
    ]
    moved = {
        name
        for joint, has in zip(tree.joints, massive, strict=True)
        if has
        for name in joint.variables
    }
    for name in tree.dynamic:
        if name not in moved:
            raise _massless(tree, name, "where nothing has a mass")
    _check_couplings(tree, massive)


def _check_couplings(tree: Tree, massive: Sequence[bool]) -> None:
    """Raise if some motion of the coupled variables leaves every joint still that moves a mass."""
    joints = [index for index, has in enumerate(massive) if has]
    dynamic = set(tree.dynamic)
    coupled = {
        name
        for index in joints
        if len(pair := dynamic.intersection(tree.joints[index].variables)) > 1
        for name in pair
    }
    # A variable that has a joint of its own is determined by it.
    alone = {
        tree.joints[index].variables[0]
        for index in joints
        if len(tree.joints[index].variables) == 1
    }
    names = [name for name in tree.dynamic if name in coupled - alone]
    if not names:
        return
    E, _ = tree.coupling(
        joints, [*names, *(n for n in (*tree.dynamic, *tree.kinematic) if n not in names)]
    )
    columns = E[:, : len(names)] / np.abs(E[:, : len(names)]).max(axis=0)
    _, sizes, directions = np.linalg.svd(columns)
    if len(columns) >= len(names) and sizes[-1] > DEPENDENT:
        return
    loose = [n for n, part in zip(names, directions[-1], strict=True) if abs(part) > DEPENDENT]
    raise DescriptionError(
        f"the dynamic variables {', '.join(map(repr, loose))} move masses only in combination, through the "
        f"frames {_frames(tree, loose)}: a motion of them is left that moves no mass, so no acceleration of "
        "it is determined. Replace them by one variable for each combination, make some of them kinematic, "
        "or give one of them a frame of its own that moves a mass"
    )


def check_inertia(tree: Tree, variables: Sequence[str], core: _core.Mechanism) -> None:
    """Raise a `DescriptionError` if the inertia that a dynamic variable sees vanishes everywhere.

    Two configurations of no special shape tell: what vanishes at both vanishes everywhere.
    """
    dynamic = len(tree.dynamic)
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(variables)))
    seen = np.zeros(dynamic, dtype=bool)
    for q in samples:
        inertia = np.diag(core.hessian(q, np.zeros(len(q)))[2])[:dynamic]
        # What overflows is compared as infinite, and refused below.
        with np.errstate(over="ignore", invalid="ignore"):
            bounds = _rounding(tree, core.joint_poses(q[None, :])[0])
        for name, value in zip(variables, inertia, strict=False):
            if not np.isfinite(value):
                raise DescriptionError(
                    f"the inertia that the variable {name!r} moves is {value}: a mass, an inertia, a distance or "
                    f"a factor in {_frames(tree, [name])} or beyond is too large to compute with; check its unit"
                )
        # The inertia of a variable that moves several joints is that of their motions together, so its
        # rounding is bounded as the square of a sum.
        roots = dict.fromkeys(variables, 0.0)
        for joint, bound in zip(tree.joints, np.sqrt(bounds), strict=True):
            for name, factor in joint.coordinate.terms:
                roots[name] += abs(factor) * bound
        seen |= inertia > [roots[name] ** 2 for name in variables[:dynamic]]
    for name, has_inertia in zip(variables, seen, strict=False):
        if not has_inertia:
            raise _massless(
                tree,
                name,
                "whose point masses all lie on its axis, or whose motions cancel each other",
            )


def recheck_inertia(
    tree: Tree, variables: Sequence[str], core: _core.Mechanism, before: _core.Mechanism
) -> None:
    """Do as `check_inertia` after numbers have changed: in full only if an inertia has changed beyond its size.

    Parameters
    ----------
    tree, variables, core
        As of `check_inertia`.
    before : _core.Mechanism
        The mechanism with the numbers before, which was checked.
    """
    q = np.random.default_rng(0).uniform(-1.0, 1.0, len(variables))
    was, now = (
        np.diag(m.hessian(q, np.zeros(len(q)))[2])[: len(tree.dynamic)] for m in (before, core)
    )
    if not np.all((now > 1e-6 * was) & (now < 1e6 * was)):
        check_inertia(tree, variables, core)


def _rounding(tree: Tree, poses: Array) -> Array:
    """Bound on the rounding of the inertia that each joint sees, summed in world coordinates."""
    terms = np.zeros((len(tree.joints), 2))
    for joint, body, pose in tree.bodies():
        if joint != WORLD:
            centre = (poses[joint] @ pose)[:3] @ np.append(body.com, 1.0)
            terms[joint] += body.mass, body.mass * (centre @ centre) + np.trace(body.inertia)
    mass, inertia = tree.subtree_sums(terms).T
    origins = np.array([pose[:3, 3] for pose in poses]).reshape(-1, 3)
    twists = np.array([joint.twist for joint in tree.joints]).reshape(-1, 6)
    slide = np.linalg.norm(twists[:, :3], axis=1)
    turn = np.linalg.norm(twists[:, 3:], axis=1)
    speed = slide + turn * np.linalg.norm(origins, axis=1)
    bound: Array = ROUNDING * (turn**2 * inertia + mass * speed**2)
    return bound


def _massless(tree: Tree, variable: str, why: str) -> DescriptionError:
    count = sum(variable in joint.variables for joint in tree.joints)
    return DescriptionError(
        f"massless dynamic variable {variable!r}: it moves the frame{'s' if count > 1 else ''} "
        f"{_frames(tree, [variable])} and what hangs on {'them' if count > 1 else 'it'}, {why}, so no "
        "acceleration of it is determined. Put a mass (or an inertia) there, make the variable kinematic, "
        "or remove the frame"
    )


def _frames(tree: Tree, variables: Sequence[str]) -> str:
    """Name the frames that any of the variables moves."""
    moved = [
        repr(tree.frames[joint.frame].name)
        for joint in tree.joints
        if not set(variables).isdisjoint(joint.variables)
    ]
    return ", ".join(moved[:8]) + (f" and {len(moved) - 8} more" if len(moved) > 8 else "")
