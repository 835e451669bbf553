"""Read Acclaim motion capture: a skeleton (ASF) and a motion of it (AMC), the format of Carnegie Mellon's database.

A skeleton is a tree of bones: direction and length of each in the world as the skeleton stands, the axes that it turns
about (an orientation C, constant), and about which of these it turns (``dof``). A motion says these angles for every
frame: with M their rotation, a bone is turned against the one before it by ``C M C^-1``. For an order ``XYZ`` of the
axes, rotations are ``Rz Ry Rx``.

Read as a `Capture` the joint called as a bone is at the bone's start, where the one before it ends. Its channels are
those of C, M and C^-1, of which the first and the last do not change: nothing is converted. The root's ``position`` and
``orientation`` place a skeleton that has no motion, and are not used.

The package's own reader: no maintained one is on the package index.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from leastaction.io.motion.acclaim.motion import read_values
from leastaction.io.motion.acclaim.skeleton import MOVES, ROOT, AcclaimBone, read_skeleton, skeleton_beside
from leastaction.io.motion.capture import Capture, Joint
from leastaction.io.motion.gaps import fill_gaps
from leastaction.io.motion.text import LONGEST, SHORTEST, read_text
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.public import public

FRAME_RATE = 120.0
"""Frames a second of a motion that does not say how many: those of Carnegie Mellon's database."""


@public
def read_amc(
    path: str | PathLike[str],
    *,
    skeleton: str | PathLike[str] | None = None,
    frame_rate: float | None = None,
    fill: bool = True,
) -> Capture:
    """Read an Acclaim motion (AMC) of a skeleton (ASF).

    Parameters
    ----------
    path : path
        The AMC file. At least two frames. In place of a number NaN, however it is spelled, stands for a sample that is
        missing.
    skeleton : path, optional
        The ASF file; see `skeleton_beside` if left out.
    frame_rate : float, optional
        Frames a second (1/s). If left out, what the file says, or `FRAME_RATE`.
    fill : bool, optional
        Fill samples that are missing, see `fill_gaps`.

    Returns
    -------
    Capture
        Lengths in the files' unit, angles in degrees.

    Raises
    ------
    MotionFileError
        A file is missing, is none of its kind, is truncated, or does not go with the other; the message names file,
        line, what was found and expected.
    ArgumentError
        A frame rate that is not positive.
    """
    path = Path(path)
    if frame_rate is not None:
        as_number(frame_rate, "frame_rate", above=0.0)
        as_number(1.0 / frame_rate, "1 / frame_rate", above=SHORTEST, below=LONGEST)
    text = read_text(path, "an AMC")
    asf = skeleton_beside(path) if skeleton is None else Path(skeleton)
    bones = read_skeleton(asf)
    rows, rate = read_values(path, text, bones)
    capture = _capture(path, bones, rows, 1.0 / (frame_rate or rate or FRAME_RATE))
    return fill_gaps(capture) if fill else capture


def _capture(path: Path, bones: dict[str, AcclaimBone], rows: Array, frame_time: float) -> Capture:
    """Return a motion as a capture: the turns to a bone's axes and back are channels that do not change."""
    joints: list[Joint] = []
    index: dict[str, int] = {}
    columns: list[Array] = []
    start = 0
    for name, bone in bones.items():
        own = {each: rows[:, start + i] for i, each in enumerate(bone.dof)}
        start += len(bone.dof)
        axes = bone.order[::-1]  # of Rz Ry Rx, for XYZ
        tilt = dict(zip("XYZ", bone.axis, strict=True))
        channels = [(f"{each[1]}position", values) for each, values in own.items() if each in MOVES]
        turns = [(f"{axis}rotation", own[f"R{axis}"]) for axis in axes if f"R{axis}" in own]
        if turns and name != ROOT:
            still = np.ones(len(rows))
            there = [(f"{axis}rotation", tilt[axis] * still) for axis in axes if tilt[axis]]
            turns = [*there, *turns, *((axis, -values) for axis, values in reversed(there))]
        channels += turns
        before = bones[bone.parent] if bone.parent else None
        index[name] = len(joints)
        joints.append(
            Joint(
                name,
                index[bone.parent] if before else -1,
                before.end if before else (0.0, 0.0, 0.0),
                tuple(each for each, _ in channels),
                bone.line,
            )
        )
        columns += [values for _, values in channels]
        if not bone.children and bone.length > 0.0:
            joints.append(Joint(_end_of(name, bones), index[name], bone.end, (), bone.line))
    values = np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))
    values.flags.writeable = False
    return Capture(str(path), tuple(joints), frame_time, values)


def _end_of(name: str, bones: dict[str, AcclaimBone]) -> str:
    end = f"{name}_end"
    while end in bones:
        end += "_"
    return end
