"""Files: motion capture and named motions (`motion`), runs and results (`results`)."""

from __future__ import annotations

from leastaction.io.motion import (
    Capture,
    Gap,
    Joint,
    Markers,
    Motion,
    forward_kinematics,
    read_amc,
    read_bvh,
    read_capture,
    read_markers,
    read_motion,
)
from leastaction.io.results import (
    load_record,
    load_result,
    open,  # noqa: A004 - as `gzip.open` is
    save_record,
    save_result,
)

__all__ = [
    "Capture",
    "Gap",
    "Joint",
    "Markers",
    "Motion",
    "forward_kinematics",
    "load_record",
    "load_result",
    "open",
    "read_amc",
    "read_bvh",
    "read_capture",
    "read_markers",
    "read_motion",
    "save_record",
    "save_result",
]  # fmt: skip
