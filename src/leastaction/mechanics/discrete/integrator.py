"""What every integrator of a mechanism in discrete time offers to those that differentiate its steps."""

from __future__ import annotations

from abc import ABC, abstractmethod

from leastaction import _core
from leastaction.mechanics.discrete.linearization import StepDerivatives
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array


class Integrator(ABC):
    """Steps of one mechanism in discrete time. Holds settings, no state.

    Attributes
    ----------
    mechanism : Mechanism
    core : Midpoint of the core
    threads : int
        Threads for derivatives over a trajectory; 0: as many as there are cores.
    """

    mechanism: Mechanism
    core: _core.Midpoint
    threads: int

    @abstractmethod
    def like(self, mechanism: Mechanism) -> Integrator:
        """Return an integrator of another mechanism with the same settings."""

    @abstractmethod
    def linearize_arrays(
        self,
        t: Array,
        x: Array,
        u: Array,
        *,
        multipliers: bool = False,
        out: StepDerivatives | None = None,
    ) -> StepDerivatives:
        """Return the derivatives along states x (N+1, nx) and inputs u (N, nu + nrho) at times t."""
