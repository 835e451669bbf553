"""Files: motion capture and named motions (`motion`), runs and results (`results`)."""

from __future__ import annotations

from leastaction.io.motion import (
    Capture,
    Gap,
    Joint,
    Markers,
    Motion,
    axis_rotation,
    count_steps,
    forward_kinematics,
    read_amc,
    read_bvh,
    read_capture,
    read_markers,
    read_motion,
)
from leastaction.io.results import (
    Provenance,
    check_result,
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
    "Provenance",
    "axis_rotation",
    "check_result",
    "count_steps",
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
