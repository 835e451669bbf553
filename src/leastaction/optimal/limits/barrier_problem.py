"""What problems with limits share, in both kinds of time: one barrier problem after the other."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import changed
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.descent import minimise_model
from leastaction.optimal.discrete.direction import DiscreteDirection, Iterate
from leastaction.optimal.discrete.hessians import ModelHessian, between, shifted
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution, Workspace
from leastaction.optimal.discrete.problem import least_of
from leastaction.optimal.discrete.shooting import Gapped, ShootingProblem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.charts import charted
from leastaction.optimal.limits.cost import Jacobians, LimitedCost
from leastaction.optimal.limits.duals import Room
from leastaction.optimal.limits.leeway import may_be_obstacle, stands_still
from leastaction.optimal.limits.refinement import SolvedWithin, promising, refined
from leastaction.optimal.limits.rows import Rows, check_agreement
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.limits.stages import BarrierStages
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Loop
from leastaction.optimal.memory import Place
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult, Status

_DIGITS = 1e3 * float(np.finfo(np.float64).eps)  # least room that is told from none, in parts of a limit's size

_SOFTER = (1e-2, 1e-4, 1e-6, 1e-8)  # parts of the largest stiffness that models know where rounding drowns the whole
_ACTIVE = 1e-6  # most room of a limit that is active, in its scale
_FAR = 5.0  # expected decrease of a step that is far from the minimum, in costs
_AHEAD = 5  # iterations without obstacles, after which it is seen whether they stand in the way


class LimitedIterate(NamedTuple):
    """A trajectory, its cost without barriers, and the room that limits leave along it."""

    iterate: Iterate
    cost: float
    room: Room


class BarrierProblem(ShootingProblem):
    """A discrete system, its cost and its limits; the base of those that are given and of those on a mesh.

    What the loop minimises is the cost with the barriers of a `LimitedCost`. Where it is at its minimum the next stage
    has a smaller barrier, until that does not matter any more. Gaps are closed in the first stage, whose barriers are
    the softest.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    rows : sequence of Rows
    settings : Options
    dearer : float
        Than others are equations and what is asked at a single instant, at first.
    """

    sees_walls = True

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        rows: list[Rows],
        settings: Options,
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
        dearer: float = 1.0,
    ) -> None:
        super().__init__(system, cost, settings, free_start, gapped)
        rows = charted(rows, self.space)
        check_agreement(rows, system.when)
        self.limited = LimitedCost(cost, rows, system.ndx, system.nu)
        self.duals = self.limited.duals
        self.stages = BarrierStages(self.duals, settings.tolerance, _DIGITS, dearer)
        self.settings = settings
        self.found: OptimizationResult | None = None  # by an earlier run, whose duals are known
        # Of the iterate; None: not yet.
        self.values: Sided | None = None
        self.plain_value: float | None = None  # the cost alone
        self.jacobians: Jacobians | None = None
        self.plain: CostGradient | None = None  # of the cost alone
        self.plain_bend: dict[bool, ModelHessian] = {}  # of the cost alone, the convex part and the whole
        self.has_bends: bool | None = None  # whether these differ, or limits bend
        # Of the iterate and this stage; None: not yet.
        self.room: Room | None = None
        # Of both and the duals; None: not yet.
        self.gradient: CostGradient | None = None  # with the barriers
        self.weighed: tuple[float, ModelHessian] | None = None  # second derivatives, with a share of what bends
        self.central: bool | None = None  # whether the duals are near those of the barrier
        self.newton_change: Sided | None = None  # of the limits, along Newton's undamped direction
        self.are_settled = False  # whether no step of the duals is needed any more

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, or an initial state and inputs."""
        super().start(initial)
        for rows, values in zip(self.limited.rows, self._limits(), strict=True):
            rows.check_values(values, self.system.when)
        self._begin()

    def resume(self, result: OptimizationResult) -> None:
        super().resume(result)
        self.found = result
        self._begin(resumed=True)

    def _begin(self, *, resumed: bool = False) -> None:
        """Put the limits in, at the trajectory to start from."""
        if not resumed:
            self.values = None
            self.duals.leeway.lend(self.limited.rows, [(self.x, self.u), *self._ahead()])
        self.stages.begin(
            self.shown,
            self._limits(),
            lambda: self.cost.value(np.zeros_like(self.x), np.zeros_like(self.u)),
            self._depths(),
        )
        for rows in self.limited.rows:
            rows.check(self.x, self.u)
            rows.check_start(self.x[0])
        # Once: who begins again begins anew, whether resumed meanwhile or not.
        found, self.found = self.found, None
        if found is not None:
            self.stages.take(found.limits, resumed=resumed, changed=abs(self.shown - found.cost))
        self.values = None  # they may have been lent other leeway
        self._set_out()

    def _depths(self) -> Array:
        """Return how deep obstacles are whose size is not known; infinity of other columns.

        What is seen far away from an obstacle is no measure of it: to leap through it would cost too little.
        """
        found = [
            rows.depths(values, self.x, self.u)
            if not rows.scale.any() and may_be_obstacle(rows, self.x, self.u)
            else np.full(rows.scale.shape, np.inf)
            for rows, values in zip(self.limited.rows, self._asked(), strict=True)
        ]
        return np.concatenate([np.empty(0), *found])

    def _ahead(self) -> list[tuple[Array, Array]]:
        """Return where a few iterations without obstacles lead from a start that does not say how to pass them."""
        obstacles = [rows for rows in self.limited.rows if may_be_obstacle(rows, self.x, self.u)]
        if self.is_open or not any(stands_still(rows, self.x, self.u) for rows in obstacles):
            return []
        found = self.found_with([rows for rows in self.limited.rows if rows not in obstacles], _AHEAD)
        return [] if found is None else [(found.x, found.u)]

    @abstractmethod
    def _with(self, rows: list[Rows], settings: Options) -> BarrierProblem:
        """Return the problem with other limits."""

    def found_with(self, rows: list[Rows], iterations: int, *, tolerance: float = 0.0) -> OptimizationResult | None:
        """Return what some iterations with other limits lead to from the iterate; None where that is nowhere.

        ``tolerance``: is enough, where a smaller one is asked for.
        """
        enough = max(tolerance, self.settings.tolerance)
        settings = replace(self.settings, max_iterations=iterations, tolerance=enough)
        return self.found_by(self._with(rows, settings), (self.x, self.u))

    def found_by(self, other: BarrierProblem, start: tuple[Array, Array]) -> OptimizationResult | None:
        """Return what another problem leads to from a start, without beginning again; None where that is nowhere."""
        try:
            other.start(start)
            found = Loop(other, other.settings).run()
        except LeastActionError:
            return None
        self.rollouts += found.rollouts
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return found

    def _put_out(self) -> None:
        """Take the limits out, to start elsewhere."""
        self.forget()
        self.duals.begun = False

    def _limits(self) -> Sided:
        """Return the values of all rows at the iterate, with the leeway of this stage."""
        if self.values is None:
            self.values = self.limited.limits(self.x, self.u)
        return self.values

    def _asked(self) -> Sided:
        """Return them as they are asked for."""
        return self.limited.asked(self.x, self.u) if self.duals.leeway.is_lent else self._limits()

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
        if self.is_open:
            return super().shown
        if self.plain_value is None:
            self.plain_value = self.cost.value(self.x, self.u)
        return self.plain_value

    @property
    def magnitude(self) -> float:
        """The cost without barriers: they are known up to a constant, and may be of either sign."""
        return self.shown

    def tolerated(self, goal: float) -> float:
        if self._begun:
            if self.central is None:
                self.central = self.duals.are_central(self._room())
            goal = self.stages.tolerated(goal, self.noise, self._limits(), central=self.central)
        return super().tolerated(goal)

    def next_stage(self, *, moved: bool = True) -> bool:
        """Go on without gaps, or with dearer excess, where a limit needs it, or else with a smaller barrier."""
        if self.is_open:
            more = super().next_stage(moved=moved)
            self._set_out()
            return more
        before, was_lent = self.duals.y.flat.copy(), self.duals.leeway.is_lent
        more = self.stages.advance(self.shown, self._limits(), moved=moved)
        if was_lent:
            self.values = None  # there may be less leeway
        self.room = None  # it is one of other prices, even where there is no more
        curvature = self.curvature if np.array_equal(before, self.duals.y.flat) else None
        if more:
            self._set_out()
            self.curvature = curvature  # of the same duals
        return more

    @property
    def is_unmet(self) -> bool:
        return not (self.is_open or self.stages.are_met(self._asked()))

    def relent(self) -> bool:
        """Make a stage again that led nowhere, otherwise; return whether there is another way.

        Without the leeway it was lent; else with all excess as dear, where limits are far off.
        """
        if self.duals.leeway.is_lent:
            self.duals.leeway.give_all_back()
            self.values = None
            self._set_out()
            return True
        if not self._begun or self.is_open:
            return False
        if not self.stages.look_for_the_least(self._limits()):
            return False
        self._set_out()
        return True

    @property
    def is_passing(self) -> bool:
        return self._begun and not (self.is_open or self.stages.is_near_end or self.duals.hopeless())

    @property
    def _may_end_at_a_saddle(self) -> bool:
        """Whether a saddle matters in this stage: in the last, and where obstacles grow."""
        return self.stages.is_last or self.duals.leeway.is_lent

    def _set_out(self) -> None:
        """Begin a stage: another cost, the same dynamics."""
        self.tells_saddles = self.system.has_curvature and self._may_end_at_a_saddle and not self.is_open
        self._forget_cost()
        self.room = None
        barrier = self.duals.barrier(self._room())
        if self.open_curve is not None:
            self._take(self.open_curve._replace(cost=self.shown + barrier))
        else:
            self.value = self.shown + barrier

    @property
    def tells_violence(self) -> bool:
        """Whether first steps that are cut short tell of a run that gets lost: not where barriers cut them."""
        return not self._begun

    def _go_to(self, place: Place) -> None:
        super()._go_to(place)
        self._begin()

    def verdict(self) -> tuple[Status, str] | None:
        """Return that limits contradict each other, or that only barriers which nobody asked for make a minimum."""
        if self.is_open:
            return None
        if not self.stages.are_met(self._asked()):
            return Status.INFEASIBLE, self.report().contradiction(self.system.when)
        return None if self._is_determined() else (Status.NO_DIRECTION, "")

    def _is_determined(self) -> bool:
        """Whether there is a minimum without the stiffness of limits that nobody asked for, where these are not active.

        It may be all that holds a number of which nothing tells.
        """
        far = [not rows.is_asked for rows in self.limited.rows]
        if not any(far):
            return True
        sigmas = self.duals.stiffnesses(self._room(), _SOFTER[-1])  # beside stiff ones weights are lost in rounding
        for i in np.flatnonzero(far).tolist():
            sigmas[i] = np.where(self._limits()[i] > _ACTIVE * self.duals.scale[i], 0.0, sigmas[i])
        hessian = self._weights(sigmas, 0.0)
        self.weighed = None  # they are written over
        spare = Workspace(self.system.N, self.system.ndx, self.system.nu)
        model = minimise_model("quasi-newton", self._linearize(), self._gradient(), hessian, None, spare)
        self._with_start(model, lambda: hessian)
        return not self.undetermined

    @property
    def unmet(self) -> str:
        if self.is_open or not self._begun or self.stages.are_met(self._asked()):
            return ""
        return f"Limits are still violated: {self.report().violated(self.system.when)}."

    # ---- Directions -----------------------------------------------------------------------------

    @property
    def _begun(self) -> bool:
        """Whether there are limits already: the start is projected without."""
        return self.duals.begun

    def _gradient(self) -> CostGradient:
        if not self._begun:
            return super()._gradient()
        if self.gradient is None:
            self.gradient = self._with_duals(self.duals.of_barrier(self._room()))
        return self.gradient

    def _hessian(self, share: float = 1.0) -> ModelHessian:
        if not self._begun:
            return super()._hessian(share)
        share = share if self._bends() else 1.0
        if self.weighed is None or self.weighed[0] != share:
            self.weighed = share, self._weights(self.duals.stiffnesses(self._room()), share)
        return self.weighed[1]

    def _weights(self, sigmas: Sided, share: float) -> ModelHessian:
        """Return the second derivatives of cost and limits, given the stiffnesses of these.

        With a share of what may bend downwards. Those of a share are written over those of others, but of the whole.
        """
        dynamics = None
        if any(rows.quantity.looks_ahead for rows in self.limited.rows):
            dynamics = np.concatenate(list(self._linearize()), axis=2)
        plain = self._of_cost(convex=share == 0.0)
        if 0.0 < share < 1.0:
            plain = between(self._of_cost(convex=True), plain, share)
        return self.limited.hessian(self.x, self.u, sigmas, self._jacobians(), dynamics, plain=plain, share=share)

    def _of_cost(self, *, convex: bool) -> ModelHessian:
        """Return the second derivatives of the cost alone."""
        if convex not in self.plain_bend:
            self.plain_bend[convex] = self.cost.model_hessian(self.x, self.u, convex=convex)
        return self.plain_bend[convex]

    def _bends(self) -> bool:
        """Whether second derivatives have a part that may bend downwards.

        Where they once had one they may have it again, which is not worth another look.
        """
        if self.has_bends is None:
            both_parts = self._of_cost(convex=True), self._of_cost(convex=False)
            self.has_bends = self.limited.bends(self.x, self.u, *both_parts)
        return self.has_bends

    def _with_duals(self, duals: Sided) -> CostGradient:
        """Return the first derivatives of the cost less the duals times the limits."""
        if self.plain is None:
            self.plain = super()._gradient()
        return self.limited.with_duals(self.plain, duals, self._jacobians())

    def forget(self) -> None:
        super().forget()
        self.values = self.plain_value = self.room = self.jacobians = self.plain = None
        self.has_bends = self.has_bends or None
        self.plain_bend = {}

    def _forget_cost(self) -> None:
        super()._forget_cost()
        self.gradient = self.newton_change = self.central = self.weighed = None
        self.are_settled = False

    def _curvature_along(self, gradient: CostGradient) -> Array:
        # The multipliers of the dynamics are those of the Lagrangian.
        return super()._curvature_along(self._with_duals(self.duals.y) if self._begun else gradient)

    def minimise_model(self, method: str, scale: float, shift: float = 0.0) -> LinearQuadraticSolution:
        """Solve the linear-quadratic problem of a method; see `DiscreteProblem`."""
        model = super().minimise_model(method, scale, shift)
        # In exact numbers a convex model has a minimum.
        is_lost = method == "quasi-newton" and not model.definite
        self.is_drowned = self._begun and (is_lost or model.smallest_eigenvalue > 0.0)
        if self.is_drowned:
            # Beside stiff limits the rest of the curvature is lost in rounding: this is no saddle.
            self.tells_saddles = False
        return model

    def left_beside_rounding(self) -> float:
        """Return a decrease that is no smaller than what is left, by Newton's model with softer limits.

        That lies below the model itself: it has a minimum only where this has one, and expects no less. Its linear part
        is that of the duals; those of the barriers are off by the rounding of the little room that is left.
        """
        if self.is_open or not (self._begun and self.has_curvature):
            return np.inf
        gradient = self._with_duals(self.duals.y)
        curvature = self._curvature_along(gradient)
        self.weighed = None  # they are written over
        for softness in _SOFTER:
            hessian = self._weights(self.duals.stiffnesses(self._room(), softness), 1.0)
            left = self._left_of(hessian, gradient, curvature)
            if left is not None:
                return left
        return np.inf

    def _left_of(self, hessian: ModelHessian, gradient: CostGradient, curvature: Array) -> float | None:
        """Return the decrease that Newton's model of some weights expects; None if it has no minimum."""
        with self.clock("lq"):
            model = minimise_model("newton", self._linearize(), gradient, hessian, curvature, self.free)
        model = self._with_start(model, lambda: hessian)
        if not model.definite:
            return None
        return -2.0 * least_of(model, self._start_step(model)) + self.duals.gap(self._room())

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        """Return the direction of a model that has a minimum, with what it changes of the limits."""
        plain = super().direction(method, model, scale, shift)
        if not self._begun:
            return plain
        change = self._change(plain)
        if method == "newton" and scale == 1.0 and shift == 0.0:
            self.newton_change = change
        return changed(plain, limited=change.flat)

    def _change(self, direction: DiscreteDirection) -> Sided:
        """Return how the limits' values change along a direction."""
        return self.limited.along(*self.motion(direction), self._jacobians())

    # ---- Steps ----------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go at first: no further than to where the barriers begin to rise."""
        length = super().first_step(direction, length)
        if direction.duals is not None:
            length = min(length, 1.0)  # further than its end the model rises
        if direction.limited is None or direction.duals is not None:
            return length
        if length <= 1.0 and np.isfinite(direction.reach):
            return min(length, direction.reach)
        dc = Sided(direction.limited, self.limited.layout)
        fall, least = direction.slope, 0.5 * direction.slope
        if direction.among is not None:
            fall, least = direction.among.fall, direction.among.least
        return self.duals.step(self._room(), dc, fall, least, length) if fall < 0.0 else length

    def _guide(self, x: Array, u: Array) -> float:
        """Return the barriers along a curve."""
        return self.duals.barrier(self.duals.room(self.limited.limits(x, u))) if self._begun else 0.0

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Any] | Refusal:
        if self.is_open:
            return super().simulate(direction, length, bound)
        outcome = super().simulate(direction, length, np.inf)
        if isinstance(outcome, Refusal):
            return outcome
        x, u, _ = outcome.iterate
        room = self.duals.room(self.limited.limits(x, u))
        total = outcome.cost + self.duals.barrier(room)
        if not total <= bound:
            reason = f"a cost with barriers of {total:.10g}, where at most {bound:.10g} was wanted"
            return self._look_for_leap(direction, length, x, Refusal(reason, cost=total))
        return Trial(LimitedIterate(outcome.iterate, outcome.cost, room), total)

    def refined(self, direction: DiscreteDirection, *, holds: bool) -> DiscreteDirection:
        """Return the direction to where its model is least, with the barriers themselves in place of their models."""
        if direction.limited is None or self.is_open:
            return direction
        if not holds:
            return promising(self.duals, self._room(), direction)
        far = -direction.slope > _FAR * abs(self.shown)
        return refined(self.duals, self._room(), direction, self.motion, self._solve_within, far=far)

    def _solve_within(self, direction: DiscreteDirection, duals: Sided, sigmas: Sided) -> SolvedWithin | None:
        """Return the minimum of a direction's model with other duals and stiffnesses; None if there is none.

        Its law stands where those of directions do.
        """
        method = direction.method.removesuffix("-shifted").removesuffix("-damped")
        hessian = self._hessian_within(direction.curvature_scale if method == "newton" else 0.0, sigmas)
        if direction.shift > 0.0:
            hessian = shifted(hessian, direction.shift)
        gradient, linearization = self._with_duals(duals), self._linearize()
        curvature = self.curvature if method == "newton" else None
        with self.clock("lq"):
            model = minimise_model(
                method, linearization, gradient, hessian, curvature, self.spare, direction.curvature_scale
            )
        model = self._with_start(model, lambda: hessian)
        if not model.definite:
            return None
        self.free, self.spare = self.spare, self.free
        own_gain = self._own_gain()
        if own_gain is None:
            self.feedback = None  # the next is written over it
        dx0 = self._start_step(model)
        dx, du = self._sweep(model, dx0)
        least = least_of(model, dx0)
        change = self.limited.along(dx, du, self._jacobians()).flat
        return SolvedWithin(least, dx, du, model.K if own_gain is None else own_gain, model.C, change)

    def _hessian_within(self, share: float, sigmas: Sided) -> ModelHessian:
        """Return second derivatives with other stiffnesses, which are written over those of the iterate."""
        self.weighed = None
        return self._weights(sigmas, share if self._bends() else 1.0)

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        if direction.limited is None or self.is_open:
            return super().promised(direction, length)
        return direction.promise if length == direction.reach else np.nan

    def accept(self, direction: DiscreteDirection, trial: Trial[Any]) -> None:
        """Make a trial the current iterate, and move the duals with it."""
        dc = self._change(direction) if direction.limited is None else Sided(direction.limited, self.limited.layout)
        new = trial.iterate
        if self.is_open:
            after = self.duals.room(self.limited.limits(new.x, new.u))
            self.duals.y = self.duals.moved(self._room(), dc, after)
            super().accept(direction, trial)
        else:
            after = new.room
            if direction.duals is None:
                self.duals.y = self.duals.moved(self._room(), dc, after)
            else:
                self.duals.y = self.duals.kept_near(direction.duals, after)
            super().accept(direction, Trial(new.iterate, trial.cost))
            self.plain_value = new.cost
        self.values, self.room = after.c, after

    def keep_feedback(self, direction: DiscreteDirection) -> None:
        super().keep_feedback(direction)
        self.are_settled = True

    # ---- What is told ---------------------------------------------------------------------------

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        return changed(super().result(summary), limits=self.report())

    def _duals(self) -> Sided:
        """Return the duals after a last step of theirs along Newton's direction, which the motion hardly needs."""
        duals, after = self.duals.y, self._room()
        if self.stages.is_last and not (self.is_open or self.are_settled):
            dc = self._last_change() if self.newton_change is None else self.newton_change
            if dc is not None:
                # They are those of where it leads to: near their bounds that is far from here in room.
                room, after = after, self.duals.room(Sided(after.c.flat + dc.flat, dc.layout))
                duals = self.duals.moved(room, dc, after)
        return self.duals.settled(duals, after)

    def _last_change(self) -> Sided | None:
        """Return the change of the limits along a direction that is not followed any more; None if there is none."""
        # Memory of its own: the feedback that is told may stand in that of the iteration.
        spare = Workspace(self.system.N, self.system.ndx, self.system.nu)
        try:
            method = "newton" if self.has_curvature else "quasi-newton"
            scale = 1.0 if self.has_curvature else 0.0
            model = self._with_start(self._solve(method, spare, scale), lambda: self._hessian(scale))
            if not model.definite:
                return None
            return self.limited.along(*self._sweep(model, self._start_step(model)), self._jacobians())
        except LeastActionError:
            return None  # The duals of the last step will do.

    def report(self) -> LimitReport:
        """Return what is told of the limits."""
        k = [rows.k for rows in self.limited.rows]
        if not self.is_open or self.earlier is None:
            return self.stages.report(k, self._asked(), self._duals(), self.shown)
        # Of the trajectory that is returned in the place of a curve with gaps.
        c = self.limited.asked(self.earlier.x, self.earlier.u)
        return self.stages.report(k, c, self.duals.settled(self.duals.y, self.duals.room(c)), self.shown)
