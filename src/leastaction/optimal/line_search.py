"""Armijo's line search along a projected direction (dissertation Alg. 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from leastaction.numerics.step_quality import StepQuality

Iterate = TypeVar("Iterate")


_ROUNDING = 20.0 * float(np.finfo(np.float64).eps)


def rounding_of(cost: float) -> float:
    """Return what a sum of about this size may be off by rounding."""
    return _ROUNDING * abs(cost)


class Trial(NamedTuple, Generic[Iterate]):
    """A trajectory at some step length, and its cost.

    ``iterate``: the trajectory. ``cost``: its cost.
    """

    iterate: Iterate
    cost: float


@dataclass(frozen=True)
class Refusal:
    """Why a step length was refused.

    ``reason``: in words. ``step``: the step of time at which the roll-out ended; None if it came to the end. ``cost``:
    what the trajectory costs at least; NaN if that is not known. ``failed``: whether the roll-out could not be made to
    its end. ``hopeless``: whether shorter steps along this direction would be refused too. ``coarsest``: the coarsest
    step of time of a trial that was refused for one; None where that is not known.
    """

    reason: str
    step: int | None = None
    cost: float = np.nan
    failed: bool = False
    hopeless: bool = False
    coarsest: StepQuality | None = None


@dataclass(frozen=True)
class SearchStep(Generic[Iterate]):
    """An accepted step, or the failure to find one.

    ``trial``: The new iterate and its cost; None if there is none. ``length``: Step length; 0 if no step was accepted.
    ``rollouts``: Roll-outs tried. ``refusal``: The last trial that was refused; None if the first was accepted.
    """

    trial: Trial[Iterate] | None
    length: float
    rollouts: int
    refusal: Refusal | None


@dataclass(frozen=True)
class LineSearch:
    """Backtracking until ``g(xi + s dxi) <= h(xi) + alpha (s Dg . dxi + s^2 bend / 2)``.

    It ends where the step is so short that what is expected of it drowns in the cost's noise.

    ``alpha``: fraction of the expected decrease that a step has to reach. ``beta``: largest factor from one trial to
    the next. The parabola through what is known may say less.
    """

    alpha: float
    beta: float

    def __call__(
        self,
        simulate: Callable[[float, float], Trial[Iterate] | Refusal],
        *,
        value: float,
        noise: float,
        slope: float,
        bend: float = 0.0,
        max_backtracks: int,
        first: float = 1.0,
    ) -> SearchStep[Iterate]:
        """Search from a trajectory, with this many shorter steps at most.

        ``simulate``: ``simulate(length, bound)`` returns the trajectory at a step length, or why it is refused; a cost
        above the bound is a reason. ``value``, ``noise``: cost of the trajectory, and what that may be off. ``slope``:
        ``Dg . dxi``. ``bend``: the second derivative along the direction, if it is negative and to be followed for
        that. ``max_backtracks``: shorter steps to be tried. ``first``: length of the first trial.
        """
        length = first
        refusal = None
        for trial in range(max_backtracks + 1):
            expected = length * slope + 0.5 * length**2 * bend
            outcome = simulate(length, value + self.alpha * expected + noise)
            if isinstance(outcome, Trial):
                return SearchStep(outcome, length, trial + 1, refusal)
            refusal = outcome
            if outcome.hopeless or -expected <= noise:
                break
            length *= self._factor(outcome.cost - value, length * slope)
        return SearchStep(None, 0.0, trial + 1, refusal)

    def _factor(self, rise: float, linear: float) -> float:
        """Return where the parabola through the refused trial has its minimum, within limits."""
        if not isfinite(rise):
            return self.beta
        least = 0.4 * self.beta
        parabola = -0.5 * linear / max(rise - linear, 1e-300)
        return min(max(parabola, least), self.beta)
