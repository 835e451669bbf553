"""Which times the steps of a discrete problem stand for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.here import Here
from leastaction.optimal.result import OptimizationResult

if TYPE_CHECKING:
    from leastaction.optimal.discrete.problem import DiscreteProblem


class TimeGrid(ABC):
    """The times that the steps of a problem stand for.

    ``is_mesh``: whether they are pieces of a continuous horizon. Then a search does not begin again: what its steps do
    not resolve, a finer mesh does.
    """

    is_mesh: bool

    @abstractmethod
    def tolerated(self, goal: float, noise: float) -> float:
        """Return the expected decrease that is small enough, given what is so on any grid."""

    @abstractmethod
    def note_step(self) -> None:
        """Remember that a step was made."""

    @abstractmethod
    def following(self, problem: DiscreteProblem) -> DiscreteProblem | None:
        """Return the problem on a finer grid, where the motion asks for it."""

    @abstractmethod
    def arrays(self, here: Here) -> tuple[Array, Array]:
        """Return states and inputs as they are told."""

    @abstractmethod
    def result(self, problem: DiscreteProblem, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result at the current iterate, given all that the loop knows of it."""


class OwnSteps(TimeGrid):
    """The times of the discrete system itself."""

    is_mesh = False

    def tolerated(self, goal: float, noise: float) -> float:  # noqa: ARG002
        return goal

    def note_step(self) -> None:
        pass

    def following(self, problem: DiscreteProblem) -> DiscreteProblem | None:  # noqa: ARG002
        return None

    def arrays(self, here: Here) -> tuple[Array, Array]:
        return here.x, here.u

    def result(self, problem: DiscreteProblem, summary: dict[str, Any]) -> OptimizationResult:
        return problem.told(summary)
