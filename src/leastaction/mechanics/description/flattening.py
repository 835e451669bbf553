"""From a description to frames and joints: names, order, and the merging of constant frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.branch import Branch, check_once, preorder, read_nested
from leastaction.mechanics.description.frames import PRIMITIVES, Frame, Group
from leastaction.mechanics.description.poses import constant_matrix, exponential
from leastaction.mechanics.description.tree import WORLD, BallAngles, Tree, TreeFrame, TreeJoint
from leastaction.numerics.arrays import Array

_EYE = np.eye(4)
_EYE.setflags(write=False)


def flatten(description: Branch | Sequence[Any]) -> Tree:
    """Flatten a description into frames and joints.

    ``description``: any place of a tree of chained calls stands for the whole tree. Raises `DescriptionError` for a
    frame that stands in two places, a name that is used twice, a variable that is dynamic in one place and kinematic in
    another, or anything that is not a description.
    """
    if isinstance(description, Branch):
        root = description.root
    else:
        root = Branch(None)
        read_nested(description, root)
    places, parents = preorder(root)
    frames = [place.frame for place in places[1:] if place.frame is not None]
    seen: set[int] = set()
    for frame in frames:
        check_once(frame, seen)
    return place_frames(frame_names(root.world_name, frames, parents[1:]), frames, parents[1:])


def frame_names(world: str, frames: Sequence[Frame], parents: Sequence[int]) -> list[str]:
    """Name every frame: the given names, and for the others a readable one that depends on the tree only.

    A frame with a variable is called after it, ``rz(theta)``; a constant frame after its parent,
    ``cart/ty(-1)``. What is still the same gets a number, ``cart/ty(-1)#2``.
    """
    given: dict[str, Frame | None] = {world: None}
    for frame in frames:
        if frame.name is None:
            continue
        if frame.name in given:
            other = given[frame.name]
            first = "the world frame" if other is None else other.label
            advice = "" if other is not None else "; begin with world('ground') to call the world something else"
            raise DescriptionError(
                f"duplicate frame name {frame.name!r}: given to {first} and to {frame.label}; "
                f"frame names are unique in a mechanism{advice}"
            )
        given[frame.name] = frame
    taken = set(given)
    names = [world]
    for frame, parent in zip(frames, parents, strict=True):
        if frame.name is not None:
            names.append(frame.name)
            continue
        stem = frame.label if frame.variables else f"{names[parent]}/{frame.label}"
        name, number = stem, 1
        while name in taken:
            number += 1
            name = f"{stem}#{number}"
        taken.add(name)
        names.append(name)
    return names


def place_frames(names: Sequence[str], frames: Sequence[Frame], parents: Sequence[int]) -> Tree:
    """Return the tree of frames with settled names; the world has the first, and parent 0."""
    placed = [TreeFrame(names[0], -1, Frame("world", matrix=_EYE, name=names[0]), WORLD, _EYE)]
    joints: list[TreeJoint] = []
    kinds: dict[str, tuple[bool, str]] = {}
    for name, frame, parent in zip(names[1:], frames, parents, strict=True):
        carrier = placed[parent]
        if frame.coordinate is None or not frame.coordinate.terms:
            pose = _behind(carrier.pose, frame, name, names[parent])
            placed.append(TreeFrame(name, parent, frame, carrier.joint, pose))
            continue
        assert frame.twist is not None
        variables = frame.variables
        for variable in variables:
            _same_kind(kinds, variable, variable in frame.kinematic, name)
        joints.append(
            TreeJoint(
                frame=len(placed),
                parent=carrier.joint,
                pose=carrier.pose,
                twist=frame.twist,
                coordinate=frame.coordinate,
                kinematic=len(frame.kinematic) == len(variables),
            )
        )
        placed.append(TreeFrame(name, parent, frame, len(joints) - 1, _EYE))
    placed, joints = _massive_first(placed, joints)
    dynamic = tuple(variable for variable, (kinematic, _) in kinds.items() if not kinematic)
    groups: dict[int, tuple[Group, list[int]]] = {}
    for index, at in enumerate(placed):
        group = at.frame.group
        if group is not None:
            groups.setdefault(id(group), (group, []))[1].append(index)
    compositions = tuple((group, tuple(indices)) for group, indices in groups.values())
    return Tree(
        tuple(placed),
        tuple(joints),
        dynamic,
        tuple(variable for variable, (kinematic, _) in kinds.items() if kinematic),
        compositions,
        _balls(placed, compositions, dynamic),
    )


def _massive_first(frames: list[TreeFrame], joints: list[TreeJoint]) -> tuple[list[TreeFrame], list[TreeJoint]]:
    """Put the joints with a mass somewhere behind them before those without."""
    massive = [False] * len(joints)
    for at in frames:
        if at.joint != WORLD and any(body.is_massive for body in at.frame.bodies):
            massive[at.joint] = True
    for index in reversed(range(len(joints))):
        if massive[index] and joints[index].parent != WORLD:
            massive[joints[index].parent] = True
    if massive == sorted(massive, reverse=True):
        return frames, joints
    order = sorted(range(len(joints)), key=lambda index: not massive[index])
    place = {WORLD: WORLD, **{index: i for i, index in enumerate(order)}}
    return (
        [replace(at, joint=place[at.joint]) for at in frames],
        [replace(joints[index], parent=place[joints[index].parent]) for index in order],
    )


def _balls(
    frames: Sequence[TreeFrame], compositions: Sequence[tuple[Group, tuple[int, ...]]], dynamic: Sequence[str]
) -> tuple[BallAngles, ...]:
    balls = []
    for group, indices in compositions:
        if len(group.axes) != 3:
            continue
        turns = [frames[index].frame.coordinate for index in indices[-3:]]
        outer, middle, inner = (turn for turn in turns if turn is not None)
        balls.append(
            BallAngles(
                name=group.name,
                angles=(outer, middle, inner),
                singular=0.0 if group.axes[0] == group.axes[2] else np.pi / 2.0,
                watched=all(not set(a.names).isdisjoint(dynamic) for a in (outer, inner)),
            )
        )
    return tuple(balls)


def _same_kind(kinds: dict[str, tuple[bool, str]], variable: str, kinematic: bool, frame: str) -> None:
    """Note whether a variable is kinematic and where; complain if another frame says otherwise."""
    before, first = kinds.setdefault(variable, (kinematic, frame))
    if before != kinematic:
        words = ("dynamic", "kinematic")
        raise DescriptionError(
            f"the variable {variable!r} is {words[before]} in the frame {first!r} and {words[kinematic]} in "
            f"{frame!r}; mark it kinematic in every frame that it moves or in none, or give each frame a "
            "variable of its own"
        )


def _behind(carrier: Array, frame: Frame, name: str, parent: str) -> Array:
    """Return the pose of a constant frame whose parent has the pose `carrier`."""
    with np.errstate(over="ignore", invalid="ignore"):
        pose = carrier @ _constant(frame)
    if not np.isfinite(pose).all():
        raise DescriptionError(
            f"frame {name!r}: its constant pose is too far from {parent!r} to compute with; give smaller numbers"
        )
    pose.setflags(write=False)
    return pose


def _constant(frame: Frame) -> Array:
    if frame.matrix is not None:
        return frame.matrix
    assert frame.coordinate is not None
    assert frame.twist is not None
    if frame.transform in PRIMITIVES:
        return constant_matrix(frame.transform, frame.coordinate.offset)
    return exponential(frame.twist, frame.coordinate.offset)
