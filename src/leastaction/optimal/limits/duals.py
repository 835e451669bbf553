"""Duals and prices of limits: the same in discrete and in continuous time.

All is told by the values c of the limits where the iterate stands, one array (n, m) for each side, and knows nothing of
trajectories.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np

from leastaction import _core
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import made
from leastaction.numerics.pool import copied, empty
from leastaction.optimal.limit_report import Barrier, LimitReport, LimitState
from leastaction.optimal.limits.barrier import first_duals
from leastaction.optimal.limits.leeway import Leeway
from leastaction.optimal.limits.sides import Sided, SideLayout
from leastaction.optimal.quantity import Instants

# Price of an excess, in times its multiplier; and in the end that of an equation, which is met the better the dearer it
# is, but what is much dearer leaves so little room that its barrier cannot get as small as others.
_DEAR, _DEAR_EQUAL = 10.0, 100.0
_HARD = 1e6  # price of an excess of its scale where nothing is beyond a limit, in costs of the start
_AT = 1e-6  # distance, in its scale, of what is at a limit
# Multiplier times scale of a limit that is active, in times mu: the least; it is more than the geometric mean of mu and
# the cost, too. The scale may be what was seen at a start far away, so that tells whether a limit is active anywhere;
# and the part of its largest multiplier, where.
_ACTIVE, _HARDLY = 100.0, 1e-5
_CENTRAL = 20.0  # largest product of multiplier and slack, in times mu, from which a much smaller barrier can follow
_GUIDING = 0.1  # barriers at first, in parts of what excess costs, where all is as dear


@dataclass(frozen=True, eq=False)
class LimitSide:
    """One side of a limit, as far as its duals go.

    ``limit``, ``labels``, ``equal``: as in a `LimitState`. ``first``: whether it is the first of the two sides of an
    equation, which follow each other. ``scale``, ``size`` (m,): what is large, 0 where that is to be seen from where
    the optimisation starts; and the largest bound. ``hard``: whether nothing is beyond it: the price of an excess only
    says how close to it a search may come, and is out of reach. ``worth`` (m,): what a unit of it costs; None: unknown.
    """

    limit: str
    labels: tuple[str, ...]
    equal: bool
    first: bool
    scale: Array
    size: Array
    hard: bool = False
    worth: Array | None = None


class Room(NamedTuple):
    """The values ``c`` of all sides somewhere, and ``at``, how they are split there into slack and excess.

    It is that of a parameter of the barrier and of prices.
    """

    c: Sided
    at: _core.Room


class Duals:
    """The duals of limits, the prices of their excess, and the barrier's parameter.

    ``sides``: of each, what it is. ``layout``: of their values over the horizon.
    """

    def __init__(self, sides: Sequence[LimitSide], layout: SideLayout) -> None:
        self.sides, self.layout = tuple(sides), layout
        self.mu = np.nan
        # One for each column of every side.
        self.scale, self.rho = layout.columns.empty(), layout.columns.empty()
        self.y = layout.empty()
        columns, sides = layout.columns, self.sides
        self._size = columns.filled([side.size for side in sides]).flat
        self._known = columns.filled([side.scale for side in sides]).flat
        self._equal = columns.filled([float(side.equal) for side in sides]).flat > 0.0
        self._hard = columns.filled([float(side.hard) for side in sides]).flat > 0.0
        # Of equations and of what is asked at a single instant.
        alone = [float(side.equal or shape[0] == 1) for side, shape in zip(sides, layout.shapes, strict=True)]
        self._alone = columns.filled(alone).flat > 0.0
        self._dear = np.where(self._equal, _DEAR_EQUAL, _DEAR)
        self._in_equations = layout.spread(self._equal)
        self._all_known = bool((self._known > 0.0).all())
        # Beyond the bound of what has a price itself, a cheaper excess would be worth while without end.
        worth = columns.filled([0.0 if side.worth is None else side.worth for side in sides]).flat
        self._least, self._has_least = _DEAR * worth, bool(worth.any())
        self._has_equations, self._has_hard = bool(self._equal.any()), bool(self._hard.any())
        self._other = self._other_sides()
        self.prices, self.scales = np.empty(0), np.empty(0)  # of all entries
        self.dearest, self.cheapest = 0.0, np.inf  # prices of an excess of a limit's scale
        self.leeway = Leeway([side.size.size for side in self.sides])

    def begin(self, c: Sided, mu: float, price: float, dearer: float = 1.0, depths: Array | float = np.inf) -> None:
        """Choose scales, prices and duals from where the optimisation starts.

        ``price``: of an excess of a limit's scale; of equations, and of limits at a single instant, times ``dearer``.
        ``depths``: of all columns, what an excess of it may be at most, which is large for it then.
        """
        self.mu, columns = mu, self.layout.columns
        scale = self._known
        if not self._all_known:
            seen = np.minimum(self.layout.largest(np.abs(c.flat, out=empty(c.flat.shape))), depths)
            seen = np.maximum(seen, 1e-6 * (1.0 + self._size))
            scale = np.where(self._known > 0.0, self._known, seen)
        self.scale = Sided(scale, columns)
        prices: Array | float = price if dearer == 1.0 else price * np.where(self._alone, dearer, 1.0)
        if self._has_hard:
            # Who begins at such a limit is not to be thrown off it.
            inside = self.layout.largest(_AT * self.layout.spread(self.scale.flat) - c.flat) == 0.0
            prices = np.where(self._hard & inside, _HARD * price, prices)
        self.rho = Sided(np.maximum(prices / self.scale.flat, self._least), columns)
        self.settle_prices()
        self._begin_duals(c)

    def _begin_duals(self, c: Sided) -> None:
        """Begin with the duals of the barriers at the values c."""
        self.y = Sided(first_duals(self.of_barrier(self.room(c)).flat, self.prices), self.layout)

    def room(self, c: Sided) -> Room:
        """Return slack and excess of values of all sides."""
        return Room(c, _core.Room(c.flat, self.mu, self.prices))

    def of_barrier(self, room: Room) -> Sided:
        """Return the duals of the barriers themselves, ``mu / s``."""
        found = self.layout.empty()
        room.at.duals(found.flat)
        return found

    def stiffnesses(self, room: Room, most: float = np.inf) -> Sided:
        """Return ``-dy/dc`` of the primal-dual model, at most so much of the largest that may be, ``rho^2 / mu``."""
        sigma = self.layout.empty()
        room.at.stiffness(self.y.flat, sigma.flat)
        return sigma if most == np.inf else Sided(np.minimum(sigma.flat, most / self.mu * self.prices**2), self.layout)

    def moved(self, room: Room, dc: Sided, after: Room) -> Sided:
        """Return the duals moved along their own direction, after a step along dc from one place to another.

        They stay inside of (0, rho), and not too far from those of the barrier.
        """
        moved = self.layout.empty()
        room.at.move_duals(self.y.flat, dc.flat, after.at, moved.flat)
        return moved

    def step(self, room: Room, dc: Sided, fall: float, least: float, length: float) -> float:
        """Return where along a direction the model is least that has the barriers themselves in place of their models.

        To a tenth. ``dc``: change of the values along it. ``fall``, ``least``: slope of cost and barriers, and their
        model's change at its end. ``length``: where to look no further.
        """
        return room.at.step(self.y.flat, dc.flat, fall, least, length)

    def kept_near(self, y: Array, after: Room) -> Sided:
        """Return duals that are not too far from those of the barrier."""
        kept = self.layout.empty()
        after.at.keep_duals(y, kept.flat)
        return kept

    def settle_prices(self) -> None:
        """Take the prices and scales of all sides as they are now."""
        self.prices, self.scales = self.layout.spread(self.rho.flat), self.layout.spread(self.scale.flat)
        prices = self.rho.flat * self.scale.flat
        each: list[float] = (prices[~self._hard] if self._has_hard else prices).tolist()
        self.dearest, self.cheapest = max(each, default=0.0), min(each, default=np.inf)

    def are_central(self, room: Room) -> bool:
        """Whether none times its slack, or what its price has left times its excess, is much more than the barrier's.

        From there a much smaller barrier can be followed.
        """
        return room.at.off_center(self.y.flat) <= _CENTRAL * self.mu

    def gap(self, room: Room) -> float:
        """Return what duals times room come to where that is more than the barriers ask for; not of equations.

        By so much the cost may still fall, whatever is said by the Lagrangian of these duals alone.
        """
        products = (self.y.flat * room.at.slack)[~self._in_equations]
        return float(products[products > _CENTRAL * self.mu].sum())

    def settled(self, duals: Sided, room: Room) -> Sided:
        """Return duals; where they have not come near those of the barrier, these."""
        settled = self.layout.empty()
        room.at.settle_duals(duals.flat, settled.flat)
        return settled

    def excess(self, c: Sided) -> float:
        """Return the largest violation of a limit, relative to its scale."""
        parts: Array = np.divide(c.flat, self.scales, out=empty(c.flat.shape))
        return -min(float(parts[parts.argmin()]), 0.0) if parts.size else 0.0

    def cost_of_excess(self, c: Sided) -> float:
        """Return what the violations of all limits cost at their prices."""
        return -float(np.minimum(c.flat, 0.0, out=empty(c.flat.shape)) @ self.prices)

    # ---- Prices ---------------------------------------------------------------------------------

    @property
    def is_level(self) -> bool:
        """Whether an excess of its scale is as dear for each limit."""
        return self.cheapest >= (1.0 - 1e-9) * self.dearest

    def level(self, c: Sided, price: float) -> None:
        """Make an excess of its scale as dear for each limit, and begin with the duals of the barriers."""
        self.rho = Sided(np.where(self._hard, self.rho.flat, price / self.scale.flat), self.layout.columns)
        self.settle_prices()
        self.mu = _GUIDING * self.cost_of_excess(c) / len(c.flat)
        self._begin_duals(c)

    def _other_sides(self) -> Instants:
        """Return where the other side is of every entry of an equation; of others, where they are themselves."""
        other = np.arange(self.layout.ends[-1])
        for i, side in enumerate(self.sides):
            if side.equal and side.first:
                first, second, end = self.layout.ends[i : i + 3]
                other[first:end] = np.concatenate([np.arange(second, end), np.arange(first, second)])
        return other

    def net(self, y: Array) -> Array:
        """Return duals of all entries, of both sides of an equation their difference."""
        return np.where(self._in_equations, y - y[self._other], y) if self._has_equations else y

    def hopeless(self) -> bool:
        """Whether some limit is not enforced though its price is the dearest there is."""
        return _core.some_unenforced(self._other, self.y.flat, self.prices)

    def least_mu(self, digits: float) -> float:
        """Return the parameter below which the room that it leaves would be a part `digits` of a limit's size."""
        return digits * _core.largest_product(self.layout.column, self.y.flat, self.scale.flat + self._size)

    def price(self, c: Sided, dearest: float, *, met: float | None = None, kept: float = np.inf) -> bool:
        """Set the prices of excess by the duals; whether some limit needs a price that is higher.

        ``c``: at the minimum at these prices and this mu. ``dearest``: what an excess of a limit's scale may cost at
        most. ``met``: what is off by more of its scale needs a higher price, whatever its dual, a rough one perhaps.
        ``kept``: what an excess of an equation's scale goes on to cost, if it did, however small the dual.
        """
        layout, off = self.layout, np.nan if met is None else met
        rho, y, self.prices = self.rho.flat.copy(), copied(self.y.flat), empty(self.prices.shape)
        dearer, self.dearest, self.cheapest = _core.price_limits(
            layout.column, self._other, self._equal, self._hard, self._dear, self.scale.flat, dearest, off, kept,
            c.flat, rho, y, self.prices,
        )  # fmt: skip
        self.rho, self.y = Sided(rho, layout.columns), Sided(y, layout)
        if self._has_least:
            np.maximum(rho, self._least, out=rho)
            self.settle_prices()
        return dearer

    # ---- Reports --------------------------------------------------------------------------------

    def takes(self, report: LimitReport | None) -> bool:
        """Whether a report is of the same limits at the same instants."""
        shapes = [
            (s.labels, y.shape) for s, y in zip(self.sides, self.y, strict=True) if s.first or not s.equal
        ]  # fmt: skip
        return report is not None and report.sides_shaped() == shapes

    def take(self, report: LimitReport) -> None:
        """Begin with the duals and prices of an earlier optimisation with the same limits.

        What was not active then may be now. So no price is less than is kept of one while there is room of its scale.
        """
        sides = iter(report.sides)
        for i, own in enumerate(self.sides):
            if own.equal and not own.first:
                self.rho[i] = self.rho[i - 1]
                self.y[i] = self.rho[i] - self.y[i - 1]
                continue
            side = next(sides)
            self.rho[i] = price = np.maximum(side.price, np.minimum(self.rho[i], _DEAR * self.mu / self.scale[i]))
            if own.equal:
                self.y[i] = 0.5 * (price + np.clip(side.dual, -0.9 * price, 0.9 * price))
            else:
                self.y[i] = np.clip(side.dual, 1e-12 * price, 0.9 * price)
        self.settle_prices()

    def restore(self, mu: float, barrier: Barrier) -> None:
        """Go on exactly where an optimisation with the same limits was."""
        self.mu, self.y = mu, Sided(barrier.duals.copy(), self.layout)
        columns = self.layout.columns
        self.scale, self.rho = Sided(barrier.scale.copy(), columns), Sided(barrier.prices.copy(), columns)
        if barrier.part > 0.0:
            self.leeway.restore(list(Sided(barrier.leeway.copy(), columns)), barrier.part)
        else:
            self.leeway.give_all_back()
        self.settle_prices()

    def states(
        self, k: Sequence[Instants], c: Sided, duals: Sided, price: Array, cost: float
    ) -> tuple[LimitState, ...]:
        """Return what is told of the limits, given their instants, values, duals and prices, and the cost.

        Nobody else writes to these: what is told outlives the run, and is saved.
        """
        least, layout, y = max(_ACTIVE * self.mu, sqrt(self.mu * abs(cost))), self.layout, duals.flat
        active = empty(y.shape, np.bool_)
        _core.active_limits(layout.column, self.scale.flat, y, least, _HARDLY, active)
        if self._has_equations:
            active |= self._in_equations
        value, dual = read_only(c.flat), read_only(self.net(y))
        active.setflags(write=False)
        return tuple(
            made(
                LimitState, limit=own.limit, labels=own.labels, equation=own.equal, k=k[i], value=layout.side(value, i),
                dual=layout.side(dual, i), price=layout.columns.side(price, i), active=layout.side(active, i),
            )
            for i, own in enumerate(self.sides)
            if own.first or not own.equal
        )  # fmt: skip
