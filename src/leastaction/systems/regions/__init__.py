"""Parts of space that a point of a mechanism may be kept inside or outside of, and how far they are apart."""

from __future__ import annotations

from leastaction.systems.regions.regions import Ball, Box, HalfSpace, Outside, Region

__all__ = ["Ball", "Box", "HalfSpace", "Outside", "Region"]
