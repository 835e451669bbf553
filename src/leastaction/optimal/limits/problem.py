"""A discrete problem with limits, as the optimiser's loop sees it: one barrier problem after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost, CostGradient, CostHessian
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution, Workspace, sweep_forward
from leastaction.optimal.discrete.problem import DiscreteDirection, DiscreteProblem, Iterate
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.cost import Jacobians, LimitedCost
from leastaction.optimal.limits.duals import Room, Stages
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.result import OptimizationResult, Settings, Status

__all__ = ["LimitedProblem"]

_DIGITS = 1e4 * float(np.finfo(np.float64).eps)  # of a limit's size is the least room that is told from none


@dataclass(frozen=True)
class LimitedDirection(DiscreteDirection):
    """A direction, and how the values of all limits change along it."""

    dc: Sided = field(kw_only=True)


class LimitedIterate(NamedTuple):
    """A trajectory, its cost without barriers, and the room that limits leave along it."""

    iterate: Iterate
    cost: float
    room: Room


class LimitedProblem(DiscreteProblem):
    """A discrete system, its cost and its limits.

    What the loop minimises is the cost with the barriers of a `LimitedCost`. Where it is at its minimum the next stage
    has a smaller barrier, until that does not matter any more.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    rows : sequence of Rows
    settings : Settings
    """

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        rows: list[Rows],
        settings: Settings,
        free_start: bool | Sequence[str] = False,
    ) -> None:
        super().__init__(system, cost, settings, free_start)
        self.limited = LimitedCost(cost, rows, system.nx, system.nu)
        self.duals = self.limited.duals
        self.stages = Stages(self.duals, settings.tolerance, _DIGITS)
        self.given: LimitReport | None = None
        # Of the iterate; None: not yet.
        self.values: Sided | None = None
        self.plain_value: float | None = None  # the cost alone
        self.jacobians: Jacobians | None = None
        self.plain: CostGradient | None = None  # of the cost alone
        # Of the iterate and this stage; None: not yet.
        self.room: Room | None = None
        # Of both and the duals; None: not yet.
        self.derivatives: tuple[CostGradient, CostHessian] | None = None

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result."""
        if isinstance(initial, OptimizationResult):
            self.given = initial.limits
            initial = initial.x, initial.u
        super().start(initial)
        self._begin()

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        super().resume(result)
        self.given = result.limits
        self._begin(resumed=True)

    def _begin(self, *, resumed: bool = False) -> None:
        """Put the limits in, at the trajectory to start from."""
        self.stages.begin(
            self.value, self._limits(), lambda: self.cost.value(np.zeros_like(self.x), np.zeros_like(self.u))
        )
        for rows in self.limited.rows:
            rows.check(self.x, self.u)
        self.stages.take(self.given, resumed=resumed)
        self._set_out()

    def _limits(self) -> Sided:
        """Return the values of all rows at the iterate."""
        if self.values is None:
            self.values = self.limited.limits(self.x, self.u)
        return self.values

    def _room(self) -> Room:
        """Return the room of all rows at the iterate."""
        if self.room is None:
            self.room = self.duals.room(self._limits())
        return self.room

    def _jacobians(self) -> Jacobians:
        """Return their derivatives, of those that are no entries."""
        if self.jacobians is None:
            self.jacobians = self.limited.jacobians(self.x, self.u)
        return self.jacobians

    # ---- Stages ---------------------------------------------------------------------------------

    @property
    def shown(self) -> float:
        """The cost without barriers."""
        if self.plain_value is None:
            self.plain_value = self.cost.value(self.x, self.u)
        return self.plain_value

    @property
    def magnitude(self) -> float:
        """The cost without barriers: they are known up to a constant, and may be of either sign."""
        return self.shown

    def tolerated(self, goal: float) -> float:
        """Return the expected decrease that is small enough at this stage."""
        return self.stages.tolerated(goal, self.noise)

    def next_stage(self) -> bool:
        """Go on with dearer excess, where a limit needs it, or else with a smaller barrier."""
        before = self.duals.y.flat.copy()
        more = self.stages.advance(self.shown, self._limits())
        self.room = None  # it is one of other prices, even where there is no more
        curvature = self.curvature if np.array_equal(before, self.duals.y.flat) else None
        if more:
            self._set_out()
            self.curvature = curvature  # of the same duals
        return more

    def _set_out(self) -> None:
        """Begin a stage: another cost, the same dynamics."""
        self.tells_saddles = self.system.has_curvature and self.stages.is_last
        self.curvature = self.quasi_newton = self.feedback = self.derivatives = self.room = None
        self.value = self.shown + self.duals.barrier(self._room())

    def verdict(self) -> tuple[Status, str] | None:
        """Return that limits contradict each other, where they could not be met at any price."""
        if self.stages.are_met(self._limits()):
            return None
        return Status.INFEASIBLE, self._report().contradiction(self.system.when)

    # ---- Directions -----------------------------------------------------------------------------

    @property
    def _begun(self) -> bool:
        """Whether there are limits already: the start is projected without."""
        return self.duals.begun

    def _gradient(self) -> CostGradient:
        return self._derivatives()[0] if self._begun else super()._gradient()

    def _hessian(self) -> CostHessian:
        return self._derivatives()[1] if self._begun else super()._hessian()

    def _derivatives(self) -> tuple[CostGradient, CostHessian]:
        if self.derivatives is None:
            dynamics = None
            if any(rows.quantity.looks_ahead for rows in self.limited.rows):
                dynamics = np.concatenate(list(self._linearize()), axis=2)
            room, jacobians = self._room(), self._jacobians()
            gradient = self._with_duals(self.duals.of_barrier(room))
            self.derivatives = gradient, self.limited.hessian(self.x, self.u, room, jacobians, dynamics)
        return self.derivatives

    def _with_duals(self, duals: Sided) -> CostGradient:
        """Return the first derivatives of the cost less the duals times the limits."""
        if self.plain is None:
            self.plain = super()._gradient()
        return self.limited.with_duals(self.plain, duals, self._jacobians())

    def forget(self) -> None:
        """Drop all that was computed along the current iterate."""
        super().forget()
        self.values = self.plain_value = self.room = self.jacobians = self.plain = self.derivatives = None

    def _curvature_along(self, gradient: CostGradient) -> Array:
        # The multipliers of the dynamics are those of the Lagrangian.
        return super()._curvature_along(self._with_duals(self.duals.y) if self._begun else gradient)

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        """Return the direction of a model that has a minimum, with what it changes of the limits."""
        plain = super().direction(method, model, scale, shift)
        return LimitedDirection(**vars(plain), dc=self._change(plain)) if self._begun else plain

    def _change(self, direction: DiscreteDirection) -> Sided:
        """Return how the limits' values change along a direction."""
        dx, du = direction.dx, direction.du
        if dx is None or du is None:
            A, B = self._linearize()
            dx, du = sweep_forward(A, B, direction, direction.dx0)
        return self.limited.along(dx, du, self._jacobians())

    # ---- Steps ----------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go at first: no further than to where the barriers begin to rise."""
        if not isinstance(direction, LimitedDirection):
            return length
        return self.duals.step(self._room(), direction.dc, direction.slope, length)

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Any] | Refusal:
        """Return the projection of a step along the direction, or why it is refused."""
        outcome = super().simulate(direction, length, np.inf)
        if isinstance(outcome, Refusal):
            return outcome
        x, u, _ = outcome.iterate
        room = self.duals.room(self.limited.limits(x, u))
        total = outcome.cost + self.duals.barrier(room)
        if not total <= bound:
            reason = f"a cost with barriers of {total:.10g}, where at most {bound:.10g} was wanted"
            return self._look_for_jump(direction, length, x, Refusal(reason, cost=total))
        return Trial(LimitedIterate(outcome.iterate, outcome.cost, room), total)

    def accept(self, direction: DiscreteDirection, trial: Trial[Any]) -> None:
        """Make a trial the current iterate, and move the duals with it."""
        new: LimitedIterate = trial.iterate
        dc = direction.dc if isinstance(direction, LimitedDirection) else self._change(direction)
        self.duals.y = self.duals.moved(self._room(), dc, new.room)
        super().accept(direction, Trial(new.iterate, trial.cost))
        self.values, self.room, self.plain_value = new.room.c, new.room, new.cost

    # ---- What is told ---------------------------------------------------------------------------

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result at the current iterate."""
        return replace(super().result(summary), limits=self._report())

    def _duals(self) -> Sided:
        """Return the duals after a last step of theirs along Newton's direction, which the motion hardly needs."""
        duals = self.duals.y
        if self.stages.is_last:
            # Memory of its own: the feedback that is told may stand in that of the iteration.
            spare = Workspace(self.system.N, self.system.nx, self.system.nu)
            try:
                method = "newton" if self.has_curvature else "quasi-newton"
                model = self._with_start(self._solve(method, spare, 1.0))
                if model.definite:
                    A, B = self._linearize()
                    dx, du = sweep_forward(A, B, model, self._start_step(model))
                    room = self._room()
                    duals = self.duals.moved(room, self.limited.along(dx, du, self._jacobians()), room)
            except LeastActionError:
                pass  # The duals of the last step will do.
        return self.duals.settled(duals, self._room())

    def _report(self) -> LimitReport:
        k = [rows.k for rows in self.limited.rows]
        return self.stages.report(k, self._limits(), self._duals())
