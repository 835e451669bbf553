"""Duals and prices of limits, and the stages of a barrier that falls: the same in discrete and in continuous time.

All is told by the values c of the limits where the iterate stands, one array (n, m) for each side, and knows nothing of
trajectories.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.limit_report import Barrier, LimitReport, LimitState
from leastaction.optimal.limits.barrier import (
    Split,
    barrier_step,
    first_duals,
    moved_duals,
    split,
    stiffness,
)
from leastaction.optimal.limits.leeway import Leeway
from leastaction.optimal.limits.sides import Layout, Sided
from leastaction.optimal.quantity import Instants

_DEAR = 10.0  # times its dual is the price of an excess
_CHEAPER, _DEARER = 1e-3, 10.0  # by which prices change at most
_BINDING = 0.5  # of the price is the dual of a limit that the price does not enforce
_SETTLED = 2.3  # natural logarithm of the factor by which duals may be off those of the barrier in the end
# Dual times scale of a limit that is active: more than so many mu, and than the geometric mean of mu and the cost. The
# scale may be what was seen at a start far away, so that tells whether a limit is active anywhere; and the part of its
# largest dual, where.
_ACTIVE, _HARDLY = 100.0, 1e-5

# The barrier's parameter: the first, in the cost by the number of rows; how it falls from one stage to the next.
_FIRST, _LESS, _POWER = 0.1, 0.1, 1.5
_FIRST_AGAIN = 1e-4  # where duals are known
_LAST = 0.1  # of the tolerated change of the cost is the barriers' part in the end
# Times mu: the expected decrease with which a stage but the last is over; of more rows than these, by the root more.
_LOOSE, _MANY = 10.0, 100.0
_LITTLE, _NOTHING = 1e-6, 1e-12  # a start that costs less than the first, and that part of doing nothing, costs nothing
_ROUGH = 1e-4  # a tolerance from which on duals need not be exact
_DEAREST = 1e6  # costs of the start for an excess of a limit's scale
# Of its scale a limit may be off where the problem cannot be met otherwise, and that part of a rough tolerance.
_MET, _MET_ROUGHLY = 1e-6, 1e-2
_EXACTLY = 1e-3  # of what it may be off a limit is off that no price would enforce any better
# Where limits are off by more than the first part of their scale though some price was raised to the second, in costs
# of the start, and little but that counts, all excess is made as dear: what is left then is the least that they can be
# off, to the third part. What the cost that was asked for comes to there at most, and the barriers at first and in the
# end.
_FAR, _TELLING, _NEARLY = 1e-2, 1e3, 1e-4
_LITTLE_BESIDE, _GUIDING, _TRACES = 0.1, 0.1, 1e-4
# Times a rough tolerance, where limits are not met: what they are off by costs less than that often, and is a matter of
# some more steps, where dearer excess would only bend the way to the minimum.
_CLOSER = 1e-2


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a limit, as far as its duals go.

    ``limit``, ``labels``, ``equal``: as in a `LimitState`. ``first``: whether it is the first of the two sides of an
    equation, which follow each other. ``scale``, ``size`` (m,): what is large, 0 where that is to be seen from where
    the optimisation starts; and the largest bound.
    """

    limit: str
    labels: tuple[str, ...]
    equal: bool
    first: bool
    scale: Array
    size: Array


class Room(NamedTuple):
    """The values ``c`` of all sides somewhere, and ``part``, how each is split into slack and excess there.

    It is that of a parameter of the barrier and of prices.
    """

    c: Sided
    part: Split


