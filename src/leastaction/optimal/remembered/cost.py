"""A cost of a system's own states, over those of one that remembers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.cost import across, widened
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian

Rows = Callable[[Array], Array]


class RememberedCost(Cost):
    """A cost of a system's own states: what is remembered costs nothing; as fit for several threads as that.

    ``own``: returns the system's own states. ``behind``: returns rows (..., ndx) with nothing for what is remembered.
    ``nothing``: returns what is remembered (..., m) where nothing is known of before states (..., nx).
    """

    def __init__(self, cost: Cost, own: Rows, behind: Rows, nothing: Rows) -> None:
        self.cost, self.nonnegative = cost, cost.nonnegative
        self.own, self.behind, self.nothing = own, behind, nothing

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self.cost.stage_values(read_only(self.own(x)), u, start)

    def final_value(self, x: Array) -> float:
        return self.cost.final_value(read_only(self.own(x)))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(read_only(self.own(x)), u)
        return CostGradient(self.behind(q), r, self.behind(q_final))

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return self._padded(self.cost.hessian(read_only(self.own(x)), u))

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        return self._padded(self.cost.convex_hessian(read_only(self.own(x)), u))

    @property
    def wanted_states(self) -> Array | None:
        wanted = self.cost.wanted_states
        return None if wanted is None else np.concatenate([wanted, self.nothing(wanted)], axis=-1)

    def eased(self, ease: float) -> tuple[Cost, Array] | None:
        found = self.cost.eased(ease)
        if found is None:
            return None
        return RememberedCost(found[0], self.own, self.behind, self.nothing), found[1]

    def _padded(self, own: CostHessian) -> CostHessian:
        Q, R, S, Q_final = own
        S = None if S is None else across(S, self.behind)
        return CostHessian(widened(Q, self.behind), R, S, widened(Q_final, self.behind))
