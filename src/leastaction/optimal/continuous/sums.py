"""Sums of costs in continuous time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.continuous.cost import ContinuousCost, RateGradient, RateHessian
from leastaction.optimal.continuous.final_term import FinalTerm


@public
class ContinuousCostSum(ContinuousCost):
    """The sum of costs in continuous time; as fit for several threads as they are.

    Parameters
    ----------
    costs : sequence of ContinuousCost
        At least one, all for the same system.

    Raises
    ------
    ArgumentError
        What is no cost in continuous time.
    """

    def __init__(self, costs: Sequence[ContinuousCost]) -> None:
        self.costs = tuple(costs)
        if not self.costs:
            raise ArgumentError("costs: got none, expected at least one cost")
        for each in self.costs:
            require_instance(each, "costs", ContinuousCost, "such as a ContinuousQuadraticCost")
        self.nonnegative = all(each.nonnegative for each in self.costs)
        self.jumps = tuple(sorted({t for each in self.costs for t in each.jumps}))
        self.final_term = SummedFinalTerm(self.costs)

    def check(self, t0: float, tf: float, nx: int, nu: int) -> None:
        for each in self.costs:
            each.check(t0, tf, nx, nu)

    def rate(self, x: Array, u: Array, t: float) -> float:
        return float(sum(each.rate(x, u, t) for each in self.costs))

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        return np.asarray(sum(each.rates(x, u, t) for each in self.costs))

    def gradient(self, x: Array, u: Array, t: Array) -> RateGradient:
        found = [each.gradient(x, u, t) for each in self.costs]
        return RateGradient(*(np.asarray(sum(parts)) for parts in zip(*found, strict=True)))

    def hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        return _added([each.hessian(x, u, t) for each in self.costs], len(x))

    def own_convex_hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        """Return the sum of the convex parts; see `ContinuousCost`."""
        return _added([each.convex_hessian(x, u, t) for each in self.costs], len(x))


class SummedFinalTerm(FinalTerm):
    """What the last state costs by all of some costs."""

    def __init__(self, costs: Sequence[ContinuousCost]) -> None:
        self.costs = tuple(costs)

    def value(self, x: Array, t: float) -> float:
        return float(sum(each.final_value(x, t) for each in self.costs))

    def gradient(self, x: Array, t: float) -> Array:
        return np.asarray(sum(each.final_gradient(x, t) for each in self.costs))

    def hessian(self, x: Array, t: float) -> Array:
        return np.asarray(sum(each.final_hessian(x, t) for each in self.costs))

    def convex_hessian(self, x: Array, t: float) -> Array:
        return np.asarray(sum(each.convex_final_hessian(x, t) for each in self.costs))


def _added(hessians: Sequence[RateHessian], n: int) -> RateHessian:
    """Return the sum of second derivatives, a matrix for each of n samples."""
    Q, R = (
        np.asarray(sum(np.broadcast_to(matrix, (n, *matrix.shape[-2:])) for matrix in matrices))
        for matrices in ([each.Q for each in hessians], [each.R for each in hessians])
    )
    cross = [each.S for each in hessians if each.S is not None]
    return RateHessian(Q, R, np.asarray(sum(cross)) if cross else None)
