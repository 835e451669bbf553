"""Armijo's line search along a projected direction (dissertation Alg. 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.optimal._arrays import Floats
from leastaction.optimal.costs import Cost
from leastaction.optimal.descent import Direction
from leastaction.optimal.protocol import DiscreteSystem

__all__ = ["LineSearch", "Step", "rounding_of"]


def rounding_of(cost: float) -> float:
    """Return what a sum of about this size may be off by rounding."""
    return 20.0 * float(np.finfo(np.float64).eps) * abs(cost)


@dataclass(frozen=True)
class Step:
    """An accepted step, or the failure to find one.

    Attributes
    ----------
    x, u : ndarray
        The new iterate; empty if there is none.
    cost : float
        Its cost.
    length : float
        Step length; 0 if no step was accepted.
    rollouts : int
        Roll-outs tried.
    failure : str
        Why the last trial was refused; empty if it was accepted.
    """

    x: Floats
    u: Floats
    cost: float
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
    chunk : int
        Steps simulated between two looks at the cost: a trial that is past its bound is given up.
    """

    alpha: float
    beta: float
    chunk: int

    def __call__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        x: Floats,
        u: Floats,
        value: float,
        direction: Direction,
        max_backtracks: int,
    ) -> Step:
        """Search from the trajectory (x, u) of cost `value`, with this many shorter steps at most."""
        length = 1.0
        failure = ""
        for trial in range(max_backtracks + 1):
            bound = value + self.alpha * length * direction.slope + rounding_of(value)
            xbar, ubar = direction.curve(x, u, length)
            outcome = self._simulate(system, cost, xbar, ubar, direction.gain, bound)
            if not isinstance(outcome, str):
                x_new, u_new, value_new = outcome
                return Step(x_new, u_new, value_new, length, trial + 1, "")
            failure = outcome
            length *= self.beta
        nothing = np.empty((0, 0))
        return Step(nothing, nothing, np.nan, 0.0, max_backtracks + 1, failure)

    def _simulate(
        self,
        system: DiscreteSystem,
        cost: Cost,
        xbar: Floats,
        ubar: Floats,
        K: Floats,
        bound: float,
    ) -> tuple[Floats, Floats, float] | str:
        """Return the trajectory and its cost, or why it is refused."""
        x, u = np.empty_like(xbar), np.empty_like(ubar)
        x[0] = xbar[0]
        stage_values = np.empty(system.N)
        for start in range(0, system.N, self.chunk):
            stop = min(start + self.chunk, system.N)
            part = system.rollout(x[start], xbar, ubar, K, start, stop)
            if not part.complete:
                return f"the roll-out failed: {part.failure}"
            x[start + 1 : stop + 1] = part.x[1:]
            u[start:stop] = part.u
            with np.errstate(over="ignore", invalid="ignore"):
                stage_values[start:stop] = cost.stage_values(x[start:stop], u[start:stop], start)
                spent = float(np.sum(stage_values[:stop]))
            if not np.isfinite(spent):
                return f"the cost is not finite by step {stop}"
            if cost.nonnegative and spent > bound:
                return f"the cost was past its bound by step {stop}"
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(np.sum(stage_values)) + cost.final_value(x[-1])
        # Not "total > bound": a NaN is refused.
        if not total <= bound:
            return f"a cost of {total:.10g}, where at most {bound:.10g} was wanted"
        return x, u, total
