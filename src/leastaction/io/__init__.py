"""Motions from outside: motion capture files, their mapping and retargeting, and made-up walks."""

from __future__ import annotations

from leastaction.io.bvh import read_bvh
from leastaction.io.capture import Capture, Joint, forward_kinematics
from leastaction.io.load import PuppetMotion, load_motion
from leastaction.io.mapping import default_names, map_joints, read_mapping
from leastaction.io.motion import Motion
from leastaction.io.puppet import VARIABLES, Proportions, puppet_points
from leastaction.io.retarget import Retargeted, retarget
from leastaction.io.walk import walk_in_place

__all__ = [
    "VARIABLES",
    "Capture",
    "Joint",
    "Motion",
    "Proportions",
    "PuppetMotion",
    "Retargeted",
    "default_names",
    "forward_kinematics",
    "load_motion",
    "map_joints",
    "puppet_points",
    "read_bvh",
    "read_mapping",
    "retarget",
    "walk_in_place",
]
