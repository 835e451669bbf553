"""Help that has a price: inputs beside those of a problem, which are to do nothing in the end."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_places, read_only, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.cost import diagonal_of, widened
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian


@public
class HelpedCost(Cost):
    """A cost and the price of further inputs: ``h(x, u) + 1/2 sum_k v_k' diag(price) v_k``.

    As fit for several threads as the cost is.

    Parameters
    ----------
    cost : Cost
        Of the inputs u.
    columns : ndarray of int (n,)
        Where the help v stands among all inputs.
    price : ndarray (n,)
        Price of each, positive.

    Raises
    ------
    ArgumentError
        For a price that is not positive.
    """

    def __init__(self, cost: Cost, columns: npt.NDArray[np.int64], price: Array) -> None:
        require_instance(cost, "cost", Cost)
        self.cost = cost
        self.columns = as_places(columns, "columns", "(n,): inputs").astype(np.int64)
        self.price = as_array(price, "price", (len(self.columns),), meaning="(n,): a price for each of the columns")
        if not np.all(self.price > 0.0):
            raise ArgumentError(f"price: got {self.price.min():g}, expected positive prices of the help")
        self.nonnegative = cost.nonnegative

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        self.cost.check_shapes(N, nx, nu - len(self.columns))

    def own(self, n: int) -> npt.NDArray[np.int64]:
        """Return where the problem's own inputs stand among all n."""
        return np.setdiff1d(np.arange(n), self.columns)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        spent: Array = 0.5 * (u[:, self.columns] ** 2 @ self.price)
        return self.cost.stage_values(x, self._without(u), start) + spent

    def final_value(self, x: Array) -> float:
        return self.cost.final_value(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r_own, q_final = self.cost.gradient(x, self._without(u))
        r = np.empty(u.shape)
        r[:, self.own(u.shape[1])] = r_own
        r[:, self.columns] = u[:, self.columns] * self.price
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        Q, R_own, S_own, Q_final = self.cost.hessian(x, self._without(u))

        def among_all(rows: Array) -> Array:
            whole = np.zeros((*rows.shape[:-1], u.shape[1]))
            whole[..., self.own(u.shape[1])] = rows
            return whole

        R = widened(R_own, among_all)
        diagonal_of(R)[..., self.columns] = self.price
        return CostHessian(Q, R, None if S_own is None else among_all(S_own), Q_final)

    def _without(self, u: Array) -> Array:
        return read_only(np.ascontiguousarray(u[:, self.own(u.shape[1])]))