class Duals:
    """The duals of limits, the prices of their excess, and the barrier's parameter.

    ``sides``: of each, what it is. ``layout``: of their values over the horizon.
    """

    def __init__(self, sides: Sequence[Side], layout: Layout) -> None:
        self.sides, self.layout = tuple(sides), layout
        self.begun = False
        self.mu = np.nan
        # One for each column of every side.
        self.scale, self.rho = layout.columns.empty(), layout.columns.empty()
        self.y = layout.empty()
        self._size = layout.columns.filled([side.size for side in self.sides]).flat
        self._equal = layout.columns.filled([float(side.equal) for side in self.sides]).flat > 0.0
        self._in_equations = layout.spread(self._equal)
        self._other = self._other_sides()
        self.prices, self.scales = np.empty(0), np.empty(0)  # of all entries
        self.dearest, self.cheapest = 0.0, np.inf  # prices of an excess of a limit's scale
        self.leeway = Leeway([side.size.size for side in self.sides])

    def begin(self, c: Sided, mu: float, price: float, dearer: float = 1.0) -> None:
        """Choose scales, prices and duals from where the optimisation starts.

        ``price``: of an excess of a limit's scale; of equations, and of limits at a single instant, times ``dearer``.
        """
        self.mu, self.begun, columns = mu, bool(self.sides), self.layout.columns
        seen = np.maximum(self.layout.largest(np.abs(c.flat)), 1e-6 * (1.0 + self._size))
        known = columns.filled([side.scale for side in self.sides]).flat
        self.scale = Sided(np.where(known > 0.0, known, seen), columns)
        alone = [side.equal or len(values) == 1 for side, values in zip(self.sides, c, strict=True)]
        prices = columns.filled([price * (dearer if single else 1.0) for single in alone]).flat
        self.rho = Sided(prices / self.scale.flat, columns)
        self.settle_prices()
        self._begin_duals(c)

    def _begin_duals(self, c: Sided) -> None:
        """Begin with the duals of the barriers at the values c."""
        self.y = Sided(first_duals(self.of_barrier(self.room(c)).flat, self.prices), self.layout)

    def room(self, c: Sided) -> Room:
        """Return slack and excess of values of all sides."""
        return Room(c, split(c.flat, self.mu, self.prices))

    def barrier(self, room: Room) -> float:
        """Return the sum of the barriers."""
        return room.part.value

    def of_barrier(self, room: Room) -> Sided:
        """Return the duals of the barriers themselves, ``mu / s``."""
        return Sided(self.mu / room.part.slack, self.layout)

    def stiffnesses(self, room: Room, most: float = np.inf) -> Sided:
        """Return ``-dy/dc`` of the primal-dual model, at most so much of the largest that may be, ``rho^2 / mu``."""
        sigma = stiffness(room.part, self.prices, self.y.flat)
        return Sided(sigma if most == np.inf else np.minimum(sigma, most / self.mu * self.prices**2), self.layout)

    def moved(self, room: Room, dc: Sided, after: Room) -> Sided:
        """Return the duals moved along their own direction, after a step along dc from one place to another."""
        moved = moved_duals(room.part, self.mu, self.prices, self.y.flat, dc.flat, after.part)
        return Sided(moved, self.layout)

    def step(self, room: Room, dc: Sided, fall: float, least: float, length: float) -> float:
        """Return where along a direction the model is least that has the barriers themselves in place of their models.

        ``dc``: change of the values along it. ``fall``, ``least``: slope of cost and barriers, and their model's change
        at its end. ``length``: where to look no further.
        """
        return barrier_step(
            room.c.flat, room.part, self.mu, self.prices, self.y.flat, dc.flat, fall=fall, least=least, length=length
        )

    def kept_near(self, y: Array, after: Room) -> Sided:
        """Return duals that are not too far from those of the barrier."""
        still = Split(self.mu / y, np.ones_like(y))
        return Sided(moved_duals(still, self.mu, self.prices, y, np.zeros_like(y), after.part), self.layout)

    def settle_prices(self) -> None:
        """Take the prices and scales of all sides as they are now."""
        self.prices, self.scales = self.layout.spread(self.rho.flat), self.layout.spread(self.scale.flat)
        prices = self.rho.flat * self.scale.flat
        self.dearest, self.cheapest = float(prices.max(initial=0.0)), float(prices.min(initial=np.inf))

    def settled(self, duals: Sided, room: Room) -> Sided:
        """Return duals; where they have not come near those of the barrier, these."""
        y, barrier = duals.flat, self.of_barrier(room).flat
        return Sided(np.where(np.abs(np.log(y / barrier)) < _SETTLED, y, barrier), self.layout)

    def excess(self, c: Sided) -> float:
        """Return the largest violation of a limit, relative to its scale."""
        return -float((c.flat / self.scales).min(initial=0.0))

    def cost_of_excess(self, c: Sided) -> float:
        """Return what the violations of all limits cost at their prices."""
        return float(np.maximum(-c.flat, 0.0) @ self.prices)

    # ---- Prices ---------------------------------------------------------------------------------

    @property
    def is_level(self) -> bool:
        """Whether an excess of its scale is as dear for each limit."""
        return self.cheapest >= (1.0 - 1e-9) * self.dearest

    def level(self, c: Sided, price: float) -> None:
        """Make an excess of its scale as dear for each limit, and begin with the duals of the barriers."""
        self.rho = Sided(price / self.scale.flat, self.layout.columns)
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

    def net(self) -> Array:
        """Return the duals of all entries, of both sides of an equation their difference."""
        y = self.y.flat
        return np.where(self._in_equations, y - y[self._other], y)

    def hopeless(self) -> bool:
        """Whether some limit is not enforced though its price is the dearest there is."""
        return bool((self.layout.largest(np.abs(self.net())) > _BINDING * self.rho.flat).any())

    def least_mu(self, digits: float) -> float:
        """Return the parameter below which the room that it leaves would be a part `digits` of a limit's size."""
        largest = self.layout.largest(self.y.flat)
        return digits * float((largest * (self.scale.flat + self._size)).max(initial=0.0))

    def price(self, c: Sided, dearest: float, *, met: float | None = None) -> bool:
        """Set the prices of excess by the duals; whether some limit needs a price that is higher.

        ``c``: at the minimum at these prices and this mu. ``dearest``: what an excess of a limit's scale may cost at
        most. ``met``: what is off by more of its scale needs a higher price, whatever its dual, a rough one perhaps.
        """
        layout, net, rho = self.layout, self.net(), self.rho.flat
        scale, most = self.scale.flat, dearest / self.scale.flat
        binding, off = layout.largest(np.abs(net)) > _BINDING * rho, np.zeros(len(rho), dtype=np.bool_)
        if met is not None:
            off = layout.largest(-c.flat) > met * scale
        binding = (binding | off) & (rho < most)
        new = np.where(
            binding,
            np.minimum(_DEARER * rho, most),
            # Equations are met the better the dearer they are, and what is off has no dual yet to go by.
            np.where(off | self._equal, rho, _between(_CHEAPER * rho, _DEAR * layout.largest(net), rho)),
        )
        self.rho = Sided(new, layout.columns)
        self.settle_prices()
        new, lower = self.prices, np.minimum(self.y.flat, 0.9 * self.prices)
        y = np.where(layout.spread(binding) & (c.flat < 0.0), first_duals(lower, new), lower)
        self.y = Sided(np.where(self._in_equations, 0.5 * (new + _between(-0.9 * new, net, 0.9 * new)), y), layout)
        return bool(binding.any())

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
        self.mu, self.y = mu, Sided(barrier.duals.copy(), self.layout)
        columns = self.layout.columns
        self.scale, self.rho = Sided(barrier.scale.copy(), columns), Sided(barrier.prices.copy(), columns)
        if barrier.part > 0.0:
            self.leeway.restore(list(Sided(barrier.leeway.copy(), columns)), barrier.part)
        else:
            self.leeway.give_all_back()
        self.settle_prices()

    def states(self, k: Sequence[Instants], c: Sided, duals: Sided, cost: float) -> tuple[LimitState, ...]:
        """Return what is told of the limits, given their instants, values and duals, and the cost."""
        least, sides = max(_ACTIVE * self.mu, np.sqrt(self.mu * abs(cost))), []
        for i, own in enumerate(self.sides):
            if own.equal and not own.first:
                continue
            dual = duals[i]
            active = np.full(dual.shape, own.equal)
            if own.equal:
                dual = dual - duals[i + 1]
            else:
                active |= (dual * self.scale[i] > least) & (dual > _HARDLY * dual.max(axis=0, initial=0.0))
            at = k[i].astype(np.int64)
            for array in (at, active):
                array.setflags(write=False)
            # Copies: what is told outlives the run, and is saved.
            value, dual, price = (read_only(each.copy()) for each in (c[i], dual, self.rho[i]))
            sides.append(LimitState(own.limit, own.labels, own.equal, at, value, dual, price, active))
        return tuple(sides)


