"""A captured motion: its skeleton, its channel values, and where its joints are in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.errors import ArgumentError, brief, unknown
from leastaction.io.motion.motion import Motion
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.public import public

_MOST_NAMES = 4


@public
@dataclass(frozen=True)
class Joint:
    """One joint of a captured skeleton, or an end site.

    Attributes
    ----------
    name : str
        Name in the file; the end site of joint ``Head`` is called ``Head_end``.
    parent : int
        Index of the parent joint, -1 for the root.
    offset : tuple of 3 float
        Position in the parent's frame, in the file's unit of length.
    channels : tuple of str
        Channel names in the order of the file; empty for an end site.
    line : int
        Line of the file that declares it, from 1.
    """

    name: str
    parent: int
    offset: tuple[float, float, float]
    channels: tuple[str, ...]
    line: int


@public
@dataclass(frozen=True)
class Gap:
    """Samples that a capture lacked, and that were filled from those before and after.

    Attributes
    ----------
    joint : str
        Name of the joint; empty for the whole body.
    first, last : int
        The first and the last frame of the gap, from 0.
    kind : str
        How it was written: "not numbers", "zeros" or "repeated".
    """

    joint: str
    first: int
    last: int
    kind: str

    @property
    def frames(self) -> int:
        """How many frames it has."""
        return self.last - self.first + 1


@public
@dataclass(frozen=True)
class Capture:
    """A captured motion as it stands in the file.

    Attributes
    ----------
    path : str
        The file it was read from.
    joints : tuple of Joint
        Joints and end sites, parents before children.
    frame_time : float
        Seconds between two frames.
    values : (F, nc) array
        Channel values of every frame, in the order of the joints and of their channels;
        lengths in the file's unit, angles in degrees.
    gaps : tuple of Gap
        What of the values was missing in the file, and is filled.
    notes : tuple of str
        What else there is to say of the file.
    """

    path: str
    joints: tuple[Joint, ...]
    frame_time: float
    values: Array
    gaps: tuple[Gap, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all joints and end sites."""
        return tuple(joint.name for joint in self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints proper, without the end sites."""
        return tuple(joint.name for joint in self.joints if joint.channels or joint.parent < 0)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return int(self.values.shape[0])

    def __str__(self) -> str:
        """Say what is captured, for how long, of which joints, how they turn, and what was missing."""
        first = self.joints[0]
        seconds = self.frame_time * (self.n_frames - 1)
        lines = [
            f"{self.path}: {self.n_frames} frames of {self.frame_time:.6g} s, {seconds:.4g} s in all",
            f"root {first.name!r} with {', '.join(first.channels)}",
            f"{len(self.joint_names)} joints: {', '.join(self.joint_names)}",
        ]
        return "\n".join([*lines, *filter(None, [self.describe_gaps()])])

    def index(self, name: str) -> int:
        """Index of the joint called `name` in `joints`; raises `ArgumentError` if there is none."""
        if name not in self.names:
            raise unknown("joint", name, self.names, "name")
        return self.names.index(name)

    def motion(self, *, unit: float = 1.0) -> Motion:
        """Return its channels as a motion of named variables, ``hips_tx``, ``knee_rx`` ...: angles in radians.

        A channel that a joint has again is ``knee_rx#2``.

        Parameters
        ----------
        unit : float, optional
            Metres in a unit of length of the file, such as 0.01.

        Raises
        ------
        ArgumentError
            If there are fewer than two frames, or the unit is no number above zero.
        """
        metres = as_number(unit, "unit (m)", above=0.0)
        channels = [(joint.name, channel) for joint in self.joints for channel in joint.channels]
        turns = np.array([channel.lower().endswith("rotation") for _, channel in channels], dtype=bool)
        names: list[str] = []
        for (joint, channel), turn in zip(channels, turns, strict=True):
            name = f"{joint}_{'r' if turn else 't'}{channel[0].lower()}"
            again = sum(other.partition("#")[0] == name for other in names)
            names.append(f"{name}#{again + 1}" if again else name)
        values = np.asarray(self.values * np.where(turns, np.pi / 180.0, metres), dtype=np.float64)
        t = np.asarray(self.frame_time * np.arange(self.n_frames), dtype=np.float64)
        return Motion(tuple(names), t, values, self.path)

    def describe_gaps(self) -> str:
        """Return a sentence on what was missing and is filled, and `notes`; empty if there is nothing to say."""
        if not self.gaps:
            return "; ".join(self.notes)
        names = dict.fromkeys(gap.joint or "the whole body" for gap in self.gaps)
        shown = [*names][:_MOST_NAMES] + ([f"{len(names) - _MOST_NAMES} more"] if len(names) > _MOST_NAMES else [])
        kinds = dict.fromkeys(gap.kind for gap in self.gaps)
        longest = max(self.gaps, key=lambda gap: gap.frames)
        samples = sum(gap.frames for gap in self.gaps)
        filled = (
            f"filled {samples} missing samples ({', '.join(kinds)}) of {', '.join(shown)}; "
            f"the longest gap is {longest.frames * self.frame_time:.2g} s at {longest.first * self.frame_time:.2f} s"
        )
        return "; ".join([filled, *self.notes])

    def is_below(self, joint: int, ancestor: int) -> bool:
        """Whether `joint` hangs, directly or not, from `ancestor`."""
        if not 0 <= joint < len(self.joints):
            raise ArgumentError(f"joint: got {brief(joint)}, expected 0 to {len(self.joints) - 1}")
        parent = self.joints[joint].parent
        while parent >= 0:
            if parent == ancestor:
                return True
            parent = self.joints[parent].parent
        return False


@public
def forward_kinematics(capture: Capture) -> tuple[Array, Array]:
    """Positions and orientations of all joints in all frames, in the capture's world.

    Parameters
    ----------
    capture : Capture

    Returns
    -------
    positions : (F, nj, 3) array
        In the file's unit of length.
    rotations : (F, nj, 3, 3) array
        World orientation of each joint's frame.
    """
    n_frames, n_joints = capture.n_frames, len(capture.joints)
    positions = np.empty((n_frames, n_joints, 3))
    rotations = np.empty((n_frames, n_joints, 3, 3))
    column = 0
    for index, joint in enumerate(capture.joints):
        local = np.tile(np.asarray(joint.offset, dtype=np.float64), (n_frames, 1))
        turn = np.broadcast_to(np.eye(3), (n_frames, 3, 3))
        for channel in joint.channels:
            axis = "XYZ".index(channel[0])
            value = capture.values[:, column]
            column += 1
            if channel.endswith("position"):
                # Exporters that write position channels write the whole local position there,
                # not a correction of the offset.
                local[:, axis] = value
            else:
                turn = turn @ axis_rotation(axis, np.deg2rad(value))
        if joint.parent < 0:
            positions[:, index] = local
            rotations[:, index] = turn
        else:
            above = rotations[:, joint.parent]
            positions[:, index] = positions[:, joint.parent] + np.einsum("fij,fj->fi", above, local)
            rotations[:, index] = above @ turn
    return positions, rotations


@public
def axis_rotation(axis: int, angle: Array) -> Array:
    """Rotation matrices (..., 3, 3) about coordinate axis 0, 1 or 2 by `angle` (...) in radians."""
    matrix = np.zeros((*angle.shape, 3, 3))
    second, third = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angle), np.sin(angle)
    matrix[..., axis, axis] = 1.0
    matrix[..., second, second] = cosine
    matrix[..., third, third] = cosine
    matrix[..., second, third] = -sine
    matrix[..., third, second] = sine
    return matrix
