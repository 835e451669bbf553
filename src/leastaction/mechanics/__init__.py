"""Mechanisms: how they are described, compiled and asked."""

from __future__ import annotations

from leastaction._names import by_stub

__getattr__, __dir__, __all__ = by_stub(__name__)
