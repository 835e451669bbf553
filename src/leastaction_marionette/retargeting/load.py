"""From a motion capture file to a motion that the optimiser can be given, in one call."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike
from typing import Literal, get_args

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.io import Capture, Motion, read_capture
from leastaction.numerics import as_choice, as_number
from leastaction_marionette.choices import Axes, Axis, Heading
from leastaction_marionette.markers import with_markers
from leastaction_marionette.retargeting.mapping import read_mapping
from leastaction_marionette.retargeting.retarget import Retargeted, retarget
from leastaction_marionette.retargeting.skeleton import Proportions
from leastaction_marionette.turns import unit

Start = Literal["rest", "moving"]

_LOST = 0.05  # of the samples may be missing
_FAR = 15.0  # degrees (rms) may a bone of the puppet be off the captured one


@dataclass(frozen=True, eq=False)
class PuppetMotion:
    """A reference motion of the puppet and where it comes from.

    Attributes
    ----------
    motion : Motion
        At the steps asked for, filtered, eased in.
    retargeted : Retargeted
        The capture frame by frame, with the accuracy of the retargeting.
    speed : float
        How fast the motion is, relative to the capture.
    cutoff : float or None
        Of the filter against noise (Hz).
    filled : str
        What samples were missing in the capture, in words; empty if none were.
    lost : float
        The share of samples that were missing, of the joints that matter and those above them.
    """

    motion: Motion
    retargeted: Retargeted
    speed: float = 1.0
    cutoff: float | None = None
    filled: str = ""
    lost: float = 0.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against following this motion as it is, in words for a person; none for a sound capture."""
        found = []
        if self.lost > _LOST:
            found.append(
                f"{100.0 * self.lost:.0f} % of the samples are missing in the file and made up from those before and "
                "after: take a part of it that has none (--trim), or another capture"
            )
        off = {bone: float(np.sqrt(np.mean(error**2))) for bone, error in self.retargeted.errors.items()}
        far = {bone: error for bone, error in off.items() if error > _FAR}
        if far:
            worst = max(far, key=lambda bone: far[bone])
            others = f" and {len(far) - 1} more" if len(far) > 1 else ""
            found.append(
                f"the puppet's joints cannot point its {worst.replace('_', ' ')}{others} as the capture does: "
                f"{far[worst]:.0f} degrees off (rms) before any string is looked at. Check which joint is which "
                "(--mapping), or follow places instead of angles (--follow markers)"
            )
        return tuple(found)

    def summary(self) -> str:
        """A few lines for a person: source, length, axes, scale, accuracy."""
        made, motion = self.retargeted, self.motion
        return (
            f"{made.motion.source}: {made.motion.t.size} frames, {made.motion.duration:.2f} s\n"
            f"up {made.up}, forward {made.forward}, turned by {made.turned:.1f} degrees, "
            f"scaled by {made.scale:.4g}\n"
            f"largest angle between a bone and the capture: {made.largest_error:.2f} degrees\n"
            f"joints: {', '.join(f'{role} {name}' for role, name in made.joints.items())}\n"
            f"speed {self.speed:g}"
            + (f", smoothed at {self.cutoff:g} Hz" if self.cutoff is not None else "")
            + (", without its first frame, a pose to calibrate by" if made.first_frame else "")
            + (f"\n{self.filled}" if self.filled else "")
            + f"\nreference motion: {motion.t.size - 1} steps of {motion.t[1] - motion.t[0]:g} s"
        )


