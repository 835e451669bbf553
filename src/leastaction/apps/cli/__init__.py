"""The command line: ``leastaction --help``."""

from __future__ import annotations

from leastaction.apps.cli.app import main

__all__ = ["main"]
