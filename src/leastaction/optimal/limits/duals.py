"""Duals and prices of limits, and the stages of a barrier that falls: the same in discrete and in continuous time.

All is told by the values c of the limits where the iterate stands, one array (n, m) for each side, and knows nothing of
trajectories. A side that holds all along a horizon of continuous time has its barrier integrated: its weight is one by
the horizon's length, so that the parameter mu is in units of the cost for all sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.limit_report import Barrier, LimitReport, LimitState
from leastaction.optimal.limits.barrier import Split, barrier_value, first_duals, moved_duals, split, stiffness
from leastaction.optimal.quantity import Instants

__all__ = ["Duals", "Side", "Stages"]

_DEAR = 10.0  # times its dual is the price of an excess
_CHEAPER, _DEARER = 1e-3, 10.0  # by which prices change at most
_BINDING = 0.5  # of the price is the dual of a limit that the price does not enforce
_SETTLED = 2.3  # natural logarithm of the factor by which duals may be off those of the barrier in the end
_ACTIVE = 100.0  # times mu: dual times scale of a limit that is active

# The barrier's parameter: the first, in the cost by the number of rows; how it falls from one stage to the next.
_FIRST, _LESS, _POWER = 0.1, 0.1, 1.5
_FIRST_AGAIN = 1e-4  # where duals are known
_LAST = 0.1  # of the tolerated change of the cost is the barriers' part in the end
_LOOSE = 10.0  # times mu: the expected decrease with which a stage but the last is over
_LITTLE, _NOTHING = 1e-6, 1e-12  # a start that costs less than the first, and that part of doing nothing, costs nothing
_ROUGH = 1e-4  # a tolerance from which on duals need not be exact
_DEAREST = 1e6  # costs of the start for an excess of a limit's scale
# Of its scale a limit may be off where the problem cannot be met otherwise, and that part of a rough tolerance.
_MET, _MET_ROUGHLY = 1e-6, 1e-2


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a limit, as far as its duals go.

    ``limit``, ``labels``, ``equal``: as in a `LimitState`. ``first``: whether it is the first of the two sides of an
    equation, which follow each other. ``scale``, ``size`` (m,): what is large, 0 where that is to be seen from where
    the optimisation starts; and the largest bound. ``weight``: of its barrier.
    """

    limit: str
    labels: tuple[str, ...]
    equal: bool
    first: bool
    scale: Array
    size: Array
    weight: float = 1.0


