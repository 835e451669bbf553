"""Where the frames of a mechanism are, and how the joints on the way to one move it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.mechanics.description.tree import WORLD, Tree
from leastaction.mechanics.mechanism.arguments import Compiled, frame_index
from leastaction.numerics.arrays import Array, as_array, as_choice

Axes = Literal["world", "frame"]


def poses_of(tree: Tree, frame: int, joints: Array) -> Array:
    """Return the poses (N, 4, 4) of a frame from those of all joints (N, nj, 4, 4)."""
    placed = tree.frames[frame]
    if placed.joint == WORLD:
        return np.broadcast_to(placed.pose, (len(joints), 4, 4)).copy()
    return joints[:, placed.joint] @ placed.pose


def inverted(poses: Array) -> Array:
    """Return the inverses of poses (N, 4, 4)."""
    result = np.zeros_like(poses)
    back = poses[:, :3, :3].swapaxes(1, 2)
    result[:, :3, :3], result[:, :3, 3:], result[:, 3, 3] = back, -back @ poses[:, :3, 3:], 1.0
    return result


def origins_of(tree: Tree, frames: Sequence[int], joints: Array) -> Array:
    """Return the origins (N, len(frames), 3) of frames from the poses of all joints."""
    points = np.empty((len(joints), len(frames), 3))
    for column, frame in enumerate(frames):
        points[:, column] = poses_of(tree, frame, joints)[:, :3, 3]
    return points


@dataclass(frozen=True)
class PathMotion:
    """How the joints on the way from the world to a frame move a point of it, at N configurations.

    ``twists`` (N, n, 6): of these joints, in the world. ``by_joints`` (N, 6, n): velocity of the point, and angular
    velocity, by the joints' coordinates, in world axes. ``order`` (n,): what of the joints is nearer to the world; of
    the three of a rotation that is a quaternion none is. ``E`` (n, nv): the coordinates by the variables. ``point``
    (3,): in the frame. ``poses`` (N, 4, 4): of the frame. ``turn`` (N, 3, 3): its rotation, if the velocities are
    wanted in its axes.
    """

    twists: Array
    by_joints: Array
    order: NDArray[np.intp]
    E: Array
    point: Array
    poses: Array
    turn: Array | None

    @classmethod
    def of(cls, m: Compiled, q: Array, frame: str, point: ArrayLike, axes: Axes) -> PathMotion:
        """Look at a point (3,) of a frame at configurations q (N, nq)."""
        index, offset = frame_index(m, frame), as_array(point, "point", (3,))
        as_choice(axes, "axes", get_args(Axes))
        path = m.tree.ancestors(m.tree.frames[index].joint)[::-1]
        poses = poses_of(m.tree, index, m.core.joint_poses(q))
        place = poses[:, :3, :3] @ offset + poses[:, :3, 3]
        twists = m.core.joint_twists(q)[:, list(path)]
        linear = twists[:, :, :3] + np.cross(twists[:, :, 3:], place[:, None, :])
        by_joints = np.concatenate([linear, twists[:, :, 3:]], axis=2).swapaxes(1, 2)
        E, _ = m.tree.coupling(path, m.variables)
        first = {rotation.joint + i: rotation.joint for rotation in m.tree.rotations for i in range(3)}
        order = np.array([path.index(first.get(joint, joint)) for joint in path], dtype=np.intp)
        return cls(twists, by_joints, order, E, offset, poses, poses[:, :3, :3] if axes == "frame" else None)

    def in_axes(self) -> Array:
        """Return the velocities by the joints' coordinates (N, 6, n), in the axes that are wanted."""
        return _turned(self.turn, self.by_joints)

    def jacobian(self) -> Array:
        """Return the Jacobian (N, 6, nv)."""
        return self.in_axes() @ self.E

    def velocity(self, v: Array) -> Array:
        """Return the velocities (N, 6) for those of the variables (N, nv)."""
        velocity: Array = np.einsum("nai,ni->na", self.in_axes(), v @ self.E.T)
        return velocity

    def jacobian_derivative(self) -> Array:
        """Return the derivative (N, 6, nv, nv) of the Jacobian by the variables, or by turns of quaternions."""
        linear, w = self.by_joints[:, :3].swapaxes(1, 2), self.twists[:, :, 3:]
        count, n = linear.shape[:2]
        result = np.empty((count, 6, n, n))
        # A joint j that is not farther from the world than i turns what i moves, and the axis of i; one that is farther
        # is turned itself.
        turns = (self.order[None, :] <= self.order[:, None])[:, :, None]
        moved = np.cross(w[:, None, :], linear[:, :, None])
        result[:, :3] = np.moveaxis(np.where(turns, moved, moved.swapaxes(1, 2)), 3, 1)
        result[:, 3:] = np.moveaxis(np.cross(w[:, None, :], w[:, :, None]) * turns, 3, 1)
        if self.turn is not None:
            # The axes turn with the frame: d(R^T x) = R^T (dx - w_j x x).
            angular = self.by_joints[:, 3:].swapaxes(1, 2)
            for half, moved in ((slice(0, 3), linear), (slice(3, 6), angular)):
                along = np.cross(w[:, None, :], moved[:, :, None])
                result[:, half] -= np.moveaxis(along, 3, 1)
            flat = result.reshape(count, 6, n * n)
            result = _turned(self.turn, flat).reshape(result.shape)
        derivative: Array = self.E.T @ result @ self.E
        return derivative


def _turned(turn: Array | None, velocities: Array) -> Array:
    """Return velocities (N, 6, n) in the axes of a frame whose rotation is (N, 3, 3)."""
    if turn is None:
        return velocities
    back = turn.swapaxes(1, 2)
    return np.concatenate([back @ velocities[:, :3], back @ velocities[:, 3:]], axis=1)
