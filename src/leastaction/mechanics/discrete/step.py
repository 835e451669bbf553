"""What a time step returns."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.mechanics.discrete.trajectory import State
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality


@public
@dataclass(frozen=True)
class Step:
    """One solved time step. Nothing in it changes: threads may share it.

    Attributes
    ----------
    state : State
        The state at its end.
    lam : ndarray, shape (nc,)
        Multipliers (impulses).
    iterations : int
        Newton iterations.
    quality : StepQuality or None
        How coarse it was.
    """

    state: State
    lam: Array
    iterations: int
    quality: StepQuality | None = None
