"""The marionette on strings follows a motion: tracking, retargeting of captures, the made-up walk, its scene."""

from __future__ import annotations

from leastaction.apps.marionette.bars import plot_bars
from leastaction.apps.marionette.check import RigCheck, check
from leastaction.apps.marionette.markers import MARKERS, plot_markers
from leastaction.apps.marionette.resting import RestingPoses, plot_resting, resting
from leastaction.apps.marionette.retargeting import (
    VARIABLES,
    Proportions,
    PuppetMotion,
    Retargeted,
    default_names,
    load_motion,
    map_joints,
    puppet_points,
    read_mapping,
    retarget,
)
from leastaction.apps.marionette.scene import marionette_scene
from leastaction.apps.marionette.tracking import (
    FORCED,
    GENTLE,
    PuppetLimits,
    TrackingCost,
    TrackingRun,
    TrackingWeights,
    load_run,
    save_run,
    track,
)
from leastaction.apps.marionette.walk import walk_in_place

__all__ = [
    "FORCED", "GENTLE", "MARKERS", "VARIABLES", "Proportions", "PuppetLimits", "PuppetMotion", "RestingPoses",
    "Retargeted", "RigCheck", "TrackingCost", "TrackingRun", "TrackingWeights", "check", "default_names",
    "load_motion", "load_run", "map_joints", "marionette_scene", "plot_bars", "plot_markers", "plot_resting",
    "puppet_points", "read_mapping", "resting", "retarget", "save_run", "track", "walk_in_place",
]  # fmt: skip
