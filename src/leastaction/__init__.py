"""Mechanisms, variational integrators with exact derivatives, and trajectory optimisation."""

from __future__ import annotations

from leastaction._version import __version__

__all__ = ["__version__"]
