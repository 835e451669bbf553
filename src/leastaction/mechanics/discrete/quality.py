"""What the core tells of how coarse the steps were, by name."""

from __future__ import annotations

from leastaction import _core
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality


def quality_of(mechanism: Mechanism, out: _core.RollOut, t: Array) -> StepQuality | None:
    """Return the coarsest step of a roll-out over the times t; None if it made none."""
    worst = out.worst
    if worst.k < 0:
        return None
    name = mechanism.variables[worst.variable] if worst.variable >= 0 else ""
    return StepQuality(float(t[worst.k]), worst.s, worst.angle, name)
