"""Runs of the optimiser as files: written whole, checked when they are read."""

from __future__ import annotations

from leastaction.io.results.files import current_versions, load_record, save_record
from leastaction.io.results.record import RunRecord

__all__ = ["RunRecord", "current_versions", "load_record", "save_record"]
