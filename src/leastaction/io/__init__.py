"""Files: motion capture and named motions (`motion`), runs of the optimiser (`results`)."""

from __future__ import annotations

from leastaction.io.motion import Capture, Joint, Motion, forward_kinematics, read_bvh

__all__ = ["Capture", "Joint", "Motion", "forward_kinematics", "read_bvh"]
