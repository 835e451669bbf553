"""What a roll-out returns."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality


@public
@dataclass(frozen=True)
class Rollout:
    """A trajectory, or the part of it up to the step that failed. Threads may share it.

    Attributes
    ----------
    x : ndarray (steps_done + 1, nx)
        States, the first one is where the roll-out started.
    u : ndarray (steps_done, nu)
        Inputs that were applied.
    steps_done : int
        Number of steps that succeeded.
    failure : str or None
        Why the roll-out ended early; None if it did not.
    worst_step : StepQuality or None
        The coarsest step, which may be the one that failed; None where the system does not know.
    worst_at : int or None
        Which step of the horizon that is.
    """

    x: Array
    u: Array
    steps_done: int
    failure: str | None = None
    worst_step: StepQuality | None = None
    worst_at: int | None = None

    @property
    def complete(self) -> bool:
        """Whether every step succeeded."""
        return self.failure is None
