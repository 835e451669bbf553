"""Times of what the package computes, beside its targets; run as ``python -m benchmarks``. See README.md."""

from __future__ import annotations
