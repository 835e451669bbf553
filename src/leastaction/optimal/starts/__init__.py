"""Starts for problems that are not solved from just anywhere; knows no mechanics.

Each function solves easier problems first and ends with a `StartResult`: a trajectory for `optimize` to begin with, and
a record of every stage.
"""

from __future__ import annotations

from leastaction.optimal.starts.coarse_to_fine import coarse_to_fine, resample
from leastaction.optimal.starts.continuation import continuation
from leastaction.optimal.starts.help import HelpedCost
from leastaction.optimal.starts.receding_horizon import receding_horizon
from leastaction.optimal.starts.stages import StageRecord, StageTable, StartResult, StartStatus

__all__ = [
    "HelpedCost", "StageRecord", "StageTable", "StartResult", "StartStatus", "coarse_to_fine", "continuation",
    "receding_horizon", "resample",
]  # fmt: skip
