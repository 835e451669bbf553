"""What the command line does with any mechanism: looking at it, simulating, regulating, checking, converting, timing."""

from __future__ import annotations
