"""The flattened form of a description: frames, and the joints that move them.

The core knows joints only: a coordinate each (a linear expression of variables), a twist, and a constant
pose in the moved frame of the parent joint. A frame without a variable costs nothing at run time: it is a
constant pose on the joint that carries it. Joints are in the core's order: those with a mass somewhere behind them in
depth-first preorder, then the others, which only move points. Parents come before children.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from leastaction.mechanics.description.affine import Affine
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.frames import QUATERNION, Frame, Group
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import restore_state, saved_state

WORLD = -1  # the joint that carries what is fixed in the world


@dataclass(frozen=True)
class TreeFrame:
    """A frame of the flattened tree.

    ``name``: unique. ``parent``: index of the parent frame, -1 for the world frame itself.
    ``frame``: the description. ``joint``: index of the joint that carries it, -1 for
    the world. ``pose``: constant pose (4, 4) in the moved frame of that joint.
    """

    name: str
    parent: int
    frame: Frame
    joint: int
    pose: Array

    __getstate__, __setstate__ = saved_state, restore_state


@dataclass(frozen=True)
class TreeJoint:
    """A joint of the flattened tree.

    ``frame``: index of the frame that it moves. ``parent``: the joint before it, -1 for the world. ``pose``: its base
    (4, 4) in the moved frame of the parent. ``twist``: [v; w] (6,) in the base. ``coordinate``: how far along it, a
    linear expression of variables. ``kinematic``: whether all of these are prescribed.
    """

    frame: int
    parent: int
    pose: Array
    twist: Array
    coordinate: Affine
    kinematic: bool

    __getstate__, __setstate__ = saved_state, restore_state

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables that move it; at least one."""
        return self.coordinate.names


@dataclass(frozen=True)
class BallAngles:
    """Three rotations one behind the other, of a `ball` or a `free` joint.

    ``name``: name of the joint. ``angles``: the outer, middle and inner angle (rad). ``singular``: its angles are not
    determined where the middle angle is this or differs from it by a multiple of pi. ``watched``: whether dynamic
    variables move both the outer and the inner angle, so that the singularity matters.
    """

    name: str
    angles: tuple[Affine, Affine, Affine]
    singular: float
    watched: bool

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables of its three angles, each once."""
        return tuple(dict.fromkeys(name for angle in self.angles for name in angle.names))


@dataclass(frozen=True)
class BallRotation:
    """The rotation of a `ball` or a `free` joint that is a unit quaternion.

    ``name``: name of the joint. ``variables``: of the angular velocity in the axes of the moved frame. ``joint``: the
    first of the three joints, rx, ry and rz, that it is for the core.
    """

    name: str
    variables: tuple[str, ...]
    joint: int

    @property
    def quaternion(self) -> tuple[str, ...]:
        """The names of its four numbers, scalar first."""
        return tuple(f"{self.name}.q{letter}" for letter in "wxyz")


@dataclass(frozen=True)
class Tree:
    """A flattened description.

    ``frames``: in depth-first preorder, the world first. ``joints``: those that move a mass in depth-first preorder,
    then the others. ``dynamic``, ``kinematic``: names of the variables in the order that the tree meets them.
    ``compositions``: the universal, ball and free joints, with the indices of their frames from the outermost on.
    ``balls``: the ball joints, those of free joints too.
    """

    frames: tuple[TreeFrame, ...]
    joints: tuple[TreeJoint, ...]
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    compositions: tuple[tuple[Group, tuple[int, ...]], ...]
    balls: tuple[BallAngles, ...]

    @cached_property
    def rotations(self) -> tuple[BallRotation, ...]:
        """The rotations that are quaternions, in the order of the tree."""
        found = []
        for group, indices in self.compositions:
            if group.axes != QUATERNION:
                continue
            first, *_ = joints = [self.frames[index].joint for index in indices[-3:]]
            found.append(BallRotation(group.name, tuple(self.joints[i].variables[0] for i in joints), first))
        return tuple(found)

    def coordinates(self, variables: Sequence[str]) -> tuple[str, ...]:
        """Return the names of the entries of a configuration: the variables, and in place of turns their quaternion."""
        quaternions = {rotation.variables[0]: rotation.quaternion for rotation in self.rotations}
        turns = {name for rotation in self.rotations for name in rotation.variables}
        names: list[str] = []
        for name in variables:
            names += quaternions.get(name, () if name in turns else (name,))
        return tuple(names)

    @cached_property
    def named(self) -> tuple[str, ...]:
        """The names of the frames that a user knows: all but those within a rotation that is a quaternion."""
        within = {i for group, found in self.compositions if group.axes == QUATERNION for i in found[-3:-1]}
        return tuple(placed.name for index, placed in enumerate(self.frames) if index not in within)

    @cached_property
    def index(self) -> dict[str, int]:
        """The index of each frame by its name."""
        return {placed.name: index for index, placed in enumerate(self.frames)}

    def coupling(self, joints: Sequence[int], variables: Sequence[str]) -> tuple[Array, Array]:
        """Return E (len(joints), len(variables)) and s0 of the joint coordinates ``s = E q + s0``.

        ``joints``: the joints asked for. ``variables``: the variables asked for, in the order of the columns.
        """
        column = {name: index for index, name in enumerate(variables)}
        E, s0 = np.zeros((len(joints), len(variables))), np.zeros(len(joints))
        for row, joint in enumerate(joints):
            coordinate = self.joints[joint].coordinate
            s0[row] = coordinate.offset
            for name, factor in coordinate.terms:
                if name in column:
                    E[row, column[name]] = factor
        return E, s0

    def bodies(self) -> list[tuple[int, Body, Array]]:
        """Every body with the index of its joint and the constant pose of its frame there."""
        return [(placed.joint, body, placed.pose) for placed in self.frames for body in placed.frame.bodies]

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
