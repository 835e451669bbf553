"""Refuse dynamic variables that move no mass, before the equations of motion meet them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from leastaction import _core
from leastaction.errors import DescriptionError, some
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.tree import WORLD, Tree
from leastaction.numerics.arrays import Array

# Bound on the rounding of an inertia, as a multiple of the unit roundoff and of the terms that it sums.
ROUNDING = 256.0 * float(np.finfo(np.float64).eps)
# Distance (m) from the world's origin beyond which rounding may hide the inertia of a turn.
FAR = 1e4
# Singular value of normalised factors below which couplings count as dependent.
DEPENDENT = 1e-9


def check_matter(tree: Tree, rotors: Sequence[Mapping[str, float]]) -> list[int]:
    """Return the joints that move a mass or an inertia; see `check_masses`.

    Raises `DescriptionError`: a dynamic variable behind which nothing has a mass.
    """
    # Whether there is any, not how much: sums of what is there could overflow.
    matter = np.zeros((len(tree.joints), 2))
    for index, body, _ in tree.bodies():
        if index != WORLD:
            matter[index] += body.mass > 0.0, body.inertia.any()
    massive = zip(tree.joints, tree.subtree_sums(matter), strict=True)
    joints = [i for i, (each, (mass, inertia)) in enumerate(massive) if mass or (inertia and each.twist[3:].any())]
    moved = {name for index in joints for name in tree.joints[index].variables}.union(*rotors)
    for name in tree.dynamic:
        if name not in moved:
            raise _massless(tree, name, "where nothing has a mass")
    return joints


def check_masses(
    tree: Tree,
    rotors: Sequence[Mapping[str, float]],
    variables: Sequence[str],
    core: _core.Mechanism,
    before: _core.Mechanism | None = None,
) -> None:
    """Raise a `DescriptionError` if a dynamic variable, or a combination of them, moves no mass.

    First of all where nothing that it moves has a mass; then also where only the numbers show it, as of a
    rotation whose axis passes through every point mass that it turns. Two configurations of no special
    shape tell: what vanishes at both vanishes everywhere.

    ``rotors``: the factors by which others than the bodies are moved. ``variables``: names in the order of v. ``core``:
    the compiled mechanism. ``before``: the same with other numbers, which was checked: the numbers are looked at again
    only where an inertia has changed beyond its size.
    """
    bodies = [(joint, body, pose) for joint, body, pose in tree.bodies() if joint != WORLD]
    _check_couplings(tree, check_matter(tree, rotors), rotors)

    nd = len(tree.dynamic)
    coordinates = tree.coordinates(variables)
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(coordinates)))
    for rotation in tree.rotations:
        first = coordinates.index(rotation.quaternion[0])
        samples[:, first : first + 4] /= np.linalg.norm(samples[:, first : first + 4], axis=1, keepdims=True)
    if before is not None:
        was, now = (m.inertias(samples[0])[:nd] for m in (before, core))
        if np.all((now > 1e-6 * was) & (now < 1e6 * was)):
            return
    seen = np.zeros(nd, dtype=bool)
    for q in samples:
        inertias = core.inertias(q)[:nd]
        for name, value in zip(variables, inertias, strict=False):
            if not np.isfinite(value):
                raise DescriptionError(
                    f"the inertia that the variable {name!r} moves is {value}: a mass, an inertia, a distance or "
                    f"a factor in {_frames(tree, [name])} or beyond is too large to compute with; check its unit"
                )
        # The inertia of a variable that moves several joints is that of their motions together, so its
        # rounding is bounded as the square of a sum.
        roots = dict.fromkeys(variables, 0.0)
        # What overflows is infinite, and refused above.
        with np.errstate(over="ignore", invalid="ignore"):
            bounds = np.sqrt(_rounding(tree, bodies, core.joint_poses(q[None, :])[0]))
            for joint, bound in zip(tree.joints, bounds, strict=True):
                for name, factor in joint.coordinate.terms:
                    roots[name] += abs(factor) * bound
            seen |= inertias > np.array([roots[name] for name in variables[:nd]]) ** 2
    for name, has_inertia in zip(variables, seen, strict=False):
        if has_inertia:
            continue
        placed = core.joint_poses(samples[:1])[0][:, :3, 3]
        away = max(
            float(np.linalg.norm(place)) for j, place in zip(tree.joints, placed, strict=True) if name in j.variables
        )
        if away > FAR:
            raise DescriptionError(
                f"the inertia that the variable {name!r} moves is lost to rounding: the frame {_frames(tree, [name])} "
                f"is {away:.3g} m from the world's origin; put the origin near the mechanism"
            )
        raise _massless(tree, name, "whose point masses all lie on its axis, or whose motions cancel each other")


def _check_couplings(tree: Tree, joints: Sequence[int], rotors: Sequence[Mapping[str, float]]) -> None:
    """Raise if some motion of the coupled variables leaves all these joints and rotors still, which move masses."""
    dynamic = set(tree.dynamic)
    movers = [*(tree.joints[index].variables for index in joints), *(tuple(factors) for factors in rotors)]
    coupled = {name for names in movers if len(pair := dynamic.intersection(names)) > 1 for name in pair}
    # A variable that has a joint of its own is determined by it.
    alone = {names[0] for names in movers if len(names) == 1}
    names = [name for name in tree.dynamic if name in coupled - alone]
    if not names:
        return
    joints = [index for index in joints if not coupled.isdisjoint(tree.joints[index].variables)]
    E, _ = tree.coupling(joints, names)
    E = np.vstack([E, *([factors.get(name, 0.0) for name in names] for factors in rotors)])
    columns = E / np.abs(E).max(axis=0)
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


def _rounding(tree: Tree, bodies: Sequence[tuple[int, Body, Array]], poses: Array) -> Array:
    """Bound on the rounding of the inertia that each joint sees, summed in world coordinates."""
    terms = np.zeros((len(tree.joints), 2))
    if bodies:
        joints = np.array([joint for joint, _, _ in bodies])
        coms = np.array([np.append(body.com, 1.0) for _, body, _ in bodies])
        masses = np.array([body.mass for _, body, _ in bodies])
        moments = np.array([body.inertia.trace() for _, body, _ in bodies])
        places = poses[joints] @ np.array([pose for _, _, pose in bodies])
        squares = np.sum((places @ coms[:, :, None])[:, :3, 0] ** 2, axis=1)
        np.add.at(terms, joints, np.stack([masses, masses * squares + moments], axis=1))
    mass, inertia = tree.subtree_sums(terms).T
    twists = np.array([joint.twist for joint in tree.joints]).reshape(-1, 6)
    slide = np.linalg.norm(twists[:, :3], axis=1)
    turn = np.linalg.norm(twists[:, 3:], axis=1)
    speed = slide + turn * np.linalg.norm(poses[:, :3, 3], axis=1)
    bound: Array = ROUNDING * (turn**2 * inertia + mass * speed**2)
    return bound


def _massless(tree: Tree, variable: str, why: str) -> DescriptionError:
    turned = next((each.name for each in tree.rotations if variable in each.variables), None)
    if turned is not None:
        return DescriptionError(
            f"massless joint {turned!r}: by {variable!r} it turns what hangs on it, {why}, so no acceleration of it is "
            "determined. Put a mass with an inertia there, make the joint kinematic, or remove it"
        )
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
        repr(tree.frames[joint.frame].name) for joint in tree.joints if not set(variables).isdisjoint(joint.variables)
    ]
    return some(moved, 8)
