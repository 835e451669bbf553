"""What a mechanism can be asked: functions that are methods of `Mechanism`, and what they return."""

from __future__ import annotations

from leastaction.mechanics.mechanism.queries import constraints, frames, functions, masses, units

__all__ = ["constraints", "frames", "functions", "masses", "units"]
