"""Armijo's line search along a projected direction (dissertation Alg. 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

__all__ = ["LineSearch", "Step", "Trial", "rounding_of"]

Iterate = TypeVar("Iterate")


def rounding_of(cost: float) -> float:
    """Return what a sum of about this size may be off by rounding."""
    return 20.0 * float(np.finfo(np.float64).eps) * abs(cost)


@dataclass(frozen=True)
class Trial(Generic[Iterate]):
    """A trajectory at some step length, and its cost.

    Attributes
    ----------
    iterate : Iterate
        The trajectory.
    cost : float
        Its cost.
    """

    iterate: Iterate
    cost: float


@dataclass(frozen=True)
class Step(Generic[Iterate]):
    """An accepted step, or the failure to find one.

    Attributes
    ----------
    trial : Trial or None
        The new iterate and its cost; None if there is none.
    length : float
        Step length; 0 if no step was accepted.
    rollouts : int
        Roll-outs tried.
    failure : str
        Why the last trial was refused; empty if it was accepted.
    """

    trial: Trial[Iterate] | None
    length: float
    rollouts: int
    failure: str


@dataclass(frozen=True)
class LineSearch:
    """Backtracking until ``g(xi + s dxi) <= h(xi) + alpha s Dg . dxi``.

    Attributes
    ----------
    alpha : float
        Fraction of the linear decrease that is asked for.
    beta : float
        Factor from one trial to the next.
    """

    alpha: float
    beta: float

    def __call__(
        self,
        simulate: Callable[[float, float], Trial[Iterate] | str],
        *,
        value: float,
        noise: float,
        slope: float,
        max_backtracks: int,
    ) -> Step[Iterate]:
        """Search from a trajectory, with this many shorter steps at most.

        Parameters
        ----------
        simulate : callable
            ``simulate(length, bound)`` returns the trajectory at a step length, or why it is refused;
            a cost above the bound is a reason.
        value, noise : float
            Cost of the trajectory, and what that may be off.
        slope : float
            ``Dg . dxi``.
        max_backtracks : int
            Shorter steps to be tried.
        """
        length = 1.0
        failure = ""
        for trial in range(max_backtracks + 1):
            outcome = simulate(length, value + self.alpha * length * slope + noise)
            if isinstance(outcome, Trial):
                return Step(outcome, length, trial + 1, "")
            failure = outcome
            length *= self.beta
        return Step(None, 0.0, max_backtracks + 1, failure)
