"""The command line: ``python -m leastaction``."""

from __future__ import annotations

from leastaction.apps.cli import main

main()
