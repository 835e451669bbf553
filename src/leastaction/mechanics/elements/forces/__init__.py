"""Forces: motors, damping, drag, tendons and wrenches."""

from __future__ import annotations
