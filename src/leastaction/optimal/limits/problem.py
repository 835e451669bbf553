"""A discrete problem with limits, as the optimiser's loop sees it, and the ways in which it may begin again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.direction import DiscreteDirection
from leastaction.optimal.discrete.problem import DiscreteProblem
from leastaction.optimal.discrete.shooting import Gapped, ShootingProblem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.initial import both
from leastaction.optimal.limits.barrier_problem import BarrierProblem
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.memory import Start
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.settings import Settings

# Where steps of time may shrink, what is asked at one instant is so much dearer than elsewhere; and than that where the
# search is stuck.
_DEARER, _DEARER_AGAIN = 20.0, 10.0
_SHORTER = 0.7  # of what it lasts is what a step of the search takes off at most

_SAME = 1e-6  # of a cost that was found, by which it differs where it is another cost
_SOON = 30  # iterations that the minimum without limits may take where a run begins again from there


class LimitedProblem(BarrierProblem):
    """A discrete system, its cost and its limits.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    rows : sequence of Rows
    settings : Settings
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
        settings: Settings,
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
        final_time: int | None = None,
    ) -> None:
        dearer = 1.0 if final_time is None else _DEARER
        super().__init__(system, cost, rows, settings, free_start, gapped, dearer)
        self.final_time = final_time

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result."""
        found = initial if isinstance(initial, OptimizationResult) else None
        if found is not None:
            self.known, initial = found.limits, (found.x, found.u)
        super().start(initial)
        # What was found with another cost is no minimum of this one.
        same = found is not None and abs(self.shown - found.cost) <= _SAME * abs(found.cost)
        self.begins_at_minimum = found is not None and found.success and same
        if self.final_time is not None:
            x, u = both(initial)
            self.given = Start(np.array(x, dtype=np.float64), np.array(u, dtype=np.float64))
        if self.given is not None:
            self.given = replace(self.given, was_found=found is not None)

    def _with(self, rows: list[Rows], settings: Settings) -> LimitedProblem:
        return LimitedProblem(self.system, self.cost, rows, settings, self.free_start, final_time=self.final_time)

    # ---- Other ways to begin --------------------------------------------------------------------

    @property
    def prefers_gaps(self) -> bool:
        """Whether gaps are worth trying where a run is stuck: once."""
        return self.given is not None and self.final_time is None

    def begin_with_gaps(self, *, brief: bool) -> bool:
        """Begin again with gaps from the given start, once, and with other duals; return whether that can be done."""
        if self.final_time is not None or not super().begin_with_gaps(brief=brief):
            return False
        self._begin()
        return True

    def begin_again(self) -> bool:
        """Begin again with higher prices where the motion was made too short; return whether that can be done."""
        if self.final_time is None or self.given is None or self.stages.are_met(self._asked()):
            return False
        start, self.given = self.given, None
        self._put_out()
        ShootingProblem.start(self, (start.x, start.u))
        self.stages.dearer *= _DEARER_AGAIN
        self._begin()
        return True

    def begin_freely(self) -> bool:
        """Begin again from the minimum without limits, if that is found soon; return whether it is.

        Not where that says little: where there are conditions or limits of the user's own, such as places to keep off,
        and where the start was a result already.
        """
        own = any(rows.equal or rows.is_own for rows in self.limited.rows)
        if self.is_open or own or self.given is None or self.given.was_found or self.final_time is not None:
            return False
        found = self._found_with([], _SOON)
        if found is None or not found.success:
            return False
        self._remember(self._place())
        self._put_out()
        DiscreteProblem.start(self, (found.x, found.u))
        self._begin()
        return True

    # ---- Steps ----------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go at first: no model holds as far as to a motion that lasts much shorter."""
        if self.final_time is not None and direction.dx0 is not None:
            lasts, change = self.x[0, self.final_time] - self.system.time(0), direction.dx0[self.final_time]
            if length * change < -_SHORTER * lasts:
                length = float(-_SHORTER * lasts / change)
        return super().first_step(direction, length)