class Duals:
    """The duals of limits, the prices of their excess, and the barrier's parameter."""

    def __init__(self, sides: Sequence[Side]) -> None:
        self.sides = tuple(sides)
        self.mu = np.nan
        self.scale: list[Array] = []
        self.rho: list[Array] = []
        self.y: list[Array] = []
        self.shapes: list[tuple[int, ...]] = []
        self.weights = self.prices = np.empty(0)  # of all rows, one after the other

    def begin(self, c: Sequence[Array], mu: float, price: float) -> None:
        """Choose scales, prices and duals from where the optimisation starts."""
        self.mu = mu
        for side, values in zip(self.sides, c, strict=True):
            seen = np.maximum(np.abs(values).max(axis=0), 1e-6 * (1.0 + side.size))
            self.scale.append(np.where(side.scale > 0.0, side.scale, seen))
        self.shapes = [values.shape for values in c]
        self.weights = _joined([np.full(values.shape, s.weight) for s, values in zip(self.sides, c, strict=True)])
        self.rho = [side.weight * price / scale for side, scale in zip(self.sides, self.scale, strict=True)]
        self.settle_prices()
        self.y = self._apart(first_duals(self._parameters() / self._split(c).slack, self.prices))

    def parameter(self, i: int) -> float:
        """Return the parameter of the barrier of side i."""
        return self.mu * self.sides[i].weight

    # Elementwise mathematics takes all sides at once: there may be many, and they may be short.

    def barrier(self, c: Sequence[Array]) -> float:
        """Return the sum of the barriers."""
        return barrier_value(_joined(c), self._parameters(), self.prices)

    def of_barrier(self, c: Sequence[Array]) -> list[Array]:
        """Return the duals of the barriers themselves, ``mu / s``."""
        return self._apart(self._parameters() / self._split(c).slack)

    def stiffnesses(self, c: Sequence[Array]) -> list[Array]:
        """Return ``-dy/dc`` of the primal-dual model."""
        return self._apart(stiffness(self._split(c), self.prices, _joined(self.y)))

    def moved(self, c: Sequence[Array], dc: Sequence[Array], c_new: Sequence[Array]) -> list[Array]:
        """Return the duals moved along their own direction, after a step along dc from c to c_new."""
        part, mu, rho, y = self._split(c), self._parameters(), self.prices, _joined(self.y)
        dy = mu / part.slack - y - stiffness(part, rho, y) * _joined(dc)
        return self._apart(moved_duals(y, dy, mu / self._split(c_new).slack, rho))

    def _split(self, c: Sequence[Array]) -> Split:
        return split(_joined(c), self._parameters(), self.prices)

    def _parameters(self) -> Array:
        return self.mu * self.weights

    def settle_prices(self) -> None:
        """Take the prices of all sides as they are now."""
        self.prices = _joined([np.broadcast_to(rho, shape) for rho, shape in zip(self.rho, self.shapes, strict=True)])

    def _apart(self, values: Array) -> list[Array]:
        ends = [0, *accumulate(math.prod(shape) for shape in self.shapes)]
        return [values[a:b].reshape(shape) for a, b, shape in zip(ends[:-1], ends[1:], self.shapes, strict=True)]

    def settled(self, duals: Sequence[Array], c: Sequence[Array]) -> list[Array]:
        """Return duals; where they have not come near those of the barrier, these."""
        return [
            np.where(np.abs(np.log(y / barrier)) < _SETTLED, y, barrier)
            for y, barrier in zip(duals, self.of_barrier(c), strict=True)
        ]

    def excess(self, c: Sequence[Array]) -> float:
        """Return the largest violation of a limit, relative to its scale."""
        parts = (float(np.max(-each / scale, initial=0.0)) for each, scale in zip(c, self.scale, strict=True))
        return max(parts, default=0.0)

    # ---- Prices ---------------------------------------------------------------------------------

    def net(self) -> list[Array]:
        """Return the duals, of both sides of an equation their difference."""
        net = list(self.y)
        for i, side in enumerate(self.sides):
            if side.equal and side.first:
                net[i], net[i + 1] = self.y[i] - self.y[i + 1], self.y[i + 1] - self.y[i]
        return net

    def hopeless(self) -> bool:
        """Whether some limit is not enforced though its price is the dearest there is."""
        return any(
            bool((np.max(np.abs(net), axis=0, initial=0.0) > _BINDING * rho).any())
            for net, rho in zip(self.net(), self.rho, strict=True)
        )

    def least_mu(self, digits: float) -> float:
        """Return the parameter below which the room that it leaves would be a part `digits` of a limit's size."""
        parts = (
            digits / side.weight * float(np.max(y * (scale + side.size), initial=0.0))
            for side, y, scale in zip(self.sides, self.y, self.scale, strict=True)
        )
        return max(parts, default=0.0)

    def price(self, c: Sequence[Array], dearest: float, *, met: float | None = None) -> bool:
        """Set the prices of excess by the duals; whether some limit needs a price that is higher.

        ``c``: at the minimum at these prices and this mu. ``dearest``: what an excess of a limit's scale may cost at
        most. ``met``: what is off by more of its scale needs a higher price, whatever its dual, a rough one perhaps.
        """
        unmet = False
        for i, (net, side) in enumerate(zip(self.net(), self.sides, strict=True)):
            rho, most = self.rho[i], side.weight * dearest / self.scale[i]
            binding = np.max(np.abs(net), axis=0, initial=0.0) > _BINDING * rho
            if met is not None:
                binding |= np.min(c[i], axis=0, initial=0.0) < -met * self.scale[i]
            binding &= rho < most
            new = np.where(
                binding,
                np.minimum(_DEARER * rho, most),
                # Equations are met the better the dearer they are.
                rho if side.equal else np.clip(_DEAR * np.max(net, axis=0), _CHEAPER * rho, rho),
            )
            unmet = unmet or bool(binding.any())
            self.rho[i] = new
            if side.equal:
                self.y[i] = 0.5 * (new + np.clip(net, -0.9 * new, 0.9 * new))
            else:
                lower = np.minimum(self.y[i], 0.9 * new)
                self.y[i] = np.where(binding & (c[i] < 0.0), first_duals(lower, new), lower)
        self.settle_prices()
        return unmet

    # ---- Reports --------------------------------------------------------------------------------

    def takes(self, report: LimitReport | None) -> bool:
        """Whether a report is of the same limits at the same instants."""
        shapes = [
            (s.labels, y.shape) for s, y in zip(self.sides, self.y, strict=True) if s.first or not s.equal
        ]  # fmt: skip
        return report is not None and report.sides_shaped() == shapes

    def take(self, report: LimitReport) -> None:
        """Begin with the duals and prices of an earlier optimisation with the same limits."""
        sides = iter(report.sides)
        for i, own in enumerate(self.sides):
            if own.equal and not own.first:
                self.rho[i] = self.rho[i - 1]
                self.y[i] = self.rho[i] - self.y[i - 1]
                continue
            side = next(sides)
            self.rho[i] = side.price.copy()
            if own.equal:
                self.y[i] = 0.5 * (side.price + np.clip(side.dual, -0.9 * side.price, 0.9 * side.price))
            else:
                self.y[i] = np.clip(side.dual, 1e-12 * side.price, 0.9 * side.price)
        self.settle_prices()

    def restore(self, mu: float, barrier: Barrier) -> None:
        """Go on exactly where an optimisation with the same limits was."""
        self.mu, self.y = mu, self._apart(barrier.duals.copy())
        ends = np.cumsum([len(scale) for scale in self.scale])[:-1]
        self.scale, self.rho = np.split(barrier.scale.copy(), ends), np.split(barrier.prices.copy(), ends)
        self.settle_prices()

    def states(self, k: Sequence[Instants], c: Sequence[Array], duals: Sequence[Array]) -> tuple[LimitState, ...]:
        """Return what is told of the limits, given their instants, values and duals."""
        sides = []
        for i, own in enumerate(self.sides):
            if own.equal and not own.first:
                continue
            dual = duals[i]
            active = np.full(dual.shape, own.equal)
            if own.equal:
                dual = dual - duals[i + 1]
            else:
                active |= dual * self.scale[i] > _ACTIVE * self.parameter(i)
            at = k[i].astype(np.int64)
            for array in (at, c[i], dual, active):
                array.setflags(write=False)
            price = read_only(self.rho[i].copy())
            sides.append(LimitState(own.limit, own.labels, own.equal, at, c[i], dual, price, active))
        return tuple(sides)


