"""Ways to a first trajectory, for motions that an optimisation does not find from any start."""

from __future__ import annotations

from leastaction.optimal import (
    HelpedCost,
    StageRecord,
    StageTable,
    StartResult,
    StartStatus,
    coarse_to_fine,
    continuation,
    receding_horizon,
    resample,
)
from leastaction.systems import Followed, PulledSystem, by_tensions, embed, follow, relax, warm_start

__all__ = [  # noqa: RUF022 - by topics
    # Of any system
    "coarse_to_fine", "continuation", "receding_horizon", "resample",
    # Of mechanisms
    "by_tensions", "embed", "follow", "relax", "warm_start",
    # What they find, and how they go on
    "Followed", "HelpedCost", "PulledSystem", "StageRecord", "StageTable", "StartResult", "StartStatus",
]  # fmt: skip
