"""Which times the steps of a search stand for."""

from __future__ import annotations

from abc import ABC, abstractmethod

from leastaction.numerics.arrays import Array
from leastaction.optimal.iterates.here import Here


class TimeGrid(ABC):
    """The times that the steps of a problem stand for.

    ``is_mesh``: whether they are pieces of a continuous horizon. What these do not resolve, a finer mesh does.
    """

    is_mesh: bool

    @abstractmethod
    def tolerated(self, goal: float, here: Here) -> float:
        """Return the expected decrease that is small enough, given what is so on any grid."""

    @abstractmethod
    def arrays(self, here: Here) -> tuple[Array, Array]:
        """Return states and inputs as they are told."""


class OwnSteps(TimeGrid):
    """The times of the discrete system itself."""

    is_mesh = False

    def tolerated(self, goal: float, here: Here) -> float:  # noqa: ARG002
        return goal

    def arrays(self, here: Here) -> tuple[Array, Array]:
        return here.x, here.u
