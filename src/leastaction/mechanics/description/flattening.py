"""From a description to frames and joints: names, order, and the merging of constant frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.branch import Branch, check_once, preorder, read_nested
from leastaction.mechanics.description.frames import PRIMITIVES, Frame, Group
from leastaction.mechanics.description.poses import constant_matrix, exponential
from leastaction.mechanics.description.tree import WORLD, Ball, Joint, Tree, TreeFrame
from leastaction.numerics.arrays import Array

_EYE = np.eye(4)
_EYE.setflags(write=False)


def flatten(description: Branch | Sequence[Any]) -> Tree:
    """Flatten a description into frames and joints.

    Parameters
    ----------
    description : nested list of Frame, or Branch
        Any place of a tree of chained calls stands for the whole tree.

    Returns
    -------
    Tree

    Raises
    ------
    DescriptionError
        For a frame that stands in two places, a name that is used twice, a variable that is dynamic in one
        place and kinematic in another, or anything that is not a description.
    """
    if isinstance(description, Branch):
        root = description.root
    else:
        root = Branch(None)
        read_nested(description, root)
    places, parents = preorder(root)
    specs = [place.frame for place in places[1:] if place.frame is not None]
    seen: set[int] = set()
    for spec in specs:
        check_once(spec, seen)
    return place_frames(_names(root.world_name, specs, parents[1:]), specs, parents[1:])


def _names(world: str, specs: Sequence[Frame], parents: Sequence[int]) -> list[str]:
    """Name every frame: the given names, and for the others a readable one that depends on the tree only.

    A frame with a variable is called after it, ``rz(theta)``; a constant frame after its parent,
    ``cart/ty(-1)``. What is still the same gets a number, ``cart/ty(-1)#2``.
    """
    given: dict[str, Frame | None] = {world: None}
    for spec in specs:
        if spec.name is None:
            continue
        if spec.name in given:
            other = given[spec.name]
            first = "the world frame" if other is None else other.label
            raise DescriptionError(
                f"duplicate frame name {spec.name!r}: given to {first} and to {spec.label}; "
                "frame names are unique in a mechanism"
            )
        given[spec.name] = spec
    taken = set(given)
    names = [world]
    for spec, parent in zip(specs, parents, strict=True):
        if spec.name is not None:
            names.append(spec.name)
            continue
        stem = spec.label if spec.variables else f"{names[parent]}/{spec.label}"
        name, number = stem, 1
        while name in taken:
            number += 1
            name = f"{stem}#{number}"
        taken.add(name)
        names.append(name)
    return names


def place_frames(names: Sequence[str], specs: Sequence[Frame], parents: Sequence[int]) -> Tree:
    """Return the tree of frames with settled names; the world has the first, and parent 0."""
    frames = [TreeFrame(names[0], -1, Frame("world", matrix=_EYE, name=names[0]), WORLD, _EYE)]
    joints: list[Joint] = []
    kinds: dict[str, tuple[bool, str]] = {}
    for name, spec, parent in zip(names[1:], specs, parents, strict=True):
        carrier = frames[parent]
        if spec.coordinate is None or not spec.coordinate.terms:
            pose = _behind(carrier.pose, spec, name, names[parent])
            frames.append(TreeFrame(name, parent, spec, carrier.joint, pose))
            continue
        assert spec.twist is not None
        variables = spec.variables
        for variable in variables:
            _same_kind(kinds, variable, variable in spec.kinematic, name)
        joints.append(
            Joint(
                frame=len(frames),
                parent=carrier.joint,
                pose=carrier.pose,
                twist=spec.twist,
                coordinate=spec.coordinate,
                kinematic=len(spec.kinematic) == len(variables),
            )
        )
        frames.append(TreeFrame(name, parent, spec, len(joints) - 1, _EYE))
    dynamic = tuple(variable for variable, (kinematic, _) in kinds.items() if not kinematic)
    groups: dict[int, tuple[Group, list[int]]] = {}
    for index, frame in enumerate(frames):
        group = frame.spec.group
        if group is not None:
            groups.setdefault(id(group), (group, []))[1].append(index)
    compositions = tuple((group, tuple(indices)) for group, indices in groups.values())
    return Tree(
        tuple(frames),
        tuple(joints),
        dynamic,
        tuple(variable for variable, (kinematic, _) in kinds.items() if kinematic),
        compositions,
        _balls(frames, compositions, dynamic),
    )


def _balls(
    frames: Sequence[TreeFrame],
    compositions: Sequence[tuple[Group, tuple[int, ...]]],
    dynamic: Sequence[str],
) -> tuple[Ball, ...]:
    balls = []
    for group, indices in compositions:
        if len(group.axes) != 3:
            continue
        specs = [frames[index].spec for index in indices[-3:]]
        outer, middle, inner = (s.coordinate for s in specs if s.coordinate is not None)
        balls.append(
            Ball(
                name=group.name,
                angles=(outer, middle, inner),
                singular=0.0 if group.axes[0] == group.axes[2] else np.pi / 2.0,
                watched=all(not set(a.names).isdisjoint(dynamic) for a in (outer, inner)),
            )
        )
    return tuple(balls)


def _same_kind(
    kinds: dict[str, tuple[bool, str]], variable: str, kinematic: bool, frame: str
) -> None:
    """Note whether a variable is kinematic and where; complain if another frame says otherwise."""
    before, first = kinds.setdefault(variable, (kinematic, frame))
    if before != kinematic:
        words = ("dynamic", "kinematic")
        raise DescriptionError(
            f"the variable {variable!r} is {words[before]} in the frame {first!r} and {words[kinematic]} in "
            f"{frame!r}; mark it kinematic in every frame that it moves or in none, or give each frame a "
            "variable of its own"
        )


def _behind(carrier: Array, spec: Frame, name: str, parent: str) -> Array:
    """Return the pose of a constant frame whose parent has the pose `carrier`."""
    with np.errstate(over="ignore", invalid="ignore"):
        pose = carrier @ _constant(spec)
    if not np.isfinite(pose).all():
        raise DescriptionError(
            f"frame {name!r}: its constant pose is too far from {parent!r} to compute with; give smaller numbers"
        )
    pose.setflags(write=False)
    return pose


def _constant(spec: Frame) -> Array:
    if spec.matrix is not None:
        return spec.matrix
    assert spec.coordinate is not None
    assert spec.twist is not None
    if spec.transform in PRIMITIVES:
        return constant_matrix(spec.transform, spec.coordinate.offset)
    return exponential(spec.twist, spec.coordinate.offset)
