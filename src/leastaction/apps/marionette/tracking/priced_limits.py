"""A price on what limits are broken by, in place of the limits.

Within limits the optimiser keeps barriers, which are steep where much has to change for a little room. A motion that
breaks limits by little is led back to them by a price more surely: half the square of how far each is off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal import Cost, DiscreteSystem, Limit
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.discrete.cost import AddedCost, CostGradient, CostHessian
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Instants, Samples


class PricedLimit(NamedTuple):
    """A limit, and the weight of half the square of what it is broken by, in its own unit.

    Of quantities of the state, or of state and input; at the first instant nothing is asked of the state.
    """

    limit: Limit
    weight: float


class _Broken(NamedTuple):
    """Rows of a limit where they are asked: instants ``k`` (n,), and by how much they are off there (n, m), or 0."""

    rows: Rows
    weight: float
    at: Samples
    off: Array


class PricedLimits(AddedCost):
    """Another cost, and the price of limits that are broken. As fit for several threads as the other cost.

    Its second derivative is that of Gauss and Newton: without the curvature of what is limited.
    """

    def __init__(self, cost: Cost, system: DiscreteSystem, priced: Sequence[PricedLimit]) -> None:
        super().__init__(cost, "limits", (system.N, system.nx, system.nu))
        self._rows = tuple((rows, each.weight) for each in priced for rows in each.limit.rows(system, 1))

    def off(self, x: Array, u: Array) -> float:
        """Return by how much limits are off at most along a trajectory, each in its own unit."""
        return max((float(each.off.max(initial=0.0)) for each in self._broken(x, u, 0)), default=0.0)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        values = np.array(self.cost.stage_values(x, u, start))
        for each in self._broken(x, u, start):
            np.add.at(values, each.at.k - start, 0.5 * each.weight * np.sum(each.off**2, axis=1))
        return values

    def final_value(self, x: Array) -> float:
        nothing, end = np.empty((0, self._sizes[2])), self._sizes[0]
        price = sum(0.5 * each.weight * float(np.sum(each.off**2)) for each in self._broken(x[None, :], nothing, end))
        return super().final_value(x) + price

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        slopes = np.hstack([np.vstack([q, q_final]), np.vstack([r, np.zeros_like(r[:1])])])
        for each in self._broken(x, u, 0):
            jacobian, columns = self._slopes(each)
            pull = -each.weight * each.rows.sign * each.off
            slopes[np.ix_(each.at.k, columns)] += np.einsum("km,kmi->ki", pull, jacobian)
        nx = x.shape[1]
        return CostGradient(slopes[:-1, :nx], slopes[:-1, nx:], slopes[-1, :nx])

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the other cost's second derivatives, and those of the price; see `Cost`."""
        return self._with_price(self.cost.hessian(x, u), x, u)

    def convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the other cost's, and those of the price, which are never negative; see `Cost`."""
        return self._with_price(self.cost.convex_hessian(x, u), x, u)

    def eased(self, ease: float) -> None:  # noqa: ARG002
        """Return None: what is near is not where a cheaper one would lead."""
        return

    def _with_price(self, other: CostHessian, x: Array, u: Array) -> CostHessian:
        Q, R, S, Q_final = other
        N, nx, nu = self._sizes
        bent = np.zeros((N + 1, nx + nu, nx + nu))
        bent[:-1, :nx, :nx], bent[:-1, nx:, nx:], bent[-1, :nx, :nx] = matrix_of(Q), matrix_of(R), matrix_of(Q_final)
        if S is not None:
            bent[:-1, :nx, nx:] = S
        for each in self._broken(x, u, 0):
            k = (each.off > 0.0).any(axis=1)
            if k.any():
                at = each.at
                at = Samples(at.k[k], at.x[k], at.u[k], at.x_next[k])
                part = each._replace(at=at, off=each.off[k])
                jacobian, columns = self._slopes(part)
                stiff = np.where(part.off > 0.0, part.weight, 0.0)[:, :, None] * jacobian
                bent[np.ix_(part.at.k, columns, columns)] += jacobian.transpose(0, 2, 1) @ stiff
        return CostHessian(bent[:-1, :nx, :nx], bent[:-1, nx:, nx:], bent[:-1, :nx, nx:], bent[-1, :nx, :nx])

    def _broken(self, x: Array, u: Array, start: int) -> Iterator[_Broken]:
        """Yield how far limits are off in states of instants from ``start`` on, with inputs of as many or one less."""
        for rows, weight in self._rows:
            quantity = rows.quantity
            count = len(x) if quantity.of_state else len(u)
            here = (rows.k >= start) & (rows.k < start + count)
            if here.any():
                k = rows.k[here]
                nothing = np.empty((len(k), 0))
                at = Samples(k, x[k - start], nothing if quantity.of_state else u[k - start], nothing)
                room = rows.sign * (quantity.values(at) - rows.bounds[here])
                yield _Broken(rows, weight, at, np.maximum(-room, 0.0))

    def _slopes(self, each: _Broken) -> tuple[Array, Instants]:
        """Return the derivatives of a quantity (n, m, c), and by which columns of state and input."""
        _, nx, nu = self._sizes
        quantity = each.rows.quantity
        columns = quantity.columns(nx, nu)
        if columns is None:
            columns = np.arange(nx if quantity.of_state else nx + nu)
        return quantity.jacobian(each.at), columns
