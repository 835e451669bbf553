"""A discrete system, its cost and its limits, as the optimiser's loop sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.iterates.direction import DiscreteDirection, Iterate
from leastaction.optimal.iterates.work import Work
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.loop import Loop, Problem, Steps
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.search.beginning import Beginning
from leastaction.optimal.search.grid import OwnSteps, TimeGrid
from leastaction.optimal.search.parts import SearchParts
from leastaction.optimal.search.stages import DiscreteStages
from leastaction.optimal.search.told import DiscreteReport

_SAME = 1e-6  # relative difference of a cost from that of a start that was found, by which it is another cost
_DEARER = 20.0  # price of what is asked at one instant, over that of others, where steps of time may shrink


class DiscreteProblem(Problem[LinearQuadraticSolution, DiscreteDirection, Iterate]):
    """A discrete system, its cost and its limits, at the current iterate.

    ``parts``: what it is put together from. ``beginning``: how it begins, and begins again.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    settings : Options
    rows : sequence of Rows
        Of limits.
    free_start : bool or sequence of str
        Whether the initial state is found too, or which of its entries.
    gapped : {"never", "where needed", "where left", "at once"}
        When steps may have gaps.
    final_time : int, optional
        The place in the state of the time (s) at which the motion ends, if that is found too. The motion may then be
        made to last ever shorter, which also costs ever less: only the price of what is not reached stands against a
        motion of no time at all, where every search ends. It has to be high from the beginning, and higher still where
        a search ends so.
    dearer : float, optional
        Factor by which equations and what is asked at a single instant are dearer at first.
    grid : TimeGrid, optional
        The times of the steps; the system's own if left out.
    finer : callable, optional
        ``finer(problem)`` returns the problem on a finer grid, where the motion asks for it.
    results : callable, optional
        ``results(problem, summary)`` returns the result, if it is not one of these steps.
    work : Work, optional
        Memory of such a problem that is not searched any more.
    """

    stages: DiscreteStages
    begins_again = True

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Options,
        rows: Sequence[Rows] = (),
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
        *,
        final_time: int | None = None,
        dearer: float | None = None,
        grid: TimeGrid | None = None,
        finer: Callable[[DiscreteProblem], DiscreteProblem | None] | None = None,
        results: Callable[[DiscreteProblem, dict[str, Any]], OptimizationResult] | None = None,
        work: Work | None = None,
    ) -> None:
        self.settings, self.finer = settings, finer
        work = work or Work(system.N, system.ndx, system.nu)
        dearer = dearer or (1.0 if final_time is None else _DEARER)
        self.parts = SearchParts(system, cost, settings, rows, free_start, final_time, dearer, grid or OwnSteps(), work)
        self.beginning = Beginning(self.parts, gapped, final_time, self.found_with)
        self.here, self.models = self.parts.here, self.parts.models
        self.stages = DiscreteStages(self.parts, self.beginning)
        self.report = DiscreteReport(self.parts, self.beginning, None if results is None else partial(results, self))

    def renew(self) -> None:
        """Be as if nothing had been searched."""
        self.parts.renew()
        self.beginning.renew()
        self.begins_at_minimum = False

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result."""
        self.beginning.start(initial)
        if self.parts.rows and isinstance(initial, OptimizationResult):
            # What was found with another cost is no minimum of this one.
            same = abs(self.report.shown - initial.cost) <= _SAME * abs(initial.cost)
            self.begins_at_minimum = initial.success and same

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        self.beginning.resume(result)

    # ---- Other problems -----------------------------------------------------------------------------

    def related(
        self,
        rows: Sequence[Rows],
        cost: Cost | None = None,
        gapped: Gapped = "never",
        *,
        dearer: float | None = None,
        **settings: Any,
    ) -> DiscreteProblem:
        """Return the problem with other limits and settings, and perhaps another cost, on the same times."""
        parts, options = self.parts, self.settings.changed(**settings)
        return DiscreteProblem(
            parts.system, cost or parts.asked, options, rows, parts.free_start, gapped,
            final_time=self.beginning.final_time, dearer=dearer, grid=parts.grid,
        )  # fmt: skip

    def found_with(self, rows: Sequence[Rows], iterations: int, *, tolerance: float = 0.0) -> OptimizationResult | None:
        """Return what some iterations with other limits lead to from the iterate; None where that is nowhere.

        ``tolerance``: is enough, where a smaller one is asked for.
        """
        enough = max(tolerance, self.settings.tolerance)
        other = self.related(rows, max_iterations=iterations, tolerance=enough)
        return self.found_by(other, (self.parts.x, self.parts.u))

    def found_by(self, other: DiscreteProblem, start: tuple[Array, Array]) -> OptimizationResult | None:
        """Return what another problem leads to from a start, without beginning again; None where that is nowhere."""
        try:
            other.start(start)
            found = Loop(other, other.settings).run()
        except LeastActionError:
            return None
        self.parts.work.rollouts += found.rollouts
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return found

    @property
    def steps(self) -> Steps[LinearQuadraticSolution, DiscreteDirection, Iterate]:
        return self.parts.curve or self.parts.trajectory_steps

    def following(self, *, moved: bool) -> DiscreteProblem | None:
        if self.stages.advance(moved=moved):
            return self
        return None if self.finer is None else self.finer(self)
