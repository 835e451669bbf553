"""Motions from outside: motion capture files and named variables over time."""

from __future__ import annotations

from leastaction.io.motion.acclaim import read_amc
from leastaction.io.motion.bvh import read_bvh
from leastaction.io.motion.capture import Capture, Gap, Joint, axis_rotation, forward_kinematics
from leastaction.io.motion.gaps import fill_gaps
from leastaction.io.motion.markers import Markers, read_markers
from leastaction.io.motion.motion import Motion, count_steps
from leastaction.io.motion.read import read_capture, read_motion

__all__ = [
    "Capture", "Gap", "Joint", "Markers", "Motion", "axis_rotation", "count_steps", "fill_gaps", "forward_kinematics",
    "read_amc", "read_bvh", "read_capture", "read_markers", "read_motion",
]  # fmt: skip
