"""Prices of configurations beside any other cost: what they change of its derivatives."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import matrix_of, own_matrices
from leastaction.optimal.discrete.cost import AddedCost, Cost, CostGradient, CostHessian
from leastaction.systems.midpoint import MidpointSystem


class CostOfConfigurations(AddedCost):
    """Another cost and a price of configurations q, with exact second derivatives; as fit for several threads as that.

    ``what``: what has a price, in the plural, for messages. ``system``: whose configurations are meant.
    """

    def __init__(self, cost: Cost, what: str, system: MidpointSystem) -> None:
        super().__init__(cost, what, (system.N, system.nx, system.nu))
        self._nq = system.mechanism.nq

    @abstractmethod
    def _prices(self, q: Array, start: int) -> Array:
        """Return the prices (n,) of configurations (n, nq) of instants from `start` on."""

    @abstractmethod
    def _slopes(self, q: Array) -> Array:
        """Return the derivatives (N+1, nq) of the prices along a whole motion."""

    @abstractmethod
    def _bends(self, q: Array, *, exact: bool) -> Array:
        """Return their second derivatives (N+1, nq, nq); or Gauss and Newton's, where they need not be ``exact``."""

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return np.asarray(self.cost.stage_values(x, u, start) + self._prices(self._configurations(x), start))

    def final_value(self, x: Array) -> float:
        N = self._sizes[0]
        return super().final_value(x) + float(self._prices(self._configurations(x[None, :]), N)[0])

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        slopes = self._slopes(self._configurations(x))
        q, q_final = q.copy(), q_final.copy()
        q[:, : self._nq] += slopes[:-1]
        q_final[: self._nq] += slopes[-1]
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives: a matrix for each stage."""
        return self._bent(self.cost.hessian(x, u), x, exact=True)

    def convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return those of Gauss and Newton, as if what has a price were linear in the configuration; see `Cost`."""
        return self._bent(self.cost.convex_hessian(x, u), x, exact=False)

    def _configurations(self, x: Array) -> Array:
        return np.ascontiguousarray(x[:, : self._nq])

    def _bent(self, other: CostHessian, x: Array, *, exact: bool) -> CostHessian:
        """Return second derivatives of the other cost with those of the price."""
        Q, R, S, Q_final = other
        n, nx = self._nq, x.shape[1]
        bends = self._bends(self._configurations(x), exact=exact)
        stages = own_matrices(matrix_of(Q), (len(bends) - 1, nx, nx))
        stages[:, :n, :n] += bends[:-1]
        last = np.array(matrix_of(Q_final))
        last[:n, :n] += bends[-1]
        return CostHessian(stages, R, S, last)
