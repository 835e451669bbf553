"""The command line: ``leastaction --help``; and what applications build their commands with."""

from __future__ import annotations

from leastaction.apps.cli.app import main
from leastaction.apps.cli.applications import Application
from leastaction.apps.cli.options import OPTIMISER, OUTPUT, OptimiserOptions, OutputOptions
from leastaction.apps.cli.output import checked_folder, complain, printing_numbers
from leastaction.apps.cli.shield import uninterrupted

__all__ = [
    "OPTIMISER", "OUTPUT", "Application", "OptimiserOptions", "OutputOptions", "checked_folder", "complain", "main",
    "printing_numbers", "uninterrupted",
]  # fmt: skip
