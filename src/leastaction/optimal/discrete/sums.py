"""Sums of costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian


@public
class CostSum(Cost):
    """The sum of costs; as fit for several threads as they are.

    Parameters
    ----------
    costs : sequence of Cost
        At least one, all for the same horizon.

    Raises
    ------
    ArgumentError
        What is no cost.
    """

    def __init__(self, costs: Sequence[Cost]) -> None:
        self.costs = tuple(costs)
        if not self.costs:
            raise ArgumentError("costs: got none, expected at least one cost")
        for each in self.costs:
            require_instance(each, "costs", Cost, "in continuous time it is a ContinuousCostSum")
        self.nonnegative = all(each.nonnegative for each in self.costs)
        self.needs = tuple(sorted({need for each in self.costs for need in each.needs}))
        self.before = next((each.before for each in self.costs if each.before is not None), None)

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        for each in self.costs:
            each.check_shapes(N, nx, nu)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return np.asarray(sum(each.stage_values(x, u, start) for each in self.costs))

    def final_value(self, x: Array) -> float:
        return float(sum(each.final_value(x) for each in self.costs))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        found = [each.gradient(x, u) for each in self.costs]
        return CostGradient(*(np.asarray(sum(parts)) for parts in zip(*found, strict=True)))

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return _added([each.hessian(x, u) for each in self.costs])

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the sum of the convex parts; see `Cost`."""
        return _added([each.convex_hessian(x, u) for each in self.costs])

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        return CostSum([each.window(start, stop, N=N, nu=nu) for each in self.costs])

    def remembering(self, system: Any) -> Cost:
        return CostSum([system.cost_of(each) for each in self.costs])

    @property
    def wanted_states(self) -> Array | None:
        return self.costs[0].wanted_states


def _added(hessians: Sequence[CostHessian]) -> CostHessian:
    """Return the sum of second derivatives."""
    Q, R, S, Q_final = hessians[0]
    for more in hessians[1:]:
        cross = S if more.S is None else more.S if S is None else S + more.S
        Q, R, S, Q_final = _plus(Q, more.Q), _plus(R, more.R), cross, _plus(Q_final, more.Q_final)
    return CostHessian(Q, R, S, Q_final)


def _plus(one: Array, other: Array) -> Array:
    if one.ndim == 1 and other.ndim == 1:
        return np.asarray(one + other)
    return np.ascontiguousarray(matrix_of(one) + matrix_of(other))
