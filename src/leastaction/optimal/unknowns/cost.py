"""The cost of a system's motion and of its unknowns, over the states of an extended system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.cost import across, diagonal_of, matrix_of, widened
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.unknowns.system import ExtendedSystem
from leastaction.optimal.unknowns.unknown import FinalTime, Unknown


class ExtendedCost(Cost):
    """A cost of the system's own states, and prices of its unknowns, paid at the end; as fit for threads as the cost.

    ``wanted`` (P,): values that cost nothing.
    """

    def __init__(self, cost: Cost, unknowns: Sequence[Unknown], wanted: Array, system: ExtendedSystem) -> None:
        self.cost, self.system, self.n_own, self.nx = cost, system, system.d_own, system.ndx
        self.unknowns = slice(system.n_own, system.layout.at_copies)  # in a state, and in a difference of states
        self.changes = slice(system.d_own, system.d_own + len(system.names))
        self.price = np.array([each.price for each in unknowns])
        self.weight = np.array([each.weight for each in unknowns])
        self.wanted = wanted
        # Only of a time it is known that it is no less than zero.
        safe = all(each.price == 0.0 or (each.price > 0.0 and isinstance(each, FinalTime)) for each in unknowns)
        self.nonnegative = cost.nonnegative and safe

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self.cost.stage_values(read_only(self.system.own(x)), u, start)

    def final_value(self, x: Array) -> float:
        values = x[self.unknowns]
        prices = self.price @ values + 0.5 * self.weight @ (values - self.wanted) ** 2
        return self.cost.final_value(read_only(self.system.own(x))) + float(prices)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        own = self.cost.gradient(read_only(self.system.own(x)), u)
        q, q_final = self.moved(own.q), self.moved(own.q_final)
        q_final[self.changes] = self.price + self.weight * (x[-1, self.unknowns] - self.wanted)
        return CostGradient(q, own.r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return self._extended(self.cost.hessian(read_only(self.system.own(x)), u), self.weight)

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the cost's own, and a curvature of the final time, which the cost is linear in.

        A motion that begins at rest has no curvature by its duration: with that of ``T log T`` the model holds as far
        as its steps lead.
        """
        weight, time = self.weight, self.system.final_time
        if time is not None:
            j = time - self.system.n_own
            weight = weight.copy()
            weight[j] += abs(self.price[j]) / (x[-1, time] - self.system.time(0))
        return self._extended(self.cost.convex_hessian(read_only(self.system.own(x)), u), weight)

    def _extended(self, own: CostHessian, weight: Array) -> CostHessian:
        Q, R, S, Q_final = own
        final = self.padded(Q_final)
        diagonal_of(final)[self.changes] = weight
        return CostHessian(self.padded(Q), R, None if S is None else across(S, self.moved), final)

    def moved(self, rows: Array) -> Array:
        """Return derivatives (..., nx) by the extended state of those (..., n) by the system's own."""
        n, end = self.n_own, self.changes.stop
        whole = np.zeros((*rows.shape[:-1], self.nx))
        whole[..., :n] = rows
        whole[..., end : end + len(self.system.copied)] = rows[..., self.system.layout.kept_moves]
        return whole

    def padded(self, weight: Array) -> Array:
        """Return a weight of any of the shapes of a `CostHessian` as one of the extended state."""
        if weight.ndim == 1 and len(self.system.copied):
            moves = self.system.moves
            return np.asarray((moves.T * weight) @ moves)
        return widened(matrix_of(weight) if len(self.system.copied) else weight, self.moved)
