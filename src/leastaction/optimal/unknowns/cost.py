"""The cost of a system's motion and of its unknowns, over the states of an extended system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost, CostGradient, CostHessian
from leastaction.optimal.unknowns.unknown import FinalTime, Unknown

__all__ = ["ExtendedCost"]


class ExtendedCost(Cost):
    """A cost of the system's own states, and prices of its unknowns, paid at the end; as fit for threads as the cost.

    ``wanted`` (P,): values that cost nothing. ``nx``: number of the system's own states. ``size``: of all states.
    """

    def __init__(self, cost: Cost, unknowns: Sequence[Unknown], wanted: Array, nx: int, size: int) -> None:
        self.cost, self.n_own, self.nx = cost, nx, size
        self.unknowns = slice(nx, nx + len(unknowns))
        self.price = np.array([each.price for each in unknowns])
        self.weight = np.array([each.weight for each in unknowns])
        self.wanted = wanted
        # Only of a time it is known that it is no less than zero.
        safe = all(each.price == 0.0 or (each.price > 0.0 and isinstance(each, FinalTime)) for each in unknowns)
        self.nonnegative = cost.nonnegative and safe

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        """Return the cost of the stages."""
        return self.cost.stage_values(x[:, : self.n_own], u, start)

    def final_value(self, x: Array) -> float:
        """Return the cost of the last state and of the unknowns."""
        values = x[self.unknowns]
        prices = self.price @ values + 0.5 * self.weight @ (values - self.wanted) ** 2
        return self.cost.final_value(x[: self.n_own]) + float(prices)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives."""
        own = self.cost.gradient(x[:, : self.n_own], u)
        q, q_final = np.zeros((len(u), self.nx)), np.zeros(self.nx)
        q[:, : self.n_own], q_final[: self.n_own] = own.q, own.q_final
        q_final[self.unknowns] = self.price + self.weight * (x[-1, self.unknowns] - self.wanted)
        return CostGradient(q, own.r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives."""
        Q, R, S, Q_final = self.cost.hessian(x[:, : self.n_own], u)
        final = self._padded(Q_final)
        diagonal = final if final.ndim == 1 else np.einsum("ii->i", final)
        diagonal[self.unknowns] = self.weight
        if S is not None:
            whole = np.zeros((*S.shape[:-2], self.nx, S.shape[-1]))
            whole[..., : self.n_own, :] = S
            S = whole
        return CostHessian(self._padded(Q), R, S, final)

    def _padded(self, weight: Array) -> Array:
        """Return a weight of any of the shapes of a `CostHessian` with zeros for all but the system's own states."""
        n, size = self.n_own, self.nx
        if weight.ndim == 1:
            return np.concatenate([weight, np.zeros(size - n)])
        if weight.ndim == 3 and weight.shape[2] == 1:
            return np.concatenate([weight, np.zeros((len(weight), size - n, 1))], axis=1)
        whole = np.zeros((*weight.shape[:-2], size, size))
        whole[..., :n, :n] = weight
        return whole
