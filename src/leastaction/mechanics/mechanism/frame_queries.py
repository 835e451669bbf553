"""Where the frames of a mechanism are and how they move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.description.tree import WORLD
from leastaction.mechanics.mechanism.compiled import Compiled
from leastaction.numerics.arrays import Array, as_array

Axes = Literal["world", "frame"]


class FrameQueries(Compiled):
    """Poses, velocities and Jacobians of frames; see `Mechanism`, which offers them."""

    __slots__ = ()

    def frame_pose(self, q: npt.ArrayLike, name: str) -> Array:
        """Return the pose of a frame in the world.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        name : str
            The frame.

        Returns
        -------
        ndarray, shape (4, 4) or (N, 4, 4)
            Takes coordinates in the frame to coordinates in the world.
        """
        values, single = self._batch(q)
        poses = self._poses(self.core.joint_poses(values), self._frame(name))
        return poses[0] if single else poses

    def positions(self, q: npt.ArrayLike, names: Sequence[str] | None = None) -> Array:
        """Return the origins of frames in the world.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        names : sequence of str, optional
            The frames; all of them, in the order of `frames`, if not given.

        Returns
        -------
        ndarray, shape (len(names), 3) or (N, len(names), 3)
            Metres.
        """
        values, single = self._batch(q)
        if isinstance(names, str):
            raise ArgumentError(f"names: expected a list of frames, got the string {names!r}")
        indices = [self._frame(name) for name in (self.frames if names is None else names)]
        joints = self.core.joint_poses(values)
        points = np.empty((len(values), len(indices), 3))
        for column, index in enumerate(indices):
            points[:, column] = self._poses(joints, index)[:, :3, 3]
        return points[0] if single else points

    def frame_jacobian(
        self,
        q: npt.ArrayLike,
        frame: str,
        *,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        axes: Axes = "world",
    ) -> Array:
        """Return the Jacobian of a frame: its velocity is ``J v``.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        frame : str
            The frame.
        point : array_like, shape (3,), optional
            The point whose velocity is meant, in the frame (m); its origin if not given.
        axes : {"world", "frame"}, optional
            The axes in which the velocities are resolved.

        Returns
        -------
        ndarray, shape (6, nq) or (N, 6, nq)
            Linear velocity of the point, then angular velocity, by the velocity of every variable.

        Raises
        ------
        ArgumentError
            For an unknown frame, other axes or a wrong shape.
        """
        values, single = self._batch(q)
        _, jacobian, E, turn = self._path_jacobian(values, frame, point, axes)
        result = _turned(turn, jacobian) @ E
        return result[0] if single else result

    def frame_velocity(
        self,
        q: npt.ArrayLike,
        v: npt.ArrayLike,
        frame: str,
        *,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        axes: Axes = "world",
    ) -> Array:
        """Return the velocity of a frame.

        Parameters
        ----------
        q, v : array_like, shape (nq,) or (N, nq)
            Configuration and velocity, or batches of them.
        frame, point, axes
            As in `frame_jacobian`.

        Returns
        -------
        ndarray, shape (6,) or (N, 6)
            Linear velocity of the point (m/s), then angular velocity (rad/s).
        """
        values, single = self._batch(q)
        speeds, _ = self._batch(v, "v", rows=None if single else len(values))
        _, jacobian, E, turn = self._path_jacobian(values, frame, point, axes)
        result: Array = np.einsum("nai,ni->na", _turned(turn, jacobian), speeds @ E.T)
        return result[0] if single else result

    def frame_jacobian_derivative(
        self,
        q: npt.ArrayLike,
        frame: str,
        *,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        axes: Axes = "world",
    ) -> Array:
        """Return the derivative of `frame_jacobian` by the configuration.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        frame, point, axes
            As in `frame_jacobian`.

        Returns
        -------
        ndarray, shape (6, nq, nq) or (N, 6, nq, nq)
            Entry ``[a, i, j]`` is ``dJ[a, i] / dq_j``. The linear half in world axes is symmetric in i and j,
            being the second derivative of a position; the angular one is not, since an angular velocity is
            no derivative of anything.
        """
        values, single = self._batch(q)
        twists, jacobian, E, turn = self._path_jacobian(values, frame, point, axes)
        linear, w = jacobian[:, :3].swapaxes(1, 2), twists[:, :, 3:]
        n = linear.shape[1]
        # Of the joints i and j, the one nearer to the world turns what the other one moves.
        nearer = np.minimum.outer(np.arange(n), np.arange(n))
        farther = np.maximum.outer(np.arange(n), np.arange(n))
        by_joints = np.empty((len(values), 6, n, n))
        by_joints[:, :3] = np.moveaxis(np.cross(w[:, nearer], linear[:, farther]), 3, 1)
        # The axis of i is turned by the joints j nearer to the world than i.
        turned = np.cross(w[:, None, :], w[:, :, None])
        before = np.tri(n, k=-1)[:, :, None]
        by_joints[:, 3:] = np.moveaxis(turned * before, 3, 1)
        if turn is not None:
            # The axes turn with the frame: d(R^T x) = R^T (dx - w_j x x).
            angular = jacobian[:, 3:].swapaxes(1, 2)
            for half, moved in ((slice(0, 3), linear), (slice(3, 6), angular)):
                along = np.cross(w[:, None, :], moved[:, :, None])
                by_joints[:, half] -= np.moveaxis(along, 3, 1)
            by_joints = _turned(turn, by_joints.reshape(len(values), 6, n * n)).reshape(
                by_joints.shape
            )
        result: Array = E.T @ by_joints @ E
        return result[0] if single else result

    def _path_jacobian(
        self, q: Array, name: str, point: npt.ArrayLike, axes: Axes
    ) -> tuple[Array, Array, Array, Array | None]:
        """Return what moves a frame, over the joints from the world to it.

        Their twists (N, n, 6), the Jacobian (N, 6, n) by their coordinates in world axes, these by the
        variables (n, nq), and the rotation (N, 3, 3) of the frame if its axes are asked for.
        """
        if axes not in ("world", "frame"):
            raise ArgumentError(f"axes: got {axes!r}, expected 'world' or 'frame'")
        index = self._frame(name)
        offset = as_array(point, "point", (3,))
        path = self.tree.ancestors(self.tree.frames[index].joint)[::-1]
        poses = self._poses(self.core.joint_poses(q), index)
        place = poses[:, :3, :3] @ offset + poses[:, :3, 3]
        twists = self.core.joint_twists(q)[:, list(path)]
        linear = twists[:, :, :3] + np.cross(twists[:, :, 3:], place[:, None, :])
        jacobian = np.concatenate([linear, twists[:, :, 3:]], axis=2).swapaxes(1, 2)
        E, _ = self.tree.coupling(path, self.variables)
        return twists, jacobian, E, poses[:, :3, :3] if axes == "frame" else None

    def _frame(self, name: str) -> int:
        index = self._frame_index.get(name)
        if index is None:
            raise ArgumentError(
                f"unknown frame {name!r}; {closest(name, self.frames, what='frames')}"
            )
        return index

    def _poses(self, joints: Array, index: int) -> Array:
        frame = self.tree.frames[index]
        if frame.joint == WORLD:
            return np.broadcast_to(frame.pose, (len(joints), 4, 4)).copy()
        return joints[:, frame.joint] @ frame.pose


def _turned(turn: Array | None, velocities: Array) -> Array:
    """Return velocities (N, 6, n) in the axes of a frame whose rotation is (N, 3, 3)."""
    if turn is None:
        return velocities
    back = turn.swapaxes(1, 2)
    return np.concatenate([back @ velocities[:, :3], back @ velocities[:, 3:]], axis=1)
