"""The marionette learns to follow a reference motion."""

from __future__ import annotations

from leastaction_marionette.tracking.cost import TrackingCost
from leastaction_marionette.tracking.files import load_run, load_unfinished, save_run, save_search
from leastaction_marionette.tracking.found import Effort, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.run import track
from leastaction_marionette.tracking.weights import FORCED, GENTLE, TrackingWeights

__all__ = [
    "FORCED", "GENTLE", "Effort", "PuppetLimits", "TrackingCost", "TrackingRun", "TrackingSearch", "TrackingWeights",
    "load_run", "load_unfinished", "save_run", "save_search", "track",
]  # fmt: skip
