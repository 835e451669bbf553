"""A discrete problem with limits, as the optimiser's loop sees it, and the ways in which it may begin again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import changed
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.direction import DiscreteDirection
from leastaction.optimal.discrete.problem import DiscreteProblem
from leastaction.optimal.discrete.shooting import Gapped, ShootingProblem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.initial import pair_of
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.barrier_problem import BarrierProblem
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.memory import Memory, Place, Start
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult

# Price of what is asked at one instant, over that of others, where steps of time may shrink; and of what was not met,
# over what it had been.
_DEARER, _DEARER_AGAIN = 20.0, 10.0
_SHORTER = 0.7  # part of what a motion lasts that a step of the search takes off at most

_SAME = 1e-6  # relative difference of a cost from that of a start that was found, by which it is another cost

# Ease: the first, and the factor to the next; of each stage, which only leads to the next, the tolerance and the most
# iterations.
_EASIEST, _STRIDE, _LOOSE, _LONGEST = 1e6, 10.0, 1e-2, 20


class LimitedProblem(BarrierProblem):
    """A discrete system, its cost and its limits.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    rows : sequence of Rows
    settings : Options
    free_start, gapped
        As of `ShootingProblem`.
    final_time : int, optional
        The place in the state of the time (s) at which the motion ends, if that is found too. The motion may then be
        made to last ever shorter, which also costs ever less: only the price of what is not reached stands against a
        motion of no time at all, where every search ends. It has to be high from the beginning, and higher still where
        a search ends so.
    """

    holds_state = True

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        rows: list[Rows],
        settings: Options,
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
        final_time: int | None = None,
    ) -> None:
        dearer = 1.0 if final_time is None else _DEARER
        super().__init__(system, cost, rows, settings, free_start, gapped, dearer)
        self.asked, self.final_time = cost, final_time
        self.wanted: Start | None = None  # from where gaps are tried once more
        self.curve: Start | None = None  # what was given to begin with

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result."""
        found = initial if isinstance(initial, OptimizationResult) else None
        if found is not None:
            self.found, initial = found, (found.x, found.u)
        super().start(initial)
        if not self.is_open:
            self.first = Start(self.x, self.u)
        # What was found with another cost is no minimum of this one.
        same = found is not None and abs(self.shown - found.cost) <= _SAME * abs(found.cost)
        self.begins_at_minimum = found is not None and found.success and same
        x, u = pair_of(initial)
        self.curve = Start(read_only(np.array(x, dtype=np.float64)), read_only(np.array(u, dtype=np.float64)))
        if self.final_time is not None:
            self.given = self.curve
        if self.given is not None:
            self.given = replace(self.given, was_found=found is not None)
            self.wanted = self._wanted_from(self.given)

    def _wanted_from(self, start: Start) -> Start | None:
        """Return the wanted motion, from the state that a start holds; None of another start, or if it is not known."""
        wanted = self.cost.wanted_states
        if wanted is None or start.x.ndim > 1 or self.final_time is not None:
            return None
        return Start(read_only(np.concatenate([start.x[None], wanted[1:]])), start.u)

    def _with(self, rows: list[Rows], settings: Options) -> LimitedProblem:
        return LimitedProblem(self.system, self.cost, rows, settings, self.free_start, final_time=self.final_time)

    # ---- Other ways to begin --------------------------------------------------------------------

    @property
    def prefers_gaps(self) -> bool:
        """Whether gaps are worth trying where a run is stuck: once."""
        return self.given is not None and self.final_time is None

    def begin_with_gaps(self, *, brief: bool) -> bool:
        """Begin again with gaps from the given start, once, and with other duals; return whether that can be done."""
        if self.final_time is not None:
            return False
        begun = super().begin_with_gaps(brief=brief)
        if begun:
            self._begin()
        else:
            self._try_wanted()
        return begun

    def _goes_on_from_gaps(self, *, closed: bool) -> bool:
        gone = super()._goes_on_from_gaps(closed=closed)
        if not closed:
            self._try_wanted()
        return gone

    def _try_wanted(self) -> None:
        """Have gaps tried from the wanted motion next, where an initial state alone was given; once."""
        self.given, self.wanted = self.wanted, None

    def renew(self) -> None:
        """Take the limits out, for another run from somewhere else."""
        self.duals.begun = False
        self.duals.leeway.give_all_back()
        self.stages.dearer = 1.0 if self.final_time is None else _DEARER

    def recall(self, memory: Memory) -> None:
        super().recall(memory)
        self.wanted, self.curve = memory.wanted, memory.curve

    def memory(self) -> Memory:
        return changed(super().memory(), wanted=self.wanted, curve=self.curve)

    def begin_dearer(self) -> bool:
        """Begin again from the given start, with higher prices of what is asked at a single instant; once."""
        if self.given is None:
            return False
        start, self.given = self.given, None
        self._put_out()
        ShootingProblem.start(self, (start.x, start.u))
        self.stages.dearer *= _DEARER_AGAIN
        self._begin()
        return True

    def misses_an_instant(self) -> bool:
        """Whether what is asked at a single instant, or an equation, is not met."""
        sides = zip(self.duals.sides, self._asked(), self.duals.scale, strict=True)
        return any(
            (side.equal or len(c) == 1) and bool((-c > self.stages.met * scale).any()) for side, c, scale in sides
        )

    def go_to_the_nearer(self, place: Place, report: LimitReport) -> bool:
        """Go back to an earlier end with its duals, if that was nearer to what is asked for; whether it was."""
        asked, scales = self.limited.asked(place.x, place.u).flat, self.duals.scales
        off, now = (float((np.maximum(-c, 0.0) / scales).sum()) for c in (asked, self._asked().flat))
        if off >= now:
            return False
        ShootingProblem._go_to(self, place)
        self.stages.take(report, resumed=True)
        self._set_out()
        return True

    def begin_with_ease(self) -> bool:
        """Begin again from the motion that costs no effort, by stages whose inputs are ever less dear.

        As `EasedProblem` does, with the limits held in every stage.
        """
        eased = None if self.is_open else self.cost.eased(_EASIEST)
        if eased is None:
            return False
        x, u, ease = self.x[0], eased[1], _EASIEST
        while ease > 1.0:
            stage = self.cost.eased(ease)
            assert stage is not None
            found = self.found_by(self._eased(stage[0]), (x, u))
            if found is None:
                return False
            x, u, ease = found.x, found.u, ease / _STRIDE
        return self.stand_at(x, u)

    def _eased(self, cost: Cost) -> LimitedProblem:
        settings = replace(self.settings, max_iterations=_LONGEST, tolerance=_LOOSE)
        return LimitedProblem(self.system, cost, list(self.limited.rows), settings, self.free_start)

    def stand_at(self, x: Array, u: Array) -> bool:
        """Begin again at the projection of a curve; whether there is one."""
        now = self.place()
        self._put_out()
        try:
            DiscreteProblem.start(self, (x, u))
        except LeastActionError:
            self._go_to(now)
            return False
        self._begin()
        return True

    def go_on_from(self, x: Array, u: Array, report: LimitReport | None) -> None:
        """Begin again at a trajectory; ``report``: of the limits there, where their duals are known."""
        self._put_out()
        DiscreteProblem.start(self, (x, u))
        self._begin()
        if report is not None:
            self.stages.take(report, resumed=False)
            self._set_out()

    # ---- Steps ----------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go at first: no model holds as far as to a motion that lasts much shorter."""
        if self.final_time is not None and direction.dx0 is not None:
            lasts, change = (
                self.x[0, self.final_time] - self.system.time(0),
                direction.dx0[self.final_time - self.system.nx],
            )
            if length * change < -_SHORTER * lasts:
                length = float(-_SHORTER * lasts / change)
        return super().first_step(direction, length)
