"""What a search minimises, along the iterate: the cost alone, or with the barriers of limits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import ModelHessian, between
from leastaction.optimal.iterates.direction import DiscreteDirection, Iterate, ModelMinimum
from leastaction.optimal.iterates.here import Here
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import along_parabola
from leastaction.optimal.system import Linearization


class AlongIterate(Protocol):
    """What a merit needs of the models along the iterate."""

    def linearize(self) -> Linearization:
        """Return the derivatives of the dynamics."""

    def motion(self, direction: DiscreteDirection) -> tuple[Array, Array]:
        """Return the changes of states and inputs along a direction."""

    def solved_with(
        self, direction: DiscreteDirection, gradient: CostGradient, hessian: ModelHessian
    ) -> ModelMinimum | None:
        """Return the minimum of a direction's model with another gradient and other weights; None if it has none."""

    def left_of(self, gradient: CostGradient, hessian: ModelHessian) -> float | None:
        """Return the decrease that Newton's model expects with these derivatives; None if it has no minimum."""


class Merit(ABC):
    """What is minimised, with its derivatives along the iterate, which are kept until that moves.

    ``cost``: that of trajectories, of which a trial is given up early. ``has_barriers``: whether barriers are a part of
    it: `first_step` sees these, and beside their stiffness models may drown in rounding.
    """

    cost: Cost
    has_barriers: bool

    @abstractmethod
    def forget(self) -> None:
        """Drop all that was computed along the iterate."""

    @abstractmethod
    def forget_stage(self) -> None:
        """Drop what is no more so in another stage, along the same iterate."""

    @abstractmethod
    def plain_value(self) -> float:
        """Return the cost alone."""

    @abstractmethod
    def magnitude(self) -> float:
        """Return the cost that the tolerance is relative to."""

    @abstractmethod
    def guide(self, x: Array, u: Array) -> float:
        """Return what is added to the cost along some curve only to guide the search: barriers, prices of excess."""

    @abstractmethod
    def gradient(self) -> CostGradient:
        """Return the first derivatives."""

    @abstractmethod
    def lagrangian_gradient(self) -> CostGradient:
        """Return those of the Lagrangian, whose adjoint are the multipliers of the dynamics."""

    @abstractmethod
    def hessian(self, share: float, along: AlongIterate) -> ModelHessian:
        """Return the second derivatives, without the dynamics' part.

        Of what bends downwards only a share is in it, as of the curvature of the dynamics.
        """

    @abstractmethod
    def followed(self, direction: DiscreteDirection, along: AlongIterate) -> DiscreteDirection:
        """Return a direction that was found, with what it changes of the limits where that is told in the end."""

    @abstractmethod
    def refined(self, direction: DiscreteDirection, along: AlongIterate, *, holds: bool) -> DiscreteDirection:
        """Return what to follow in the place of a direction, by more of the same model, with what it changes of limits.

        ``holds``: whether the last step lowered the cost by what its model had predicted.
        """

    @abstractmethod
    def remaining_decrease(self, along: AlongIterate) -> float:
        """Return a decrease no smaller than what is left, where rounding drowns models; infinity if nothing tells."""

    @abstractmethod
    def settle(self) -> None:
        """Take the iterate for the last: nothing of the merit moves any more."""

    @abstractmethod
    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go along a direction at first, at most this far."""

    @abstractmethod
    def promised(self, direction: DiscreteDirection, length: float) -> float:
        """Return by how much the model of a direction lowers what is minimised; NaN where that is not known."""

    @abstractmethod
    def bound(self, bound: float) -> float:
        """Return the bound of the cost alone, given that of what is minimised."""

    @abstractmethod
    def judged(
        self, trial: Trial[Iterate], bound: float, explain: Callable[[Array, Refusal], Refusal]
    ) -> Trial[Iterate] | Refusal:
        """Return the trial of a trajectory with all that is minimised, or why it is refused.

        ``explain``: as of `try_projection`.
        """

    @abstractmethod
    def move(self, direction: DiscreteDirection, to: Iterate, along: AlongIterate) -> None:
        """Go along a direction: drop what was computed along the iterate before."""


class CostMerit(Merit):
    """The cost alone: that of a stage."""

    has_barriers = False

    def __init__(self, cost: Cost, here: Here) -> None:
        self.cost, self.here = cost, here
        self._gradient: CostGradient | None = None
        self._bend: dict[bool, ModelHessian] = {}  # the convex part of the second derivatives, and the whole

    def forget(self) -> None:
        self._gradient = None
        self._bend = {}

    def forget_stage(self) -> None:
        self.forget()

    def plain_value(self) -> float:
        curve = self.here.curve
        return self.here.value if curve is None else curve.shown

    def magnitude(self) -> float:
        return self.here.value

    def guide(self, x: Array, u: Array) -> float:  # noqa: ARG002 - there is nothing
        return 0.0

    def gradient(self) -> CostGradient:
        if self._gradient is None:
            self._gradient = self.cost.gradient(self.here.x, self.here.u)
        return self._gradient

    def lagrangian_gradient(self) -> CostGradient:
        return self.gradient()

    def hessian(self, share: float, along: AlongIterate) -> ModelHessian:  # noqa: ARG002
        if share == 1.0:
            return self._part(convex=False)
        convex = self._part(convex=True)
        return convex if share == 0.0 else between(convex, self._part(convex=False), share)

    def _part(self, *, convex: bool) -> ModelHessian:
        """Return the convex part of the second derivatives, or all of them."""
        if convex not in self._bend:
            self._bend[convex] = self.cost.model_hessian(self.here.x, self.here.u, convex=convex)
        return self._bend[convex]

    def followed(self, direction: DiscreteDirection, along: AlongIterate) -> DiscreteDirection:  # noqa: ARG002
        return direction

    def refined(self, direction: DiscreteDirection, along: AlongIterate, *, holds: bool) -> DiscreteDirection:  # noqa: ARG002
        return direction

    def remaining_decrease(self, along: AlongIterate) -> float:  # noqa: ARG002
        return np.inf

    def settle(self) -> None:
        pass

    def first_step(self, direction: DiscreteDirection, length: float) -> float:  # noqa: ARG002
        return length

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        return along_parabola(direction, length)

    def bound(self, bound: float) -> float:
        return bound

    def judged(
        self,
        trial: Trial[Iterate],
        bound: float,  # noqa: ARG002 - it was held to it
        explain: Callable[[Array, Refusal], Refusal],  # noqa: ARG002
    ) -> Trial[Iterate] | Refusal:
        return trial

    def move(self, direction: DiscreteDirection, to: Iterate, along: AlongIterate) -> None:  # noqa: ARG002
        self.forget()

    def replaced(self, cost: Cost) -> None:
        """Have another cost from now on."""
        self.cost = cost
        self.forget()