def _joined(values: Iterable[Array]) -> Array:
    return read_only(np.concatenate([np.empty(0), *values]))


def _between(least: Array, values: Array, most: Array) -> Array:
    """Return values, none of them beyond bounds; as `numpy.clip` does, which takes several times as long."""
    return np.minimum(np.maximum(values, least), most)


class Stages:
    """The stages of an optimisation with limits: one barrier problem after the other.

    ``tolerance``: of the optimisation. ``digits``: of a limit's size is the least room that is told from none.
    ``dearer``: than others are at first equations and what is asked at a single instant.
    """

    def __init__(self, duals: Duals, tolerance: float, digits: float, dearer: float = 1.0) -> None:
        self.duals, self.tolerance, self.digits, self.dearer = duals, tolerance, digits, dearer
        self.count = duals.layout.ends[-1]
        self.size = self.first_mu = self.last = np.nan

    def begin(self, value: float, c: Sided, otherwise: Callable[[], float]) -> None:
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
        self.duals.begin(c, self.first_mu, self.size, self.dearer)

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

    def report(self, k: Sequence[Instants], c: Sided, duals: Sided, cost: float) -> LimitReport:
        """Return what is told of the limits, given their instants, values and duals, and the cost without barriers."""
        own = self.duals
        barrier = Barrier(
            size=self.size,
            tolerance=self.tolerance,
            first_mu=self.first_mu,
            last_mu=self.last,
            duals=read_only(own.y.flat.copy()),
            scale=read_only(own.scale.flat.copy()),
            prices=read_only(own.rho.flat.copy()),
            leeway=_joined(own.leeway.whole),
            part=own.leeway.part,
        )
        return LimitReport(own.states(k, c, duals, cost), own.mu, own.excess(c), barrier)

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
        return not self.duals.sides or (self.duals.mu <= self.last and not self.duals.leeway.is_lent)

    @property
    def is_near_end(self) -> bool:
        """Whether the next stage is the last, or this: few steps are left for the duals to settle in."""
        return not self.duals.sides or self._following <= self.last

    def tolerated(self, goal: float, noise: float, c: Sided) -> float:
        """Return the expected decrease that is small enough at this stage, given the values of all limits."""
        mu = self.duals.mu
        if self._asks_for_the_least(c):
            return max(goal, _NEARLY * self.duals.cost_of_excess(c))
        if mu > self.last:
            many = 1.0 if self.is_near_end else float(np.sqrt(max(1.0, self.count / _MANY)))
            return max(goal, _LOOSE * many * mu)
        if self._rough:
            return max(goal if self.are_met(c) else _CLOSER * goal, 10.0 * noise)
        # The duals are worth no more than the motion is near the barrier's minimum.
        return max(min(goal, _LOOSE * mu), 10.0 * noise)

    def advance(self, cost: float, c: Sided, *, moved: bool = True) -> bool:
        """Go on with dearer excess, where a limit needs it, or else with a smaller barrier; whether there is more.

        ``moved``: whether the last stage made a step. Where it made none, and there are equations only, the next is
        left out too: a barrier that falls slowly is for finding which limits are active.
        """
        duals = self.duals
        if duals.leeway.is_lent:
            if not duals.price(c, _DEAREST * self.size):
                duals.leeway.give_back()
            return True
        was_last = self.is_last
        # The cost of the start may be far from that of the end.
        last = max(self._last(abs(cost)), duals.least_mu(self.digits))
        if was_last and duals.excess(c) <= _EXACTLY * self.met:
            # All is met; where rounding ended the search, its duals are no reason to set out with other prices.
            return False
        if self._asks_for_the_least(c):
            return self._closer_to_the_least(c)
        dearer = duals.price(c, _DEAREST * self.size, met=self.met if self._rough else None)
        if not dearer and (was_last or duals.hopeless()):
            return False
        self.last = last  # where nothing follows, what was the last stage still is
        if dearer and self._is_telling(c) and abs(cost) <= _LITTLE_BESIDE * duals.cost_of_excess(c):
            duals.level(c, duals.dearest)
            return True
        # Who asks for few digits need not see what a price comes to before the next barrier.
        if not dearer or (self._rough and not was_last):
            skips = not moved and all(side.equal for side in duals.sides)
            following = self._after(self._following) if skips else self._following
            duals.mu = min(duals.mu, max(self.last, following))
        return True

    def look_for_the_least(self, c: Sided) -> bool:
        """Go on towards the least that limits can be off, where a stage led nowhere; whether they are off by much.

        Once: who looks for it already goes nowhere else.
        """
        if self._rough or self.duals.excess(c) <= _FAR or self._asks_for_the_least(c):
            return False
        self.duals.level(c, max(self.duals.dearest, _TELLING * self.size))
        return True

    def _is_telling(self, c: Sided) -> bool:
        """Whether limits are far from being met, though prices are high: they may contradict each other."""
        return not self._rough and self.duals.dearest >= _TELLING * self.size and self.duals.excess(c) > _FAR

    def _asks_for_the_least(self, c: Sided) -> bool:
        """Whether this stage looks for the least that limits can be off."""
        return self._is_telling(c) and self.duals.is_level

    def _closer_to_the_least(self, c: Sided) -> bool:
        """Go on with less of what leads away from the least that limits can be off; whether there is any."""
        duals, dearest = self.duals, _DEAREST * self.size
        if duals.dearest < (1.0 - 1e-9) * dearest:
            duals.level(c, min(_DEARER * duals.dearest, dearest))
        elif duals.mu * self.count > _TRACES * duals.cost_of_excess(c):
            duals.mu *= _LESS
        else:
            return False
        return True

    @property
    def _following(self) -> float:
        """The barrier's parameter of the next stage, if that is not the last."""
        return self._after(self.duals.mu)

    def _after(self, mu: float) -> float:
        """Return the parameter that follows another."""
        unit = self.first_mu / _FIRST
        part = mu / unit
        return float(unit * min(_LESS * part, part**_POWER))

    def are_met(self, c: Sided) -> bool:
        """Whether all limits are met, as well as can be asked."""
        return self.duals.excess(c) <= self.met

    def _last(self, cost: float) -> float:
        """Return the parameter of a barrier that matters no more at a cost."""
        return _LAST * self.tolerance * max(cost, 1e-9 * self.size) / max(self.count, 1)
