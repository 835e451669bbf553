"""The door of the command line, outside of the package so that it opens before the package is imported.

Importing takes a moment, and Ctrl-C in that moment should end the program as it does later: in one line.
"""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and exit."""
    try:
        from leastaction.apps.cli import main as run
    except KeyboardInterrupt:
        print("error: interrupted before there was a result to keep", file=sys.stderr)
        sys.exit(130)
    run()
