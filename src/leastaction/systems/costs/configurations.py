"""Prices of configurations beside any other cost: what they change of its derivatives."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection
from typing import Self

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import AddedCost, Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian, ModelHessian
from leastaction.systems.midpoint import MidpointSystem


class CostOfConfigurations(AddedCost):
    """Another cost and a price of configurations q, with exact second derivatives; as fit for several threads as that.

    Derivatives are by the nv directions in which configurations move: by all variables, where no rotation is a
    quaternion.

    ``what``: what has a price, in the plural, for messages. ``system``: whose configurations are meant. ``wanted``,
    ``weights``: names of what is wanted, and of what has a weight: some of these.
    """

    def __init__(
        self, cost: Cost, what: str, system: MidpointSystem, wanted: Collection[str] = (), weights: Collection[str] = ()
    ) -> None:
        for name in weights:
            if name not in wanted:
                known = closest(name, list(wanted), what=f"names of {what}")
                raise ArgumentError(f"weights: {name!r} has no {what.removesuffix('s')} that is wanted; {known}")
        super().__init__(cost, what, (system.N, system.nx, system.nu))
        self.system, self._nq, self._nv = system, system.mechanism.nq, system.mechanism.nv

    @abstractmethod
    def _prices(self, q: Array, start: int) -> Array:
        """Return the prices (n,) of configurations (n, nq) of instants from `start` on."""

    @abstractmethod
    def _slopes(self, q: Array) -> Array:
        """Return the derivatives (N+1, nv) of the prices along a whole motion."""

    @abstractmethod
    def _bends(self, q: Array, *, exact: bool) -> Array:
        """Return their second derivatives (N+1, nv, nv); or Gauss and Newton's, where they need not be ``exact``."""

    def stage_prices(self, x: Array, u: Array, start: int) -> Array:  # noqa: ARG002 - inputs have none
        return self._prices(self._configurations(x), start)

    def final_price(self, x: Array) -> float:
        return float(self._prices(self._configurations(x[None, :]), self._sizes[0])[0])

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        slopes = self._slopes(self._configurations(x))
        q, q_final = q.copy(), q_final.copy()
        q[:, : self._nv] += slopes[:-1]
        q_final[: self._nv] += slopes[-1]
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives: a matrix for each stage."""
        return self.own_model_hessian(x, u, convex=False).whole()

    def own_model_hessian(self, x: Array, u: Array, *, convex: bool) -> ModelHessian:
        """Return them with what is by configurations as a part; see `Cost`.

        ``convex``: Gauss and Newton's, as if what has a price were linear in the configuration.
        """
        bends = self._bends(self._configurations(x), exact=not convex)
        return self.cost.model_hessian(x, u, convex=convex).weighed(np.arange(self._nv), bends)

    def _over(self, start: int, stop: int, N: int, nu: int) -> Self:
        """Return the same of the steps ``start .. stop-1``, with what is wanted as it is over all steps."""
        system = self.system.window(start, stop)
        assert isinstance(system, MidpointSystem)
        other = self._beside(self.cost.window(start, stop, N=N, nu=nu), stop - start)
        other.system = system
        return other

    def _configurations(self, x: Array) -> Array:
        return np.ascontiguousarray(x[:, : self._nq])
