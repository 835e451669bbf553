"""What the command line does with any mechanism: look, simulate, regulate, check, convert, time."""

from __future__ import annotations
