"""The marionette on strings follows a motion: tracking, retargeting of captures, the made-up walk, figures."""

from __future__ import annotations

from leastaction.apps.marionette.load import PuppetMotion, load_motion
from leastaction.apps.marionette.mapping import default_names, map_joints, read_mapping
from leastaction.apps.marionette.puppet import VARIABLES, Proportions, puppet_points
from leastaction.apps.marionette.retarget import Retargeted, retarget
from leastaction.apps.marionette.snapshots import plot_snapshots
from leastaction.apps.marionette.strings_figure import plot_strings
from leastaction.apps.marionette.tracking import TrackingRun, track
from leastaction.apps.marionette.tracking_figure import (
    TrackingErrors,
    plot_tracking,
    tracking_errors,
)
from leastaction.apps.marionette.walk import walk_in_place
from leastaction.apps.marionette.weights import FORCED, GENTLE, TrackingWeights

__all__ = [
    "FORCED",
    "GENTLE",
    "VARIABLES",
    "Proportions",
    "PuppetMotion",
    "Retargeted",
    "TrackingErrors",
    "TrackingRun",
    "TrackingWeights",
    "default_names",
    "load_motion",
    "map_joints",
    "plot_snapshots",
    "plot_strings",
    "plot_tracking",
    "puppet_points",
    "read_mapping",
    "retarget",
    "track",
    "tracking_errors",
    "walk_in_place",
]
