"""Limits on a motion, what can be limited of it, and what is found beside its inputs (`FinalTime`, `Parameter`)."""

from __future__ import annotations

from leastaction.optimal import (
    Bound,
    Entries,
    Equal,
    FinalTime,
    FunctionQuantity,
    Limit,
    LimitReport,
    LimitState,
    Parameter,
    Periodic,
    Quantity,
    Within,
)
from leastaction.systems import Ball, Box, HalfSpace, Keep, Oriented, PathBound, Pointing, Region

__all__ = [  # noqa: RUF022 - by topics
    # Limits
    "Bound", "Equal", "Keep", "Limit", "Oriented", "PathBound", "Periodic", "Pointing", "Within",
    # Regions of space to keep in, or out of
    "Ball", "Box", "HalfSpace", "Region",
    # What is limited
    "Entries", "FunctionQuantity", "Quantity",
    # How a motion keeps to them
    "LimitReport", "LimitState",
    # Unknowns
    "FinalTime", "Parameter",
]  # fmt: skip
