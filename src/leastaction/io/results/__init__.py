"""Results of the optimiser as files: written whole, held to a schema when they are read."""

from __future__ import annotations

from leastaction.io.results.checks import check_result
from leastaction.io.results.opening import open  # noqa: A004 - as `gzip.open` is
from leastaction.io.results.record import Provenance, Record, load_record, save_record
from leastaction.io.results.result import load_result, save_result

__all__ = [
    "Provenance", "Record", "check_result", "load_record", "load_result", "open", "save_record", "save_result",
]  # fmt: skip
