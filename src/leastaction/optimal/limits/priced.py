"""A price on what limits are broken by, in place of the limits.

Within limits the optimiser keeps barriers, which are steep where much has to change for a little room. A motion that
breaks limits by little is led back to them by a price more surely: half the square of how far each is off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import AddedCost, Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian, ModelHessian
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limits.charts import PlainEntries, charted
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.limits.rows import Rows, Weights
from leastaction.optimal.quantity import Entries, Instants, Samples, as_slice
from leastaction.optimal.space import StateSpace


class PricedLimit(NamedTuple):
    """A limit, and the weight of half the square of what it is broken by, in its own unit.

    Of quantities of the state, or of state and input; at the first instant nothing is asked of the state.
    """

    limit: Limit
    weight: float


class _Broken(NamedTuple):
    """Rows of a limit at the instants where some are broken, and by how much each is off there (n, m), or 0."""

    rows: Rows
    weight: float
    at: Samples
    off: Array


@public
class PricedLimits(AddedCost):
    """Another cost, and the price of limits that are broken. As fit for several threads as the other cost.

    Its second derivative is that of Gauss and Newton: without the curvature of what is limited.
    """

    can_be_eased = False  # a motion near the given one is asked for, and an easier cost leads elsewhere

    def __init__(self, cost: Cost, system: DiscreteSystem, priced: Sequence[PricedLimit]) -> None:
        super().__init__(cost, "limits", (system.N, system.nx, system.nu))
        self._ndx, space = system.ndx, system.charts()
        self._rows = tuple(
            (_priced(rows, each.limit, space), each.weight)
            for each in priced
            for rows in charted(each.limit.rows(system, 1), space)
        )
        columns = [self._columns_of(rows) for rows, _ in self._rows]
        self._columns = np.unique(np.concatenate([np.empty(0, dtype=np.intp), *columns]))

    def off(self, x: Array, u: Array) -> float:
        """Return by how much limits are off at most along a trajectory, each in its own unit."""
        return max((float(each.off.max(initial=0.0)) for each in self._broken(x, u, 0)), default=0.0)

    def stage_prices(self, x: Array, u: Array, start: int) -> Array:
        prices = np.zeros(len(u))
        for each in self._broken(x, u, start):
            np.add.at(prices, each.at.k - start, 0.5 * each.weight * np.sum(each.off**2, axis=1))
        return prices

    def final_price(self, x: Array) -> float:
        nothing, end = np.empty((0, self._sizes[2])), self._sizes[0]
        return sum(0.5 * each.weight * float(np.sum(each.off**2)) for each in self._broken(x[None, :], nothing, end))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        slopes = np.hstack([np.vstack([q, q_final]), np.vstack([r, np.zeros_like(r[:1])])])
        for each in self._broken(x, u, 0):
            jacobian, columns = self._slopes(each)
            pull = -each.weight * each.rows.sign * each.off
            slopes[each.at.k[:, None], columns] += (pull[:, None, :] @ jacobian)[:, 0]
        ndx = self._ndx
        return CostGradient(slopes[:-1, :ndx], slopes[:-1, ndx:], slopes[-1, :ndx])

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the other cost's second derivatives, and those of the price; see `Cost`."""
        return self.own_model_hessian(x, u, convex=False).whole()

    def own_model_hessian(self, x: Array, u: Array, *, convex: bool) -> ModelHessian:
        """Return either with what is by the entries that limits are of as a part of it; see `Cost`."""
        weights = Weights(self._sizes[0], self._columns)
        for each in self._broken(x, u, 0):
            jacobian, columns = self._slopes(each)
            weights.add(each.at.k, columns, jacobian, np.where(each.off > 0.0, each.weight, 0.0), None)
        return self.cost.model_hessian(x, u, convex=convex).weighed(self._columns, weights.matrices)

    def _broken(self, x: Array, u: Array, start: int) -> Iterator[_Broken]:
        """Yield where and how far limits are off in states from an instant on, with inputs of as many or one less."""
        for rows, weight in self._rows:
            quantity = rows.quantity
            count = len(x) if quantity.of_state else len(u)
            here = (rows.k >= start) & (rows.k < start + count)
            if here.any():
                k = rows.k[here]
                off = rows.sign * (rows.bounds[here] - quantity.values(self._samples(rows, k, x, u, start)))
                broken = (off > 0.0).any(axis=1)
                if broken.any():
                    at = self._samples(rows, k[broken], x, u, start)
                    yield _Broken(rows, weight, at, np.maximum(off[broken], 0.0))

    @staticmethod
    def _samples(rows: Rows, k: Instants, x: Array, u: Array, start: int) -> Samples:
        nothing, here = np.empty((len(k), 0)), as_slice(k - start)
        return Samples(k, x[here], nothing if rows.quantity.of_state else u[here], nothing)

    def _slopes(self, each: _Broken) -> tuple[Array, Instants]:
        """Return the derivatives of a quantity (n, m, c), and by which columns of state and input."""
        return each.rows.quantity.jacobian(each.at), self._columns_of(each.rows)

    def _columns_of(self, rows: Rows) -> Instants:
        ndx, nu = self._ndx, self._sizes[2]
        return rows.quantity.all_columns(ndx, nu)


def _priced(rows: Rows, limit: Limit, space: StateSpace | None) -> Rows:
    """Return rows that can have a price: of a state, or of a step without the state that it leads to."""
    quantity = rows.quantity
    if quantity.looks_ahead:
        raise ArgumentError(
            f"{limit}: {quantity.kind} {quantity.names[0]} depends on the state that a step leads to, and has no "
            "price; expected limits of states and inputs, or give it to `optimize`"
        )
    if space is not None and isinstance(quantity, Entries) and not quantity.of_state:
        return replace(rows, quantity=PlainEntries(quantity, space.ndx + quantity.places))
    return rows
