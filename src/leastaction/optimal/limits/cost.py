"""A cost with the barriers of limits added to it: what the optimiser's loop minimises."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import is_diagonal
from leastaction.optimal.discrete.cost import Cost, CostGradient, CostHessian
from leastaction.optimal.limits.barrier import barrier_value
from leastaction.optimal.limits.duals import Duals, Side
from leastaction.optimal.limits.rows import Rows, Weights

__all__ = ["LimitedCost"]


class LimitedCost:
    """A cost, the elastic barriers of limits, and their duals.

    Its gradient is that of the sum. Its Hessian takes the duals' stiffness in place of the barrier's own second
    derivative, which holds over much longer steps: a primal-dual interior point method.

    Parameters
    ----------
    cost : Cost
    rows : sequence of Rows
        Both sides of equations one after the other.
    """

    def __init__(self, cost: Cost, rows: Sequence[Rows]) -> None:
        self.cost, self.rows = cost, tuple(rows)
        self.duals = Duals(
            [
                Side(r.limit, r.labels, r.equal, r.equal and r.sign > 0.0, r.scale, np.abs(r.bounds).max(axis=0))
                for r in self.rows
            ]
        )

    @property
    def count(self) -> int:
        """Number of rows over the horizon."""
        return sum(rows.bounds.size for rows in self.rows)

    # ---- Values -----------------------------------------------------------------------------------

    def limits(self, x: Array, u: Array) -> list[Array]:
        """Return the values c of all rows."""
        return [rows.values(x, u) for rows in self.rows]

    def barriers(self, x: Array, u: Array) -> float:
        """Return the barriers of a trajectory."""
        duals = self.duals
        return sum(barrier_value(c, duals.mu, rho) for c, rho in zip(self.limits(x, u), duals.rho, strict=True))

    # ---- Derivatives ------------------------------------------------------------------------------

    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives."""
        return self._lagrangian(x, u, self.duals.of_barrier(self.limits(x, u)))

    def lagrangian(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives of the cost less the duals times the limits."""
        return self._lagrangian(x, u, self.duals.y)

    def _lagrangian(self, x: Array, u: Array, duals: Sequence[Array]) -> CostGradient:
        gradient = self.cost.gradient(x, u)
        q, r = np.vstack([gradient.q, gradient.q_final]), gradient.r.copy()
        for rows, y in zip(self.rows, duals, strict=True):
            rows.add_gradient(x, u, y, q, r)
        return CostGradient(q[:-1], r, q[-1])

    def hessian(self, x: Array, u: Array, dynamics: Array | None = None) -> CostHessian:
        """Return the second derivatives of the primal-dual model; dynamics are ``[A B]`` for what looks ahead."""
        Q, R, S, Q_final = self.cost.hessian(x, u)
        nx = x.shape[1]
        weights = Weights(len(u), nx, u.shape[1])
        sigmas = self.duals.stiffnesses(self.limits(x, u))
        for rows, sigma, y in zip(self.rows, sigmas, self.duals.y, strict=True):
            rows.add_hessian(x, u, y, sigma, weights, dynamics)
        final = _matrix(Q_final) + np.diag(weights.state[-1])
        if weights.state_matrix is not None:
            final = final + weights.state_matrix[-1]
            Q = _matrix(Q) + weights.state_matrix[:-1]
        Q, R = _with(Q, weights.state[:-1]), _with(R, weights.input)
        H = weights.matrix
        if H is None:
            return CostHessian(Q, R, S, final)
        cross = H[:, :nx, nx:] if S is None else S + H[:, :nx, nx:]
        return CostHessian(_matrix(Q) + H[:, :nx, :nx], _matrix(R) + H[:, nx:, nx:], np.ascontiguousarray(cross), final)

    # ---- Duals ------------------------------------------------------------------------------------

    def next_duals(self, x: Array, u: Array, dx: Array, du: Array, x_new: Array, u_new: Array) -> list[Array]:
        """Return the duals moved along their own direction, by a step from x, u along dx, du to x_new, u_new."""
        along = [rows.along(x, u, dx, du) for rows in self.rows]
        return self.duals.moved(self.limits(x, u), along, self.limits(x_new, u_new))


def _matrix(weight: Array) -> Array:
    """Return a weight of any of the shapes of a `CostHessian` as matrices."""
    if not is_diagonal(weight):
        return weight
    return np.diag(weight) if weight.ndim == 1 else weight * np.eye(weight.shape[1])


def _with(weight: Array, diagonal: Array) -> Array:
    """Return a weight with a diagonal of every stage added."""
    if not diagonal.any():
        return weight
    if is_diagonal(weight):
        return np.asarray(((weight if weight.ndim == 1 else weight[:, :, 0]) + diagonal)[:, :, None])
    n = weight.shape[-1]
    full = np.array(np.broadcast_to(weight, (len(diagonal), n, n)))
    full[:, np.arange(n), np.arange(n)] += diagonal
    return full
