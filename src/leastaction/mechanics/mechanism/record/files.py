"""Files of mechanisms, in YAML or JSON."""

from __future__ import annotations

import os
from pathlib import Path

from leastaction.mechanics.mechanism.compilation import Plan
from leastaction.mechanics.mechanism.record.mechanism import plan_data, plan_of
from leastaction.numerics.documents import read_document, write_document


def write_plan(settled: Plan, path: str | os.PathLike[str]) -> Path:
    """Write a mechanism to a file; see `Mechanism.save`."""
    return write_document(path, plan_data(settled))


def read_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a mechanism from a file; see `Mechanism.load`."""
    return plan_of(read_document(path))