def load_motion(
    path: str | PathLike[str],
    *,
    dt: float = 0.01,
    duration: float | None = None,
    mapping: str | PathLike[str] | None = None,
    start: Start = "rest",
    ease: float = 0.5,
    cutoff: float | None = 6.0,
    speed: float = 1.0,
    trim: tuple[float, float] | None = None,
    proportions: Proportions | None = None,
    up: Axis | None = None,
    forward: Axis | None = None,
    heading: Heading = "facing",
    in_place: bool = False,
    markers: bool = False,
    skeleton: str | PathLike[str] | None = None,
    frame_rate: float | None = None,
    axes: Axes = "zyx",
) -> PuppetMotion:
    """Read a motion capture file and make it a reference motion of the puppet.

    Parameters
    ----------
    path : path
        A BVH file, or an AMC file with its ASF file.
    dt : float
        Step in seconds.
    duration : float, optional
        Seconds asked for; what is longer than the capture repeats its best cycle. The length of the
        capture (and half of `ease`) if not given.
    mapping : path, optional
        Mapping file, see `leastaction_marionette.retargeting.mapping`.
    start : {"rest", "moving"}
        ``"rest"``: in the capture's first pose at speed zero, brought to full speed within `ease`
        seconds. ``"moving"``: as captured, with the velocity of the first frame.
    ease : float
        Seconds, for ``start="rest"``; twice the motion's at most.
    cutoff : float, optional
        Low-pass filter in Hz against the noise of the capture; none if None.
    speed : float
        0.5: the motion takes twice as long.
    trim : (float, float), optional
        Part of the capture to use, from and to (s).
    proportions, up, forward, heading, in_place, axes
        See `leastaction_marionette.retargeting.retarget.retarget`.
    markers : bool
        Whether the motion says, in further columns, where the person's head, hands and feet are: for ``track(...,
        follow="markers")``.
    skeleton, frame_rate
        Of an AMC file, see `leastaction.io.motion.read_amc`.

    Raises
    ------
    MotionFileError
        The file, or the mapping file, cannot be used; the message says where and why.
    ArgumentError
        An option out of range.
    """
    as_choice(start, "start", get_args(Start))
    names = None if mapping is None else read_mapping(mapping)
    capture = read_capture(path, skeleton=skeleton, frame_rate=frame_rate)
    made = retarget(
        capture, names=names, proportions=proportions, up=up, forward=forward, heading=heading, in_place=in_place,
        axes=axes,
    )  # fmt: skip
    motion = with_markers(made.motion, made.markers) if markers else made.motion
    if trim is not None:
        motion = _trimmed(motion, trim)
    motion = replace(motion, t=motion.t / as_number(speed, "speed", above=0.0))
    ease = min(ease, 2.0 * motion.duration)
    extra = 0.5 * ease if start == "rest" else 0.0
    if duration is not None and duration - extra > motion.duration:
        motion = motion.loop(duration - extra + 2.0 * dt)
    if cutoff is not None:
        motion = motion.low_pass(cutoff)
    if start == "rest":
        motion = motion.ease_in(ease)
    whole = motion.resample(dt, duration=duration)
    whole = replace(whole, q=unit(whole.names, whole.q))
    return PuppetMotion(whole, made, speed, cutoff, capture.describe_gaps(), _lost(capture, made.joints.values()))


def _lost(capture: Capture, joints: Iterable[str]) -> float:
    """Return the share of samples that were missing, of some joints of a capture and those above them."""
    needed: set[str] = set()
    for name in joints:
        index = capture.index(name)
        while index >= 0 and capture.joints[index].name not in needed:
            needed.add(capture.joints[index].name)
            index = capture.joints[index].parent
    # A gap of the whole body has no joint's name.
    frames = sum(gap.frames * (1 if gap.joint else len(needed)) for gap in capture.gaps if gap.joint in {"", *needed})
    return frames / (capture.n_frames * len(needed))


def _trimmed(motion: Motion, trim: tuple[float, float]) -> Motion:
    """Return the part of a motion between two times, from the origin."""
    first, last = trim
    if not 0.0 <= first < last <= motion.duration + 1e-9:
        raise ArgumentError(
            f"trim: got {first:g} to {last:g} s, expected a part of the capture's {motion.duration:g} s"
        )
    kept = np.flatnonzero((motion.t >= first - 1e-9) & (motion.t <= last + 1e-9))
    if kept.size < 2:
        raise ArgumentError(f"trim: between {first:g} and {last:g} s there are fewer than two frames; take more")
    q = motion.q[kept].copy()
    q[:, :2] -= q[0, :2]
    q[:, 2] -= np.mean(q[:, 2])
    return replace(motion, t=motion.t[kept] - motion.t[kept[0]], q=q)
