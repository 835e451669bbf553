"""A cost of a system's own states, over those of one that remembers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import is_diagonal
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian


class RememberedCost(Cost):
    """A cost of a system's own states: what is remembered costs nothing; as fit for several threads as that.

    ``sizes``: the numbers of entries of its state, of directions of that, and of those of what is remembered.
    ``nothing``: returns what is remembered (..., m) where nothing is known of before states (..., nx).
    """

    def __init__(self, cost: Cost, sizes: tuple[int, int, int], nothing: Callable[[Array], Array]) -> None:
        self.cost, self.nonnegative = cost, cost.nonnegative
        self.n_own, self.d_own, self.more = sizes
        self.nothing = nothing

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self.cost.stage_values(self._own(x), u, start)

    def final_value(self, x: Array) -> float:
        return self.cost.final_value(self._own(x))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(self._own(x), u)
        return CostGradient(self._behind(q), r, self._behind(q_final))

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return self._padded(self.cost.hessian(self._own(x), u))

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        return self._padded(self.cost.convex_hessian(self._own(x), u))

    @property
    def wanted_states(self) -> Array | None:
        wanted = self.cost.wanted_states
        return None if wanted is None else np.concatenate([wanted, self.nothing(wanted)], axis=-1)

    def eased(self, ease: float) -> tuple[Cost, Array] | None:
        found = self.cost.eased(ease)
        if found is None:
            return None
        other = object.__new__(RememberedCost)
        vars(other).update(vars(self), cost=found[0], nonnegative=found[0].nonnegative)
        return other, found[1]

    def _own(self, x: Array) -> Array:
        own = np.ascontiguousarray(x[..., : self.n_own])
        own.setflags(write=False)
        return own

    def _behind(self, rows: Array) -> Array:
        """Return rows with nothing for what is remembered."""
        return _behind(rows, self.more)

    def _padded(self, own: CostHessian) -> CostHessian:
        Q, R, S, Q_final = own
        if S is not None:
            S = np.swapaxes(self._behind(np.swapaxes(S, -1, -2)), -1, -2)
        return CostHessian(weight_with(Q, self.more), R, S, weight_with(Q_final, self.more))


def weight_with(weight: Array, more: int) -> Array:
    """Return a weight of states as one of so many more entries too, which have none."""
    if weight.ndim == 1:
        return _behind(weight, more)
    if is_diagonal(weight):
        return _behind(weight[:, :, 0], more)[:, :, None]
    return np.ascontiguousarray(np.swapaxes(_behind(np.swapaxes(_behind(weight, more), -1, -2), more), -1, -2))


def _behind(rows: Array, more: int) -> Array:
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], more))], axis=-1)
