"""Motions from outside: motion capture files and named variables over time."""

from __future__ import annotations

from leastaction.io.motion.bvh import read_bvh
from leastaction.io.motion.capture import Capture, Joint, forward_kinematics
from leastaction.io.motion.motion import Motion

__all__ = ["Capture", "Joint", "Motion", "forward_kinematics", "read_bvh"]
