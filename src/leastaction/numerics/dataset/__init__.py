"""Runs and results as plain data with names, dimensions and units, and as files of several kinds."""

from __future__ import annotations

from leastaction.numerics.dataset.dataset import STEP, TIME, Column, Dataset, table
from leastaction.numerics.dataset.provenance import Provenance
from leastaction.numerics.dataset.savable import Savable, Table

__all__ = ["STEP", "TIME", "Column", "Dataset", "Provenance", "Savable", "Table", "table"]
