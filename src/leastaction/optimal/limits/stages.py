"""The stages of a barrier that falls: the same in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import sqrt

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import made
from leastaction.numerics.pool import kept
from leastaction.optimal.limit_report import Barrier, LimitReport
from leastaction.optimal.limits.duals import Duals, Room
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.quantity import Instants

_DEARER = 10.0  # factor by which a price rises at most
# Barrier parameter: the first, in the cost by the number of rows; the factor and the power by which it falls from one
# stage to the next, whichever falls faster.
_FIRST, _LESS, _POWER = 0.1, 0.1, 1.5
_FIRST_AGAIN = 1e-4  # barrier parameter, in parts of the first, where multipliers are known
_LAST = 0.1  # barriers' part of the cost in the end, in parts of its tolerated change
# Expected decrease, in times mu, with which a stage is over: where its multipliers are near those of the barrier; and
# elsewhere, and in the last stage, whose multipliers are told. Rows from which on it is by the root of them more.
_LOOSE, _TIGHT, _MANY = 100.0, 10.0, 100.0
_LITTLE, _NOTHING = 1e-6, 1e-12  # cost of a start that costs nothing: below this, and below this part of doing nothing
_ROUGH = 1e-4  # tolerance from which on multipliers need not be exact
_STILL = 1e-3  # price of an excess of an equation's scale before the last stages, at least, in costs of the start
_DEAREST = 1e6  # price of an excess of a limit's scale, at most, in costs of the start
_MET, _MET_ROUGHLY = 1e-6, 1e-2  # violation, in a limit's scale, of a limit that is met; and that part of the tolerance
_EXACTLY = 1e-3  # violation, in parts of that, which no price would enforce any better
# Search for the least violation: the violation, in scales, and the price, in costs of the start, from which on it is
# looked for, with all excess as dear; and the part to which it is found.
_FAR, _TELLING, _NEARLY = 1e-2, 1e3, 1e-4
# Cost, and barriers in the end, beside that of the violations, up to which little but these counts.
_LITTLE_BESIDE, _TRACES = 0.1, 1e-4
_NONE = np.empty(0)  # values of no limits


class BarrierStages:
    """The stages of an optimisation with limits: one barrier problem after the other.

    ``tolerance``: of the optimisation. ``digits``: of a limit's size is the least room that is told from none.
    ``dearer``: than others are at first equations and what is asked at a single instant.
    """

    def __init__(self, duals: Duals, tolerance: float, digits: float, dearer: float = 1.0) -> None:
        self.duals, self.tolerance, self.digits, self.dearer = duals, tolerance, digits, dearer
        self.count = duals.layout.ends[-1]
        self.size = self.first_mu = self.last = np.nan

    def renew(self) -> None:
        """Be as if nothing had been searched."""
        self.duals.leeway.give_all_back()

    def begin(self, value: float, c: Sided, otherwise: Callable[[], float], depths: Array | float = np.inf) -> None:
        """Begin at a trajectory, given its cost, the values of its limits, and how deep these are (see `Duals.begin`).

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
        self.duals.begin(c, self.first_mu, self.size, self.dearer, depths)

    def take(self, given: LimitReport | None, *, resumed: bool, changed: float = 0.0) -> None:
        """Go on with the duals of an earlier run, if it had these limits.

        ``changed``: by how much the cost is another now than that run had found. The barriers are to be worth as much:
        among walls of lower ones there are but short steps to what has moved as far.

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
            moved = min(changed / max(self.count, 1), self.first_mu)
            duals.mu = max(_FIRST_AGAIN * self.first_mu, self.last, moved)
            duals.take(given)
        elif resumed:
            raise ArgumentError(
                f"resume: got a result with the limits {', '.join(given.labels[:4])} ..., expected those of this "
                "call. Give initial=result to start from its trajectory with others"
            )

    def report(self, k: Sequence[Instants], c: Sided, duals: Sided, cost: float) -> LimitReport:
        """Return what is told of the limits, given their instants, values and duals, and the cost without barriers."""
        own = self.duals
        prices = kept(own.rho.flat)
        barrier = made(
            Barrier,
            size=self.size,
            tolerance=self.tolerance,
            first_mu=self.first_mu,
            last_mu=self.last,
            duals=kept(own.y.flat),
            scale=kept(own.scale.flat),
            prices=prices,
            leeway=_joined(own.leeway.whole),
            part=own.leeway.part,
        )
        sides = own.states(k, c, duals, prices, cost)
        return made(LimitReport, sides=sides, mu=own.mu, excess=own.excess(c), barrier=barrier)

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

    def tolerated(self, goal: float, noise: float, room: Room) -> float:
        """Return the expected decrease that is small enough at this stage, given the room of all limits."""
        mu, c = self.duals.mu, room.c
        if self._asks_for_the_least(c):
            return max(goal, _NEARLY * self.duals.cost_of_excess(c))
        if mu > self.last:
            many = 1.0 if self.is_near_end else sqrt(max(1.0, self.count / _MANY))
            # From near the duals of the barrier a much smaller one can be followed.
            loose = not self._rough and self.duals.are_central(room)
            return max(goal, (_LOOSE if loose else _TIGHT) * many * mu)
        if self._rough:
            return max(goal, 10.0 * noise)
        # The duals are worth no more than the motion is near the barrier's minimum.
        return max(min(goal, _TIGHT * mu), 10.0 * noise)

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
        if was_last and duals.excess(c) <= _EXACTLY * self.met:
            # All is met; where rounding ended the search, its duals are no reason to set out with other prices.
            return False
        if self._asks_for_the_least(c):
            return self._closer_to_the_least(c)
        late = self.is_near_end and not was_last
        # Beside prices of a start that was much dearer all else would drown in rounding.
        kept = 0.0 if late else self.dearer * max(abs(cost), _STILL * self.size)
        dearer = duals.price(c, _DEAREST * self.size, met=self.met if self._rough else None, kept=kept)
        if not dearer and (was_last or duals.hopeless()):
            return False  # where nothing follows, what was the last stage still is
        # The cost of the start may be far from that of the end, and with prices the least room changes.
        self.last = max(self._last(abs(cost)), duals.least_mu(self.digits))
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
        dear = self.duals.dearest >= (1.0 - 1e-9) * _TELLING * self.size  # prices times scales are rounded
        return not self._rough and dear and self.duals.excess(c) > _FAR

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


def _joined(values: Iterable[Array]) -> Array:
    return read_only(np.concatenate([_NONE, *values]))
