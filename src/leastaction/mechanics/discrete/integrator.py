"""What every integrator of a mechanism in discrete time offers to those that differentiate its steps."""

from __future__ import annotations

from abc import ABC, abstractmethod

from leastaction import _core
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.singularity import SingularityWatch


class Integrator(ABC):
    """Steps of one mechanism in discrete time. Holds settings and no state, so that threads may share it.

    ``threads``: threads for derivatives over a trajectory; 0: as many as there are cores. ``shares``: how much of a
    force acts at the start and at the end of a step. ``watch``: tells of joints that come near their singularity.
    ``reels``: whether lengths are prescribed.
    """

    mechanism: Mechanism
    core: _core.Midpoint
    threads: int
    shares: tuple[float, float]
    watch: SingularityWatch
    reels: bool

    @abstractmethod
    def like(self, mechanism: Mechanism) -> Integrator:
        """Return an integrator of another mechanism with the same settings."""
