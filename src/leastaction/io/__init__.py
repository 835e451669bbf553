"""Files: motion capture and named motions (`motion`), results of the optimiser (`results`)."""

from __future__ import annotations

from leastaction.io.motion import Capture, Gap, Joint, Motion, forward_kinematics, read_amc, read_bvh, read_capture
from leastaction.io.results import load_record, load_result, save_record, save_result

__all__ = [
    "Capture", "Gap", "Joint", "Motion", "forward_kinematics", "load_record", "load_result", "read_amc", "read_bvh",
    "read_capture", "save_record", "save_result",
]  # fmt: skip
