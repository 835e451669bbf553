"""From a description to joints: names, order, and the merging of constant frames.

The core knows joints only: one variable each, a twist, and a constant pose in the moved frame of the
parent joint. A frame without a variable costs nothing at run time: it is a constant pose on the joint
that carries it. Joints are in depth-first preorder, so parents come before children and every subtree
is a contiguous range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.arguments import Array
from leastaction.mechanics.bodies import Body
from leastaction.mechanics.branch import Branch, check_once, read_nested
from leastaction.mechanics.frames import PRIMITIVES, Frame

WORLD = -1  # the joint that carries what is fixed in the world


@dataclass(frozen=True)
class TreeFrame:
    """A frame of the flattened tree.

    ``name``: unique. ``parent``: index of the parent frame, -1 for the world frame itself.
    ``spec``: the description, None for the world. ``joint``: index of the joint that carries it, -1 for
    the world. ``pose``: constant pose (4, 4) in the moved frame of that joint.
    """

    name: str
    parent: int
    spec: Frame | None
    joint: int
    pose: Array


@dataclass(frozen=True)
class Joint:
    """A joint of the flattened tree.

    ``frame``: index of the frame that it moves. ``parent``: the joint before it, -1 for the world.
    ``pose``: its base (4, 4) in the moved frame of the parent. ``twist``: [v; w] (6,) in the base.
    ``variable``: name of its coordinate. ``kinematic``: whether that is prescribed.
    """

    frame: int
    parent: int
    pose: Array
    twist: Array
    variable: str
    kinematic: bool


@dataclass(frozen=True)
class Tree:
    """A flattened description.

    Attributes
    ----------
    frames : tuple of TreeFrame
        In depth-first preorder; the world first.
    joints : tuple of Joint
        In depth-first preorder.
    """

    frames: tuple[TreeFrame, ...]
    joints: tuple[Joint, ...]

    @property
    def dynamic(self) -> tuple[str, ...]:
        """Names of the dynamic variables in the order that the tree meets them."""
        return tuple(joint.variable for joint in self.joints if not joint.kinematic)

    @property
    def kinematic(self) -> tuple[str, ...]:
        """Names of the kinematic variables in the order that the tree meets them."""
        return tuple(joint.variable for joint in self.joints if joint.kinematic)

    def bodies(self) -> list[tuple[int, Body, Array]]:
        """Every body with the index of its joint and the constant pose of its frame there."""
        return [
            (frame.joint, body, frame.pose)
            for frame in self.frames
            if frame.spec is not None
            for body in frame.spec.bodies
        ]

    def ancestors(self, joint: int) -> tuple[int, ...]:
        """The joints from the given one (included) down to the world (not included)."""
        path = []
        while joint != WORLD:
            path.append(joint)
            joint = self.joints[joint].parent
        return tuple(path)

    def subtree_sums(self, values: Array) -> Array:
        """Return, for values of any shape (n_joints, ...), their sums over the subtree of each joint."""
        sums = values.copy()
        for index in reversed(range(len(self.joints))):
            parent = self.joints[index].parent
            if parent != WORLD:
                sums[parent] += sums[index]
        return sums


def constant_matrix(transform: str, value: float) -> Array:
    """Return the pose (4, 4) of a primitive transformation by a constant amount (m or rad)."""
    matrix = np.eye(4)
    axis = "xyz".index(transform[1])
    if transform[0] == "t":
        matrix[axis, 3] = value
    else:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = np.cos(value), np.sin(value)
        matrix[i, i] = matrix[j, j] = cosine
        matrix[i, j], matrix[j, i] = -sine, sine
    return matrix


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
        For a frame that stands in two places, a name or a variable that is used twice, or anything that
        is not a description.
    """
    if isinstance(description, Branch):
        root = description.root
    else:
        root = Branch(None)
        read_nested(description, root)
    specs, parents = _preorder(root)
    return _place(_names(root.world_name, specs, parents), specs, parents)


def _preorder(root: Branch) -> tuple[list[Frame], list[int]]:
    """Return the frames without the world, and for each the index of its parent (world = 0)."""
    specs: list[Frame] = []
    parents: list[int] = []
    seen: set[int] = set()
    stack = [(child, 0) for child in reversed(root.children)]
    while stack:
        place, parent = stack.pop()
        assert place.frame is not None
        check_once(place.frame, seen)
        specs.append(place.frame)
        parents.append(parent)
        stack.extend((child, len(specs)) for child in reversed(place.children))
    return specs, parents


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
        stem = spec.label if spec.variable is not None else f"{names[parent]}/{spec.label}"
        name, number = stem, 1
        while name in taken:
            number += 1
            name = f"{stem}#{number}"
        taken.add(name)
        names.append(name)
    return names


def _place(names: list[str], specs: Sequence[Frame], parents: Sequence[int]) -> Tree:
    frames = [TreeFrame(names[0], -1, None, WORLD, _frozen(np.eye(4)))]
    joints: list[Joint] = []
    driven: dict[str, str] = {}
    for name, spec, parent in zip(names[1:], specs, parents, strict=True):
        carrier = frames[parent]
        if spec.variable is None:
            if spec.matrix is not None:
                local = spec.matrix
            else:
                assert spec.value is not None
                local = constant_matrix(spec.transform, spec.value)
            frames.append(
                TreeFrame(name, parent, spec, carrier.joint, _frozen(carrier.pose @ local))
            )
            continue
        if spec.variable in driven:
            raise DescriptionError(
                f"the variable {spec.variable!r} drives two frames, {driven[spec.variable]!r} and "
                f"{name!r}; give each frame a variable of its own"
            )
        driven[spec.variable] = name
        twist = np.zeros(6)
        twist[PRIMITIVES.index(spec.transform)] = 1.0
        joints.append(
            Joint(
                frame=len(frames),
                parent=carrier.joint,
                pose=carrier.pose,
                twist=_frozen(twist),
                variable=spec.variable,
                kinematic=spec.kinematic,
            )
        )
        frames.append(TreeFrame(name, parent, spec, len(joints) - 1, _frozen(np.eye(4))))
    return Tree(tuple(frames), tuple(joints))


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array