def _joined(values: Sequence[Array]) -> Array:
    return np.concatenate([np.empty(0), *(each.ravel() for each in values)])


class Stages:
    """The stages of an optimisation with limits: one barrier problem after the other.

    ``tolerance``: of the optimisation. ``count``: number of rows over the horizon, in units of the barrier's weight.
    ``digits``: of a limit's size is the least room that is told from none.
    """

    def __init__(self, duals: Duals, tolerance: float, count: int, digits: float) -> None:
        self.duals, self.tolerance, self.count, self.digits = duals, tolerance, count, digits
        self.size = self.first_mu = self.last = np.nan

    def begin(self, value: float, c: Sequence[Array], otherwise: Callable[[], float]) -> None:
        """Begin at a trajectory, given its cost and the values of its limits.

        ``otherwise``: gives the cost of doing nothing. Beside that the cost of a start which is all that is wanted is a
        matter of rounding: prices in proportion to it would enforce no limit.
        """
        self.size = abs(value)
        if self.size < _LITTLE:
            idle = abs(otherwise())
            if self.size <= _NOTHING * idle or self.size == 0.0:
                self.size = idle if 0.0 < idle < np.inf else 1.0
        self.first_mu = _FIRST * self.size / max(self.count, 1)
        self.last = self._last(self.size)
        self.duals.begin(c, self.first_mu, self.size)

    def take(self, given: LimitReport | None, *, resumed: bool) -> None:
        """Go on with the duals of an earlier run, if it had these limits.

        Raises
        ------
        ArgumentError
            If it is resumed and had others.
        """
        duals = self.duals
        if given is None:
            return
        if duals.takes(given):
            barrier = given.barrier
            if resumed and barrier is not None:
                self.size, self.first_mu = barrier.size, barrier.first_mu
                # Another tolerance than before has another end.
                self.last = barrier.last_mu if self.tolerance == barrier.tolerance else self._last(self.size)
                duals.restore(given.mu, barrier)
                return
            duals.mu = max(_FIRST_AGAIN * self.first_mu, self.last)
            duals.take(given)
        elif resumed:
            raise ArgumentError(
                f"resume: got a result with the limits {', '.join(given.labels[:4])} ..., expected those of this "
                "call. Give initial=result to start from its trajectory with others"
            )

    def report(self, k: Sequence[Instants], c: Sequence[Array], duals: Sequence[Array]) -> LimitReport:
        """Return what is told of the limits, given their instants, values and duals."""
        own = self.duals
        arrays = [read_only(_joined(each)) for each in (own.y, own.scale, own.rho)]
        barrier = Barrier(self.size, self.tolerance, self.first_mu, self.last, *arrays)
        return LimitReport(own.states(k, c, duals), own.mu, own.excess(c), barrier)

    @property
    def _rough(self) -> bool:
        """Whether few digits are asked for."""
        return self.tolerance >= _ROUGH

    @property
    def met(self) -> float:
        """Of its scale a limit may be off."""
        return max(_MET, _MET_ROUGHLY * self.tolerance)

    @property
    def is_last(self) -> bool:
        """Whether the barrier does not get smaller any more, or there is none."""
        return not self.duals.sides or self.duals.mu <= self.last

    def tolerated(self, goal: float, noise: float) -> float:
        """Return the expected decrease that is small enough at this stage."""
        mu = self.duals.mu
        if mu > self.last:
            return max(goal, _LOOSE * mu)
        if self._rough:
            return max(goal, 10.0 * noise)
        # The duals are worth no more than the motion is near the barrier's minimum.
        return max(min(goal, _LOOSE * mu), 10.0 * noise)

    def advance(self, cost: float, c: Sequence[Array]) -> bool:
        """Go on with dearer excess, where a limit needs it, or else with a smaller barrier; whether there is more."""
        duals = self.duals
        was_last = self.is_last
        # The cost of the start may be far from that of the end.
        self.last = max(self._last(abs(cost)), duals.least_mu(self.digits))
        dearer = duals.price(c, _DEAREST * self.size, met=self.met if self._rough else None)
        if not dearer and (was_last or duals.hopeless()):
            return False
        # Who asks for few digits need not see what a price comes to before the next barrier.
        if not dearer or (self._rough and not was_last):
            unit = self.first_mu / _FIRST
            part = duals.mu / unit
            duals.mu = min(duals.mu, max(self.last, unit * min(_LESS * part, part**_POWER)))
        return True

    def are_met(self, c: Sequence[Array]) -> bool:
        """Whether all limits are met, as well as can be asked."""
        return self.duals.excess(c) <= self.met

    def _last(self, cost: float) -> float:
        """Return the parameter of a barrier that matters no more at a cost."""
        return _LAST * self.tolerance * max(cost, 1e-9 * self.size) / max(self.count, 1)
