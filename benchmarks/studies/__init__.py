"""The longer studies behind some examples: ``python -m benchmarks.studies.NAME`` makes the numbers of the gallery."""

from __future__ import annotations
