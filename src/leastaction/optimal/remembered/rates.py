"""A price on how fast inputs change, beside any other cost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.numerics.arrays import Array, as_array, as_number, read_only, require_instance, require_mapping
from leastaction.numerics.names import matching
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import AddedCost, Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian, HessianPart, ModelHessian, Places
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.looking_back import lasting

_ALONE = "its second derivatives need the step before, which is no part of the state: give it to `optimize` or `MPC`"


@public
class RateCost(AddedCost):
    """Another cost and half the weighted squares of the rates at which inputs change.

    The rate at step k is ``2 (u_k - u_{k-1}) / (t_{k+1} - t_{k-1})``, from the middle of one step to that of the next.
    `optimize` and `MPC` make ``u_{k-1}`` a part of the state. As fit for several threads as the other cost.

    Parameters
    ----------
    cost : Cost
        Such as a `QuadraticCost`.
    system : DiscreteSystem
        Whose inputs are meant.
    rates : mapping of str to float
        Weights by the names of inputs or patterns of them, in units of the cost by (N/s)^2, (N m/s)^2, ...; none for
        the others.
    before : array_like (nu,), optional
        What was applied before the first step: its rate costs as well. Nothing is known of that if left out; an `MPC`
        knows what it gave.

    Raises
    ------
    ArgumentError
        For a name that no input has, a weight that is negative or not finite, or a wrong shape.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import JointForce, Mechanism, MidpointSystem, MidpointVI, QuadraticCost, optimize, tx
    >>> from leastaction.costs import RateCost
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 1.0, 21))
    >>> cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[10.0, 1.0], R=[0.01])
    >>> gentle, start = RateCost(cost, system, {"push": 1e-3}, before=[0.0]), ([1.0, 0.0], np.zeros((20, 1)))
    >>> [float(abs(np.diff(optimize(system, each, initial=start).u[:, 0])).max().round(1)) for each in (cost, gentle)]
    [7.0, 1.5]
    """

    def __init__(
        self, cost: Cost, system: DiscreteSystem, rates: Mapping[str, float], *, before: ArrayLike | None = None
    ) -> None:
        require_instance(cost, "cost", Cost, "such as a QuadraticCost")
        require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
        require_mapping(rates, "rates", "{'push': 1e-3}")
        super().__init__(cost, "rates of inputs", (system.N, system.nx, system.nu))
        quantity: Any = system.quantity("input rate")
        weights = np.zeros(len(quantity.names))
        for name, value in rates.items():
            found = matching(quantity.names, name)
            if not found:
                raise unknown("input", name, quantity.names, "rates")
            weights[found] = as_number(value, f"rates[{name!r}]", least=0.0)
        priced = np.flatnonzero(weights)
        self.places: Places = quantity.places[priced]
        self.weights, self.lasts = read_only(weights[priced]), read_only(lasting(system.times))
        if before is not None:
            self.before = read_only(as_array(before, "before", (system.nu,), names=system.input_names).copy())
        own = {("input", int(i)) for i in self.places}
        self.needs = tuple(sorted(own.union(self.cost.needs)))

    def stage_prices(self, x: Array, u: Array, start: int) -> Array:  # noqa: ARG002 - states have none
        """Return the prices of the stages from the first on; see `AddedCost`."""
        if start:
            raise ArgumentError(f"RateCost: {_ALONE}")
        return np.asarray(0.5 * self._rates(u) ** 2 @ self.weights)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        pull, r = self.weights * self._rates(u) / self.lasts[:, None], r.copy()
        r[:, self.places] += pull
        r[:-1, self.places] -= pull[1:]
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:  # noqa: ARG002
        """Raise an error: stages are bound to each other by what is no part of the state."""
        raise ArgumentError(f"RateCost: {_ALONE}")

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        other = self._beside(self.cost.window(start, stop, N=N, nu=nu), stop - start)
        other.lasts = self.lasts[start:stop]
        other.before = self.before if start == 0 else None
        return other

    def own_remembering(self, system: Any) -> Cost:
        """Return the price by inputs and what is remembered of them."""
        memory = np.array([system.needs.index(("input", int(i))) for i in self.places], dtype=np.intp)
        sizes = system.N, system.nx, system.nu
        return _RecalledRates(
            system.cost_of(self.cost), sizes, self.weights, self.lasts, (self.places, system.n_own + memory),
            first=system.before is not None, moves=(system.d_own + memory, system.ndx),
        )  # fmt: skip

    def _rates(self, u: Array) -> Array:
        """Return the rates (N, m), zero at the first step where nothing is known of before."""
        first = u[:1] if self.before is None else self.before[None]
        return np.asarray(np.diff(np.concatenate([first, u])[:, self.places], axis=0) / self.lasts[:, None])


class _RecalledRates(AddedCost):
    """The same of states that hold what was applied in the step before; as fit for several threads as the other cost.

    ``at``: places of the inputs, and of what is remembered of them in the state. ``first``: whether that is known at
    the first step. ``moves``: where what is remembered is among the directions of a state, and their number.
    """

    def __init__(
        self,
        cost: Cost,
        sizes: tuple[int, int, int],
        weights: Array,
        lasts: Array,
        at: tuple[Places, Places],
        *,
        first: bool,
        moves: tuple[Places, int],
    ) -> None:
        super().__init__(cost, "rates of inputs", sizes)
        self.inputs, self.memory = at
        self.moves, self.ndx = moves
        prices = weights / lasts[:, None] ** 2
        prices[0] *= first
        self.prices = read_only(prices)

    def stage_prices(self, x: Array, u: Array, start: int) -> Array:
        squares = self._changes(x, u) ** 2 * self.prices[start : start + len(u)]
        return np.asarray(0.5 * squares.sum(axis=1))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        q, r, pull = q.copy(), r.copy(), self.prices * self._changes(x[:-1], u)
        q[:, self.moves] -= pull
        r[:, self.inputs] += pull
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return self.own_model_hessian(x, u, convex=False).whole()

    def own_model_hessian(self, x: Array, u: Array, *, convex: bool) -> ModelHessian:
        """Return the other cost's with that of the price, which is convex, as a part of it; see `Cost`."""
        own = self.cost.model_hessian(x, u, convex=convex)
        columns = np.concatenate([self.moves, self.ndx + self.inputs])
        each = self.prices[:, :, None] * np.eye(len(self.inputs))
        part = np.block([[each, -each], [-each, each]])
        return own.plus(HessianPart(columns, part)) if len(columns) else own

    def _changes(self, x: Array, u: Array) -> Array:
        return np.asarray(u[:, self.inputs] - x[:, self.memory])
