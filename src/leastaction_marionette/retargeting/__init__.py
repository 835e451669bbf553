"""From a captured person to the puppet: whose joint is whose, which way is forward, the puppet's angles."""

from __future__ import annotations

from leastaction_marionette.retargeting.load import PuppetMotion, load_motion
from leastaction_marionette.retargeting.mapping import default_names, map_joints, read_mapping
from leastaction_marionette.retargeting.retarget import Retargeted, retarget
from leastaction_marionette.retargeting.skeleton import VARIABLES, Proportions, puppet_points

__all__ = [
    "VARIABLES", "Proportions", "PuppetMotion", "Retargeted", "default_names", "load_motion", "map_joints",
    "puppet_points", "read_mapping", "retarget",
]  # fmt: skip
