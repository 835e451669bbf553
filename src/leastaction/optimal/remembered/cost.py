"""A cost of a system's own states, over those of one that remembers."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import is_diagonal
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.remembered.system import RememberingSystem


class RememberedCost(Cost):
    """A cost of a system's own states: what is remembered costs nothing; as fit for several threads as that."""

    def __init__(self, cost: Cost, system: RememberingSystem) -> None:
        self.cost, self.nonnegative = cost, cost.nonnegative
        self.n_own, self.d_own, self.more = system.n_own, system.d_own, len(system.needs)

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
        return None if wanted is None else self._behind(wanted)

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
        return np.concatenate([rows, np.zeros((*rows.shape[:-1], self.more))], axis=-1)

    def _padded(self, own: CostHessian) -> CostHessian:
        Q, R, S, Q_final = own
        if S is not None:
            S = np.swapaxes(self._behind(np.swapaxes(S, -1, -2)), -1, -2)
        return CostHessian(self.weight(Q), R, S, self.weight(Q_final))

    def weight(self, weight: Array) -> Array:
        """Return a weight of states as one of what is remembered too, which has none."""
        if weight.ndim == 1:
            return self._behind(weight)
        if is_diagonal(weight):
            return self._behind(weight[:, :, 0])[:, :, None]
        return np.ascontiguousarray(np.swapaxes(self._behind(np.swapaxes(self._behind(weight), -1, -2)), -1, -2))
