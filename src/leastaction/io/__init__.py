"""Files: motion capture and named motions (`motion`), results of the optimiser (`results`)."""

from __future__ import annotations

from leastaction.io.motion import Capture, Gap, Joint, Motion, forward_kinematics, read_bvh
from leastaction.io.results import load_record, load_result, save_record, save_result

__all__ = [
    "Capture", "Gap", "Joint", "Motion", "forward_kinematics", "load_record", "load_result", "read_bvh", "save_record",
    "save_result",
]  # fmt: skip
