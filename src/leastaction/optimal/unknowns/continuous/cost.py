"""The cost of a motion in continuous time and of its unknowns, over the states of an extended system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.continuous.cost import ContinuousCost, RateGradient, RateHessian
from leastaction.optimal.continuous.final_term import FinalTerm
from leastaction.optimal.unknowns.continuous.system import ExtendedContinuousSystem
from leastaction.optimal.unknowns.unknown import FinalTime, Unknown


class ExtendedContinuousCost(ContinuousCost):
    """A cost of the system's own states over the true time, and prices of its unknowns, paid at the end.

    ``g l(x, u, s)`` at a time s of the horizon, with the pace g of `ExtendedContinuousSystem`: what is wanted over time
    is wanted at the same fractions of the motion. ``wanted`` (P,): values that cost nothing.
    """

    def __init__(
        self, cost: ContinuousCost, unknowns: Sequence[Unknown], wanted: Array, system: ExtendedContinuousSystem
    ) -> None:
        self.cost, self.system, self.jumps = cost, system, cost.jumps
        self.final_term = FinalTermWithUnknowns(cost, unknowns, wanted, system)
        # Only of a time it is known that it is no less than zero.
        safe = all(each.price == 0.0 or (each.price > 0.0 and isinstance(each, FinalTime)) for each in unknowns)
        self.nonnegative = cost.nonnegative and safe

    def check(self, t0: float, tf: float, nx: int, nu: int) -> None:  # noqa: ARG002 - those of the extended system
        self.cost.check(t0, tf, self.system.n_own, nu)

    # ---- Over time --------------------------------------------------------------------------------

    def rate(self, x: Array, u: Array, t: float) -> float:
        return self.system.pace(self.system.values(x)) * self.cost.rate(self.system.own(x), u, t)

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        return np.asarray(self._paces(x) * self.cost.rates(self.system.own(x), u, t))

    def gradient(self, x: Array, u: Array, t: Array) -> RateGradient:
        own, pace = self.system.own(x), self._paces(x)[:, None]
        q, r = self.cost.gradient(own, u, t)
        whole = pace * (q @ self.system.moves)
        time = self.system.final_time
        if time is not None:
            whole[:, time] = self.cost.rates(own, u, t) / self.system.lasts
        return RateGradient(whole, pace * r)

    def hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        own, time = self.system.own(x), self.system.final_time
        Q, R, S = self._over_time(x, self.cost.hessian(own, u, t))
        if time is None:
            return RateHessian(Q, R, S)
        q, r = self.cost.gradient(own, u, t)
        cross = q @ self.system.moves / self.system.lasts
        Q[:, time] += cross
        Q[:, :, time] += cross
        S = np.zeros((len(x), self.system.nx, u.shape[1])) if S is None else S
        S[:, time] += r / self.system.lasts
        return RateHessian(Q, R, S)

    def own_convex_hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        """Return the cost's own at the pace, and a curvature of the final time, by which it grows."""
        own, time = self.system.own(x), self.system.final_time
        Q, R, S = self._over_time(x, self.cost.convex_hessian(own, u, t))
        if time is not None:
            lasts = x[:, time] - self.system.t0
            Q[:, time, time] += np.abs(self.cost.rates(own, u, t)) / (self.system.lasts * lasts)
        return RateHessian(Q, R, S)

    def _paces(self, x: Array) -> Array:
        time = self.system.final_time
        return np.ones(len(x)) if time is None else np.asarray((x[:, time] - self.system.t0) / self.system.lasts)

    def _over_time(self, x: Array, own: RateHessian) -> RateHessian:
        """Return second derivatives by the system's own states as those by the extended ones, at the pace."""
        moves, pace = self.system.moves, self._paces(x)[:, None, None]
        S = None if own.S is None else pace * (moves.T @ own.S)
        return RateHessian(pace * (moves.T @ own.Q @ moves), pace * own.R, S)


class FinalTermWithUnknowns(FinalTerm):
    """The final term of a cost of the system's own states, and the prices of unknowns; see `ExtendedContinuousCost`."""

    def __init__(
        self, cost: ContinuousCost, unknowns: Sequence[Unknown], wanted: Array, system: ExtendedContinuousSystem
    ) -> None:
        self.cost, self.system, self.wanted = cost, system, wanted
        self.price = np.array([each.price for each in unknowns])
        self.weight = np.array([each.weight for each in unknowns])
        self.of_values = slice(system.n_own, system.layout.at_copies)

    def value(self, x: Array, t: float) -> float:
        values = x[self.of_values]
        prices = self.price @ values + 0.5 * self.weight @ (values - self.wanted) ** 2
        return self.cost.final_value(self.system.own(x), t) + float(prices)

    def gradient(self, x: Array, t: float) -> Array:
        whole: Array = self.cost.final_gradient(self.system.own(x), t) @ self.system.moves
        whole[self.of_values] += self.price + self.weight * (x[self.of_values] - self.wanted)
        return whole

    def hessian(self, x: Array, t: float) -> Array:
        return self._at_end(self.cost.final_hessian(self.system.own(x), t), self.weight)

    def convex_hessian(self, x: Array, t: float) -> Array:
        """Return the cost's own, and a curvature of the final time, whose price is linear, as in steps of time."""
        weight, time = self.weight.copy(), self.system.final_time
        if time is not None:
            j = time - self.system.n_own
            weight[j] += abs(self.price[j]) / (x[time] - self.system.t0)
        return self._at_end(self.cost.convex_final_hessian(self.system.own(x), t), weight)

    def _at_end(self, own: Array, weight: Array) -> Array:
        moves = self.system.moves
        whole = np.asarray(moves.T @ own @ moves)
        np.einsum("ii->i", whole)[self.of_values] += weight
        return whole
