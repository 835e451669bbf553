"""A cost with the barriers of limits added to it: what the optimiser's loop minimises."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import is_diagonal
from leastaction.optimal.discrete.cost import Cost, CostGradient, CostHessian
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.barrier import barrier_value, first_duals, moved_duals, split, stiffness
from leastaction.optimal.limits.rows import Rows, Weights

__all__ = ["LimitedCost"]

_DEAR = 10.0  # times its dual is the price of an excess
_CHEAPER, _DEARER = 1e-3, 10.0  # by which prices change at most
_BINDING = 0.5  # of the price is the dual of a limit that the price does not enforce
_DIGITS = 1e4 * float(np.finfo(np.float64).eps)  # of a limit's size is the least room that is told from none
_SETTLED = 2.3  # natural logarithm of the factor by which duals may be off those of the barrier in the end


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
        self.mu = np.nan
        self.scale: list[Array] = []
        self.rho: list[Array] = []
        self.y: list[Array] = []

    @property
    def count(self) -> int:
        """Number of rows over the horizon."""
        return sum(rows.bounds.size for rows in self.rows)

    def begin(self, x: Array, u: Array, mu: float, price: float) -> None:
        """Choose scales, prices and duals from where the optimisation starts."""
        self.mu = mu
        c = self.limits(x, u)
        for rows, values in zip(self.rows, c, strict=True):
            seen = np.maximum(np.abs(values).max(axis=0), 1e-6 * (1.0 + np.abs(rows.bounds).max(axis=0)))
            self.scale.append(np.where(rows.scale > 0.0, rows.scale, seen))
        self.rho = [price / scale for scale in self.scale]
        self.y = [first_duals(y, rho) for y, rho in zip(self.barrier_duals(x, u), self.rho, strict=True)]

    # ---- Values -----------------------------------------------------------------------------------

    def limits(self, x: Array, u: Array) -> list[Array]:
        """Return the values c of all rows."""
        return [rows.values(x, u) for rows in self.rows]

    def barriers(self, x: Array, u: Array) -> float:
        """Return the barriers of a trajectory."""
        return sum(barrier_value(c, self.mu, rho) for c, rho in zip(self.limits(x, u), self.rho, strict=True))

    def excess(self, x: Array, u: Array) -> float:
        """Return the largest violation of a limit, relative to its scale."""
        return max(
            float(np.max(-c / scale, initial=0.0)) for c, scale in zip(self.limits(x, u), self.scale, strict=True)
        )

    # ---- Derivatives ------------------------------------------------------------------------------

    def barrier_duals(self, x: Array, u: Array) -> list[Array]:
        """Return the duals of the barriers themselves, ``mu / s``."""
        return [self.mu / split(c, self.mu, rho).slack for c, rho in zip(self.limits(x, u), self.rho, strict=True)]

    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives."""
        return self._lagrangian(x, u, self.barrier_duals(x, u))

    def lagrangian(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives of the cost less the duals times the limits."""
        return self._lagrangian(x, u, self.y)

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
        for rows, c, rho, y in zip(self.rows, self.limits(x, u), self.rho, self.y, strict=True):
            sigma = stiffness(split(c, self.mu, rho), rho, y)
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

    # ---- Duals and prices -------------------------------------------------------------------------

    def next_duals(self, x: Array, u: Array, dx: Array, du: Array, x_new: Array, u_new: Array) -> list[Array]:
        """Return the duals moved along their own direction, by a step from x, u along dx, du to x_new, u_new."""
        moved = []
        new = self.barrier_duals(x_new, u_new)
        for rows, c, rho, y, barrier in zip(self.rows, self.limits(x, u), self.rho, self.y, new, strict=True):
            part = split(c, self.mu, rho)
            dy = self.mu / part.slack - y - stiffness(part, rho, y) * rows.along(x, u, dx, du)
            moved.append(moved_duals(y, dy, barrier, rho))
        return moved

    def net_duals(self) -> list[Array]:
        """Return the duals, of both sides of an equation their difference."""
        net = list(self.y)
        for i, rows in enumerate(self.rows):
            if rows.equal and rows.sign > 0.0:
                net[i], net[i + 1] = self.y[i] - self.y[i + 1], self.y[i + 1] - self.y[i]
        return net

    def hopeless(self) -> bool:
        """Whether some limit is not enforced though its price is the dearest there is."""
        return any(
            bool((np.max(np.abs(net), axis=0, initial=0.0) > _BINDING * rho).any())
            for net, rho in zip(self.net_duals(), self.rho, strict=True)
        )

    def least_mu(self) -> float:
        """Return the parameter below which the room that it leaves would be a matter of rounding."""
        return max(
            (
                _DIGITS * float(np.max(y * (scale + np.abs(rows.bounds)), initial=0.0))
                for rows, y, scale in zip(self.rows, self.y, self.scale, strict=True)
                if not rows.equal
            ),
            default=0.0,
        )

    def settled(self, duals: Sequence[Array], x: Array, u: Array) -> list[Array]:
        """Return duals; where they have not come near those of the barrier, these."""
        return [
            np.where(np.abs(np.log(y / barrier)) < _SETTLED, y, barrier)
            for y, barrier in zip(duals, self.barrier_duals(x, u), strict=True)
        ]

    def shapes(self) -> list[tuple[tuple[str, ...], tuple[int, ...]]]:
        """Return labels and shapes of the sides, as a report has them."""
        return [(r.labels, r.bounds.shape) for r in self.rows if not (r.equal and r.sign < 0.0)]

    def take(self, report: LimitReport) -> None:
        """Begin with the duals and prices of an earlier optimisation with the same limits."""
        sides = iter(report.sides)
        for i, rows in enumerate(self.rows):
            if rows.equal and rows.sign < 0.0:
                self.rho[i] = self.rho[i - 1]
                self.y[i] = self.rho[i] - self.y[i - 1]
                continue
            side = next(sides)
            self.rho[i] = side.price.copy()
            if rows.equal:
                self.y[i] = 0.5 * (side.price + np.clip(side.dual, -0.9 * side.price, 0.9 * side.price))
            else:
                self.y[i] = np.clip(side.dual, 1e-12 * side.price, 0.9 * side.price)

    def price(self, x: Array, u: Array, dearest: float) -> bool:
        """Set the prices of excess by the duals; whether some limit needs a price that is higher.

        Parameters
        ----------
        x, u : ndarray
            The minimum at these prices and this mu.
        dearest : float
            What an excess of a limit's scale may cost at most.
        """
        unmet = False
        c = self.limits(x, u)
        for i, (net, scale) in enumerate(zip(self.net_duals(), self.scale, strict=True)):
            rho = self.rho[i]
            binding = (np.max(np.abs(net), axis=0, initial=0.0) > _BINDING * rho) & (rho < dearest / scale)
            new = np.where(
                binding,
                np.minimum(_DEARER * rho, dearest / scale),
                # Equations are met the better the dearer they are.
                rho if self.rows[i].equal else np.clip(_DEAR * np.max(net, axis=0), _CHEAPER * rho, rho),
            )
            unmet = unmet or bool(binding.any())
            self.rho[i] = new
            if self.rows[i].equal:
                self.y[i] = 0.5 * (new + np.clip(net, -0.9 * new, 0.9 * new))
            else:
                self.y[i] = np.where(
                    binding & (c[i] < 0.0),
                    first_duals(np.minimum(self.y[i], 0.9 * new), new),
                    np.minimum(self.y[i], 0.9 * new),
                )
        return unmet


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
