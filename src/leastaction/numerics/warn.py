"""Warnings that point at the line which called the package."""

from __future__ import annotations

import sys
import warnings


def warn(message: str | Warning, category: type[Warning] | None = None) -> None:
    """Warn at the innermost line that is not of the package."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("leastaction."):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)
