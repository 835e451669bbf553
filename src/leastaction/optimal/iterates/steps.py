"""How a search goes from one iterate to the next."""

from __future__ import annotations

from abc import ABC, abstractmethod

from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution
from leastaction.optimal.iterates.direction import DiscreteDirection, Iterate
from leastaction.optimal.line_search import Refusal, Trial


class Steps(ABC):
    """Directions from an iterate, and steps along them: of trajectories, or of curves with gaps."""

    @abstractmethod
    def direction(self, method: str, model: LinearQuadraticSolution, scale: float, shift: float) -> DiscreteDirection:
        """Return the direction of a model that has a minimum."""

    @abstractmethod
    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go along a direction at first, at most this far."""

    @abstractmethod
    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Iterate] | Refusal:
        """Return the iterate at a step along the direction, or why it is refused."""

    @abstractmethod
    def promised(self, direction: DiscreteDirection, length: float) -> float:
        """Return by how much the model of a direction lowers what is minimised; NaN where that is not known."""

    @abstractmethod
    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        """Make a trial the current iterate."""
