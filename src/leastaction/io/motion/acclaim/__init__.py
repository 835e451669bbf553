"""Acclaim's motion capture files: a skeleton (ASF) and a motion of it (AMC)."""

from __future__ import annotations

from leastaction.io.motion.acclaim.read import FRAME_RATE, read_amc
from leastaction.io.motion.acclaim.skeleton import skeleton_beside

__all__ = ["FRAME_RATE", "read_amc", "skeleton_beside"]
