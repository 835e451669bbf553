"""A discrete system, its cost and its limits, as the optimiser's loop sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.iterates.direction import DiscreteDirection, Iterate
from leastaction.optimal.iterates.work import Work
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Clock, Loop, Problem
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.search.beginning import Beginning
from leastaction.optimal.search.grid import OwnSteps, TimeGrid
from leastaction.optimal.search.parts import SearchParts
from leastaction.optimal.search.stages import DiscreteStages
from leastaction.optimal.search.told import told

_SAME = 1e-6  # relative difference of a cost from that of a start that was found, by which it is another cost
_SHORTER = 0.7  # part of what a motion lasts that a step of the search takes off at most
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
        Price of what is asked at a single instant, over that of others, at first.
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
        self.settings, self.finer, self.results = settings, finer, results
        work = work or Work(system.N, system.ndx, system.nu)
        dearer = dearer or (1.0 if final_time is None else _DEARER)
        self.parts = SearchParts(system, cost, settings, rows, free_start, dearer, grid or OwnSteps(), work)
        self.beginning = Beginning(self.parts, gapped, final_time, self.found_with)
        self.stages = DiscreteStages(self.parts, self.beginning)
        self.has_curvature, self.begins_again = system.has_curvature, not self.parts.grid.is_mesh
        self.is_drowned = self.begins_at_minimum = False

    def renew(self) -> None:
        """Be as if nothing had been searched."""
        self.parts.renew()
        self.beginning.renew()
        self.is_drowned = self.begins_at_minimum = False

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result."""
        self.beginning.start(initial)
        if isinstance(initial, OptimizationResult) and self.parts.rows:
            # What was found with another cost is no minimum of this one.
            same = abs(self.shown - initial.cost) <= _SAME * abs(initial.cost)
            self.begins_at_minimum = initial.success and same

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        self.beginning.resume(result)

    # ---- Other problems -----------------------------------------------------------------------------

    def related(self, rows: Sequence[Rows], cost: Cost | None = None, **settings: Any) -> DiscreteProblem:
        """Return the problem with other limits and settings, and perhaps another cost."""
        parts, options = self.parts, self.settings.changed(**settings)
        return DiscreteProblem(
            parts.system, cost or parts.asked, options, rows, parts.free_start, final_time=self.beginning.final_time
        )

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

    # ---- Where it stands ----------------------------------------------------------------------------

    @property
    def clock(self) -> Clock:
        return self.parts.work.clock

    @property
    def rollouts(self) -> int:
        return self.parts.work.rollouts

    @property
    def note(self) -> str:  # type: ignore[override]
        return self.beginning.note

    @property
    def tells_saddles(self) -> bool:
        return self.parts.tells_saddles

    @tells_saddles.setter
    def tells_saddles(self, so: bool) -> None:
        self.parts.tells_saddles = so

    @property
    def value(self) -> float:
        return self.parts.here.value

    @property
    def shown(self) -> float:
        return self.parts.shown

    @property
    def magnitude(self) -> float:
        # Barriers are known up to a constant, and may be of either sign.
        return self.parts.here.value if self.parts.limits is None else self.parts.shown

    @property
    def noise(self) -> float:
        return self.parts.here.noise

    @property
    def roughness(self) -> float:
        return self.parts.here.roughness

    def note_roughness(self, off: float) -> None:
        self.parts.here.roughness = off

    @property
    def gap(self) -> float:
        curve = self.parts.curve
        return 0.0 if curve is None else curve.gap

    @property
    def worst_step(self) -> StepQuality | None:
        return self.parts.here.worst_step

    @property
    def sees_walls(self) -> bool:
        return self.parts.merit.sees_walls

    @property
    def undetermined(self) -> str:
        return self.parts.models.start.undetermined

    # ---- Directions ---------------------------------------------------------------------------------

    def minimise_model(self, method: str, scale: float, shift: float = 0.0) -> LinearQuadraticSolution:
        model = self.parts.models.minimise(method, scale, shift)
        # In exact numbers a convex model has a minimum.
        is_lost = method == "quasi-newton" and not model.definite
        self.is_drowned = self.parts.limits is not None and (is_lost or model.smallest_eigenvalue > 0.0)
        if self.is_drowned:
            # Beside stiff limits the rest of the curvature is lost in rounding: this is no saddle.
            self.parts.tells_saddles = False
        return model

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        parts = self.parts
        return parts.merit.followed(parts.steps.direction(method, model, scale, shift), parts.models)

    def refined(self, direction: DiscreteDirection, *, holds: bool) -> DiscreteDirection:
        return self.parts.merit.refined(direction, self.parts.models, holds=holds)

    def negative_curvature(self, scale: float) -> DiscreteDirection | None:
        return self.parts.models.negative_curvature(scale)

    def left_beside_rounding(self) -> float:
        limits = self.parts.limits
        if self.parts.here.is_open or limits is None or not self.has_curvature:
            return np.inf
        return limits.left_beside_rounding(self.parts.models)

    def where(self, direction: DiscreteDirection) -> str:
        return self.parts.models.where(direction)

    # ---- Steps --------------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        final, parts = self.beginning.final_time, self.parts
        if final is not None and direction.dx0 is not None:
            # No model holds as far as to a motion that lasts much shorter.
            lasts, change = parts.x[0, final] - parts.system.time(0), direction.dx0[final - parts.system.nx]
            if length * change < -_SHORTER * lasts:
                length = float(-_SHORTER * lasts / change)
        return parts.steps.first_step(direction, length)

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Iterate] | Refusal:
        return self.parts.steps.simulate(direction, length, bound)

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        return self.parts.steps.promised(direction, length)

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        self.parts.steps.accept(direction, trial)
        self.parts.grid.note_step()

    def keep_feedback(self, direction: DiscreteDirection) -> None:
        self.parts.models.feedback = direction.gain
        if self.parts.limits is not None:
            self.parts.limits.are_settled = True

    def forget(self) -> None:
        self.parts.models.forget()

    # ---- To the next stage, and to the end ----------------------------------------------------------

    def following(self, *, moved: bool) -> DiscreteProblem | None:
        if self.stages.advance(moved=moved):
            return self
        return None if self.finer is None else self.finer(self)

    def arrays(self) -> tuple[Array, Array]:
        return self.parts.grid.arrays(self.parts.here)

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        if self.results is not None:
            return self.results(self, summary)
        return told(self.parts, self.beginning.begun, summary)
