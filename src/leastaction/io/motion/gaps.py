"""Samples that a capture lacks: found, and filled from what is before and after.

A joint that the cameras lost is written in one of three ways: as words that are no numbers, as zeros, or as its last
values again. The first says so itself. Zeros are taken for a gap where all channels of the body, or the rotations of a
joint, are exactly zero and leave and come back with a jump. A whole frame written again and again is one where the
motion makes up for it with a jump; a pose that is held, from which it goes on as it does elsewhere, is none. Where a
marker was taken for another, a joint is somewhere else for a frame or a few, and back: that is no sample either. Jumps
are those of rotations: a channel that leaps by a whole turn has not moved.
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
_STILL = 0.95  # of the samples of a joint that does not move are zeros
_SPIKE = 30.0  # degrees or more, to which a joint leaps in a frame
_LEAP = 0.25  # the same of its place, in lengths of the skeleton from its root
_BRIEF, _FRAMES = 0.05, 3  # s and frames at most until it is back
_BACK = 0.3  # of the leap at most is between the samples before and after

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
    joints, values = _channels(capture), capture.values
    longest, size = min(_FRAMES, int(_BRIEF / capture.frame_time)), _size(capture)
    lost: dict[str, list[tuple[Mask, str]]] = {}
    everywhere = _zero_frames(values), _repeated_frames(values, [i for joint in joints for i in joint.rotations])
    whole = everywhere[0] | everywhere[1]
    missing = np.zeros(values.shape, dtype=np.bool_)
    missing[whole] = True
    for joint in joints:
        none = ~np.isfinite(values[:, joint.all]).all(axis=1) & ~whole
        spike = _spikes(values, joint, whole | none, longest=longest, size=size)
        zero = _zero_joint(values, joint, whole | none, spike)
        spike &= ~zero
        lost[joint.name] = [(none, "not numbers"), (zero, "zeros"), (spike, "leaps")]
        if (gone := none | zero | spike).any():
            missing[np.ix_(np.flatnonzero(gone), np.array(joint.all))] = True
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


def _zero_joint(values: Array, joint: _Channels, known_lost: Mask, spike: Mask) -> Mask:
    """Return the frames in which a joint's rotations are zero between such that are far from it.

    A joint that passes zero on its way is not far from it: what the frames about it lead to must be.
    """
    mask = np.zeros(len(values), dtype=np.bool_)
    angles = values[:, joint.rotations]
    none: Mask = ~(angles != 0.0).any(axis=1)
    if len(joint.rotations) < 2 or not none.any() or none.mean() > _STILL:
        return mask
    known = np.flatnonzero(~(none | known_lost | spike))
    # A leap out of zeros and back is no end of theirs.
    for first, last in _runs((none | spike) & ~known_lost):
        zeros = np.flatnonzero(none[first : last + 1]) + first
        if first == 0 or not len(zeros) or not len(known):
            continue
        before, after = known[known < first][-1:], known[known > last][:1]
        sides = np.concatenate([before, after])
        if not len(sides) or _apart(joint, np.zeros_like(angles[sides]), angles[sides]).min() <= _JUMP:
            continue
        expected = np.stack([np.interp(zeros, sides, np.unwrap(column, period=360.0)) for column in angles[sides].T], 1)
        if _apart(joint, np.zeros_like(expected), expected).max() > _JUMP:
            mask[zeros] = True
    return mask


def _spikes(values: Array, joint: _Channels, known_lost: Mask, *, longest: int, size: float) -> Mask:
    """Return the frames, ``longest`` in a row at most, in which a joint leaps away from where it is before and after.

    ``size``: of the skeleton.
    """
    mask = np.zeros(len(values), dtype=np.bool_)
    frames = np.flatnonzero(~known_lost)
    turns, places = values[frames[:, None], joint.rotations], values[frames[:, None], joint.positions]
    # A rotation is turned by no more than the sum of what its angles change by: most joints never leap.
    most = np.abs((np.diff(turns, axis=0) + 180.0) % 360.0 - 180.0).sum(axis=1).max(initial=0.0) / _SPIKE
    if most <= 1.0 and np.abs(np.diff(places, axis=0)).sum(axis=1).max(initial=0.0) <= _LEAP * size:
        return mask

    def apart(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
        """Distance of frames a from frames b, in spikes."""
        found = _apart(joint, turns[a], turns[b]) / _SPIKE
        return np.asarray(np.maximum(found, np.linalg.norm(places[a] - places[b], axis=1) / (_LEAP * size)))

    index = np.arange(len(frames))
    steps = apart(index[:-1], index[1:])
    leaps = np.flatnonzero(steps > 1.0)
    for first in leaps:
        if mask[frames[first]]:
            continue
        for last in leaps[(leaps > first) & (leaps <= first + longest)]:
            if apart(index[[first]], index[[last + 1]])[0] < _BACK * min(steps[first], steps[last]):
                mask[frames[first + 1 : last + 1]] = True
                break
    return mask


def _apart(joint: _Channels, a: Array, b: Array) -> Array:
    """Return by which angle (degrees) rotations a of a joint, one a row, are turned from rotations b."""
    if not (joint.rotations and len(a)):  # of no rotations at all SciPy makes none before 1.14
        return np.zeros(len(a))
    if len(joint.rotations) == 3 and len(set(joint.order)) == 3:
        turns = (Rotation.from_euler(joint.order, each, degrees=True) for each in (a, b))
        first, second = turns
        return np.asarray(np.rad2deg((first.inv() * second).magnitude()))
    return np.asarray(np.abs((b - a + 180.0) % 360.0 - 180.0).max(axis=1))


def _size(capture: Capture) -> float:
    """Return how far the farthest joint is from the root, along the bones (in the file's unit)."""
    reach: list[float] = []
    for joint in capture.joints:
        reach.append(reach[joint.parent] + float(np.linalg.norm(joint.offset)) if joint.parent >= 0 else 0.0)
    return max(reach, default=0.0) or np.inf


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
