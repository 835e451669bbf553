"""Samples that a capture lacks: found, and filled from what is before and after.

A joint that the cameras lost is written in one of three ways: as words that are no numbers, as zeros, or as its last
values again. The first says so itself. Zeros are taken for a gap where all channels of the body, or the rotations of a
joint, are exactly zero and leave and come back with a jump. A whole frame written again and again is one where the
motion makes up for it with a jump; a pose that is held, from which it goes on as it does elsewhere, is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from leastaction.errors import MotionFileError
from leastaction.io.motion.capture import Capture, Gap
from leastaction.numerics.arrays import Array

_JUMP = 5.0  # degrees, with which a joint leaves to zeros and comes back
_MADE_UP = 1.5  # times the mean speed about it is that with which a motion makes up for frames written again
_SEEN = 1.0  # degrees or more, of that jump
_AROUND = 4  # frames on either side for each frame of the gap

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class _Channels:
    """Where the channels of one joint are."""

    name: str
    positions: list[int]
    rotations: list[int]
    order: str
    line: int

    @property
    def all(self) -> list[int]:
        return self.positions + self.rotations


def fill_gaps(capture: Capture) -> Capture:
    """Return a capture with its missing samples filled, and what was filled in `Capture.gaps`.

    Rotations go from the last one known to the next one about one axis at a steady speed, positions along a line; at
    the ends of the capture the nearest that is known is held.

    Raises
    ------
    MotionFileError
        A joint of which no sample is known.
    """
    joints = _channels(capture)
    values = capture.values
    lost: dict[str, list[tuple[Mask, str]]] = {}
    everywhere = _zero_frames(values), _repeated_frames(values, [i for joint in joints for i in joint.rotations])
    whole = everywhere[0] | everywhere[1]
    missing = np.zeros(values.shape, dtype=np.bool_)
    missing[whole] = True
    for joint in joints:
        none = ~np.isfinite(values[:, joint.all]).all(axis=1) & ~whole
        zero = _zero_joint(values, joint.rotations, whole | none)
        lost[joint.name] = [(none, "not numbers"), (zero, "zeros")]
        missing[(none | zero)[:, None] & np.isin(np.arange(values.shape[1]), joint.all)] = True
    if not missing.any():
        return capture
    filled = values.copy()
    for joint in joints:
        known = ~missing[:, joint.all[0]]
        if not known.any():
            raise MotionFileError(
                f"{capture.path}, line {joint.line}: joint {joint.name!r} has no sample that is known, expected some. "
                "Take the joint out of the file, or export the motion again."
            )
        _fill(filled, joint, known)
    filled.flags.writeable = False
    gaps = [
        Gap(joint, first, last, kind)
        for joint, kinds in (("", [(everywhere[0], "zeros"), (everywhere[1], "repeated")]), *lost.items())
        for mask, kind in kinds
        for first, last in _runs(mask)
    ]
    return replace(capture, values=filled, gaps=tuple(sorted(gaps, key=lambda gap: (gap.first, gap.joint))))


def _channels(capture: Capture) -> list[_Channels]:
    found, column = [], 0
    for joint in capture.joints:
        own = range(column, column + len(joint.channels))
        column += len(joint.channels)
        turns = [i for i, name in zip(own, joint.channels, strict=True) if name.endswith("rotation")]
        order = "".join(name[0] for name in joint.channels if name.endswith("rotation"))
        if joint.channels:
            found.append(_Channels(joint.name, [i for i in own if i not in turns], turns, order, joint.line))
    return found


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and the last index of each run of frames."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _zero_frames(values: Array) -> Mask:
    """Return the frames in which every channel is zero, but for those at the start: a pose to calibrate by."""
    mask: Mask = ~(values != 0.0).any(axis=1)
    for first, last in _runs(mask):
        if first == 0:
            mask[first : last + 1] = False
    return mask


def _zero_joint(values: Array, rotations: list[int], known_lost: Mask) -> Mask:
    """Return the frames in which a joint's rotations are zero between such that are far from it."""
    mask = np.zeros(len(values), dtype=np.bool_)
    if len(rotations) < 2:
        return mask
    angles = values[:, rotations]
    for first, last in _runs(~angles.any(axis=1) & ~known_lost):
        sides = [k for k in (first - 1, last + 1) if 0 <= k < len(values)]
        if first > 0 and all(np.abs(angles[k]).max() > _JUMP for k in sides):
            mask[first : last + 1] = True
    return mask


def _repeated_frames(values: Array, rotations: list[int]) -> Mask:
    """Return the frames that are the one before again, where the motion goes on with a jump."""
    mask = np.zeros(len(values), dtype=np.bool_)
    turns = np.abs((np.diff(values[:, rotations], axis=0) + 180.0) % 360.0 - 180.0)
    steps = np.nan_to_num(turns).max(axis=1, initial=0.0)
    for first, last in _runs(np.concatenate([[False], (values[1:] == values[:-1]).all(axis=1)])):
        if last + 1 >= len(values):
            continue
        reach = _AROUND * (last - first + 2)
        jump, usual = steps[last], steps[max(0, first - reach) : last + 1 + reach].mean()
        if jump > _SEEN and jump > _MADE_UP * usual:
            mask[first : last + 1] = True
    return mask


def _fill(values: Array, joint: _Channels, known: Mask) -> None:
    """Fill the frames of a joint that are not known, in place."""
    frames = np.flatnonzero(known)
    if len(frames) == len(values):
        return
    lost = np.flatnonzero(~known)
    inside = np.clip(lost, frames[0], frames[-1])
    for i in joint.positions:
        values[lost, i] = np.interp(inside, frames, values[frames, i])
    turns = values[:, joint.rotations]
    if len(joint.rotations) == 3 and len(set(joint.order)) == 3 and len(frames) > 1:
        known_turns = Rotation.from_euler(joint.order, turns[frames], degrees=True)
        euler = Slerp(frames, known_turns)(inside).as_euler(joint.order, degrees=True)
        # As the angles before, and not a turn off.
        before = turns[frames[np.maximum(np.searchsorted(frames, inside, side="right") - 1, 0)]]
        turns[lost] = euler + 360.0 * np.round((before - euler) / 360.0)
        values[:, joint.rotations] = turns
    else:
        for i in joint.rotations:
            values[lost, i] = np.interp(inside, frames, np.unwrap(values[frames, i], period=360.0))
