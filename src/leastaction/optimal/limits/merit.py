"""The cost of a problem with limits, and their barriers: what a search among them minimises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import changed
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import ModelHessian, between
from leastaction.optimal.iterates.direction import DiscreteDirection, Iterate
from leastaction.optimal.iterates.here import Here
from leastaction.optimal.iterates.merit import AlongIterate, Merit
from leastaction.optimal.iterates.models import Models
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.cost import Jacobians, LimitedCost
from leastaction.optimal.limits.duals import Room
from leastaction.optimal.limits.refinement import SolvedWithin, promising, refined
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.limits.stages import BarrierStages
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import along_parabola
from leastaction.optimal.state import Place

_FAR = 5.0  # expected decrease of a step that is far from the minimum, in costs
_SOFTER = (1e-2, 1e-4, 1e-6, 1e-8)  # parts of the largest stiffness that models know where rounding drowns the whole
_ACTIVE = 1e-6  # most room of a limit that is active, in its scale


class BarrierMerit(Merit):
    """A cost with the elastic barriers of limits, whose duals move along with the iterate.

    ``duals``, ``stages``: those of the limits. ``newton_change``: of the limits, along Newton's undamped direction;
    None if that is not known. ``are_settled``: whether no step of the duals is needed any more.
    """

    has_barriers = True

    def __init__(self, limited: LimitedCost, stages: BarrierStages, here: Here) -> None:
        self.cost, self.limited, self.duals, self.stages, self.here = limited.cost, limited, limited.duals, stages, here
        # Of the iterate; None: not yet.
        self._values: Sided | None = None
        self._cost: float | None = None
        self._jacobians: Jacobians | None = None
        self._plain: CostGradient | None = None  # of the cost alone
        self._plain_bend: dict[bool, ModelHessian] = {}  # of the cost alone, the convex part and the whole
        self._has_bends: bool | None = None  # whether these differ, or limits bend
        self._room: Room | None = None
        # Of the iterate and of the duals; None: not yet.
        self._gradient: CostGradient | None = None  # with the barriers
        self._weighed: tuple[float, ModelHessian] | None = None  # second derivatives, with a share of what bends
        self._enough: tuple[float, float, float] | None = None  # goal, noise, and the decrease that is small enough
        self.newton_change: Sided | None = None
        self.are_settled = False

    def forget(self) -> None:
        self._values = self._cost = self._jacobians = self._plain = self._room = None
        # Where they once had a part that bends they may have it again, which is not worth another look.
        self._has_bends = self._has_bends or None
        self._plain_bend = {}
        self._forget_duals()

    def forget_stage(self) -> None:
        self._room = None
        self._forget_duals()

    def replaced(self, cost: Cost) -> None:
        """Have another cost from now on."""
        self.cost, self.limited.cost, self._has_bends = cost, cost, None
        self.forget()

    def note_cost(self, cost: float) -> None:
        """Take the cost alone of the trajectory where it stands as known."""
        self._cost = cost

    def lend(self, curves: Sequence[tuple[Array, Array]]) -> None:
        """Lend leeway to the obstacles that are on some curves (x, u)."""
        leeway = self.duals.leeway
        was_lent = leeway.is_lent
        leeway.lend(self.limited.rows, curves)
        if was_lent or leeway.is_lent:
            self.forget_leeway()

    def forget_leeway(self) -> None:
        """Drop the values of the limits: they may have been lent other leeway."""
        self._values = self._enough = None

    def forget_room(self) -> None:
        """Drop the room that they leave: prices may be others."""
        self._room = self._enough = None

    def _forget_duals(self) -> None:
        self._gradient = self._weighed = self._enough = self.newton_change = None
        self.are_settled = False

    # ---- Values -----------------------------------------------------------------------------------

    def plain_value(self) -> float:
        if self.here.curve is not None:
            return self.here.curve.shown
        if self._cost is None:
            self._cost = self.cost.value(self.here.x, self.here.u)
        return self._cost

    def magnitude(self) -> float:
        # Barriers are known up to a constant, and may be of either sign.
        return self.plain_value()

    def guide(self, x: Array, u: Array) -> float:
        return self.duals.room(self.limited.limits(x, u)).at.value

    def value(self) -> float:
        """Return the cost with the barriers, at the iterate."""
        return self.plain_value() + self.room().at.value

    def limits(self) -> Sided:
        """Return the values of all rows at the iterate, with the leeway of this stage."""
        if self._values is None:
            self._values = self.limited.limits(self.here.x, self.here.u)
        return self._values

    def asked(self) -> Sided:
        """Return them as they are asked for."""
        return self.limited.asked(self.here.x, self.here.u) if self.duals.leeway.is_lent else self.limits()

    def room(self) -> Room:
        """Return the room of all rows at the iterate."""
        if self._room is None:
            self._room = self.duals.room(self.limits())
        return self._room

    @property
    def are_met(self) -> bool:
        """Whether all limits are met at the iterate, as they are asked for."""
        return self.stages.are_met(self.asked())

    def tolerated(self, goal: float) -> float:
        """Return the expected decrease that is small enough at this stage, given what is so at the end."""
        noise, known = self.here.noise, self._enough
        if known is None or known[0] != goal or known[1] != noise:
            self._enough = known = goal, noise, self.stages.tolerated(goal, noise, self.room())
        return known[2]

    # ---- Derivatives ------------------------------------------------------------------------------

    def gradient(self) -> CostGradient:
        if self._gradient is None:
            self._gradient = self.with_duals(self.duals.of_barrier(self.room()))
        return self._gradient

    def lagrangian_gradient(self) -> CostGradient:
        return self.with_duals(self.duals.y)

    def with_duals(self, duals: Sided) -> CostGradient:
        """Return the first derivatives of the cost less the duals times the limits."""
        if self._plain is None:
            self._plain = self.cost.gradient(self.here.x, self.here.u)
        return self.limited.with_duals(self._plain, duals, self.jacobians())

    def jacobians(self) -> Jacobians:
        """Return the derivatives of the limits, of those that are no entries."""
        if self._jacobians is None:
            self._jacobians = self.limited.jacobians(self.here.x, self.here.u)
        return self._jacobians

    def hessian(self, share: float, along: AlongIterate) -> ModelHessian:
        known = self._weighed
        if known is None or (known[0] != share and self._bends()):
            self._weighed = known = share, self._weights(self.duals.stiffnesses(self.room()), share, along)
        return known[1]

    def hessian_with(self, sigmas: Sided, share: float, along: AlongIterate) -> ModelHessian:
        """Return second derivatives with other stiffnesses, which are written over those of the iterate."""
        self._weighed = None
        return self._weights(sigmas, share, along)

    def _weights(self, sigmas: Sided, share: float, along: AlongIterate) -> ModelHessian:
        """Return the second derivatives of cost and limits, given the stiffnesses of these.

        With a share of what may bend downwards. Those of a share are written over those of others, but of the whole.
        """
        dynamics = np.concatenate(list(along.linearize()), axis=2) if self.limited.looks_ahead else None
        plain = self._of_cost(convex=share == 0.0)
        if 0.0 < share < 1.0:
            plain = between(self._of_cost(convex=True), plain, share)
        here = self.here
        return self.limited.hessian(here.x, here.u, sigmas, self.jacobians(), dynamics, plain=plain, share=share)

    def _of_cost(self, *, convex: bool) -> ModelHessian:
        """Return the second derivatives of the cost alone."""
        if convex not in self._plain_bend:
            self._plain_bend[convex] = self.cost.model_hessian(self.here.x, self.here.u, convex=convex)
        return self._plain_bend[convex]

    def _bends(self) -> bool:
        """Whether second derivatives have a part that may bend downwards."""
        if self._has_bends is None:
            both_parts = self._of_cost(convex=True), self._of_cost(convex=False)
            self._has_bends = self.limited.bends(self.here.x, self.here.u, *both_parts)
        return self._has_bends

    # ---- Directions -------------------------------------------------------------------------------

    def followed(self, direction: DiscreteDirection, along: AlongIterate) -> DiscreteDirection:
        whole = direction.method == "newton" and direction.curvature_scale == 1.0 and direction.shift == 0.0
        if not (whole and self.stages.is_last):
            return direction
        self.newton_change = change = self.change(along.motion(direction))
        return changed(direction, limited=change.flat)

    def change(self, motion: tuple[Array, Array]) -> Sided:
        """Return how the limits' values change along a motion."""
        return self.limited.along(*motion, self.jacobians())

    def refined(self, direction: DiscreteDirection, along: AlongIterate, *, holds: bool) -> DiscreteDirection:
        """Return the direction to where its model is least, with the barriers themselves in place of their models."""
        if direction.bend < 0.0:
            return direction
        if direction.limited is None:
            direction = changed(direction, limited=self.change(along.motion(direction)).flat)
        if self.here.is_open:
            return direction
        if not holds:
            return promising(self.duals, self.room(), direction)

        def solve(direction: DiscreteDirection, duals: Sided, sigmas: Sided) -> SolvedWithin | None:
            return self._solved(direction, duals, sigmas, along)

        far = -direction.slope > _FAR * abs(self.plain_value())
        return refined(self.duals, self.room(), direction, along.motion, solve, far=far)

    def _solved(
        self, direction: DiscreteDirection, duals: Sided, sigmas: Sided, along: AlongIterate
    ) -> SolvedWithin | None:
        """Return the minimum of a direction's model with other duals and stiffnesses; None if there is none."""
        share = direction.curvature_scale if direction.method.startswith("newton") else 0.0
        hessian = self.hessian_with(sigmas, share, along)
        found = along.solved_with(direction, self.with_duals(duals), hessian)
        return None if found is None else SolvedWithin(found, self.change((found.dx, found.du)).flat)

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go at first: no further than to where the barriers begin to rise."""
        if direction.duals is not None:
            return min(length, 1.0)  # further than its end the model rises
        if direction.limited is None:
            return length
        if length <= 1.0 and isfinite(direction.reach):
            return min(length, direction.reach)
        dc = Sided(direction.limited, self.limited.layout)
        fall, least = direction.slope, 0.5 * direction.slope
        if direction.among is not None:
            fall, least = direction.among.fall, direction.among.least
        return self.duals.step(self.room(), dc, fall, least, length) if fall < 0.0 else length

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        if direction.limited is None:
            return along_parabola(direction, length)
        return direction.promise if length == direction.reach else np.nan

    # ---- Steps ------------------------------------------------------------------------------------

    def bound(self, bound: float) -> float:  # noqa: ARG002 - barriers may be of either sign
        return np.inf

    def judged(
        self, trial: Trial[Iterate], bound: float, explain: Callable[[Array, Refusal], Refusal]
    ) -> Trial[Iterate] | Refusal:
        found, cost = trial
        room = self.duals.room(self.limited.limits(found.x, found.u))
        total = cost + room.at.value
        if not total <= bound:
            reason = f"a cost with barriers of {total:.10g}, where at most {bound:.10g} was wanted"
            return explain(found.x, Refusal(reason, cost=total))
        return Trial(Iterate(found.x, found.u, found.worst_step, cost, room), total)

    def move(self, direction: DiscreteDirection, to: Iterate, along: AlongIterate) -> None:
        """Move the duals with the iterate."""
        after = self.duals.room(self.limited.limits(to.x, to.u)) if to.room is None else to.room
        if direction.duals is not None:
            self.duals.y = self.duals.kept_near(direction.duals, after)
        else:
            dc = direction.limited
            change = self.change(along.motion(direction)) if dc is None else Sided(dc, self.limited.layout)
            self.duals.y = self.duals.moved(self.room(), change, after)
        self.forget()
        self._values, self._room = after.c, after
        self._cost = None if to.curve is not None else to.cost

    # ---- The end ----------------------------------------------------------------------------------

    def settle(self) -> None:
        self.are_settled = True

    def remaining_decrease(self, along: AlongIterate) -> float:
        """Return a decrease that is no smaller than what is left, by Newton's model with softer limits.

        That lies below the model itself: it has a minimum only where this has one, and expects no less. Its linear part
        is that of the duals; those of the barriers are off by the rounding of the little room that is left.
        """
        gradient = self.lagrangian_gradient()
        for softness in _SOFTER:
            hessian = self.hessian_with(self.duals.stiffnesses(self.room(), softness), 1.0, along)
            left = along.left_of(gradient, hessian)
            if left is not None:
                return left + self.duals.gap(self.room())
        return np.inf

    def is_determined(self, models: Models) -> bool:
        """Whether there is a minimum without the stiffness of limits that nobody asked for, where these are not active.

        It may be all that holds a number of which nothing tells.
        """
        far = [not rows.is_asked for rows in self.limited.rows]
        if not any(far):
            return True
        sigmas = self.duals.stiffnesses(self.room(), _SOFTER[-1])  # beside stiff ones weights are lost in rounding
        for i in np.flatnonzero(far).tolist():
            sigmas[i] = np.where(self.limits()[i] > _ACTIVE * self.duals.scale[i], 0.0, sigmas[i])
        return models.tells_of_all(self.hessian_with(sigmas, 0.0, models))

    def report(self, models: Models, *, newton: bool, at: Place | None = None) -> LimitReport:
        """Return what is told of the limits; ``at``: of the trajectory that is returned in the place of the iterate.

        ``newton``: whether Newton's method is available, for a last step of the duals.
        """
        k = self.limited.instants
        if at is None:
            return self.stages.report(k, self.asked(), self._last_duals(models, newton=newton), self.plain_value())
        c = self.limited.asked(at.x, at.u)
        return self.stages.report(k, c, self.duals.settled(self.duals.y, self.duals.room(c)), self.plain_value())

    def _last_duals(self, models: Models, *, newton: bool) -> Sided:
        """Return the duals after a last step of theirs along Newton's direction, which the motion hardly needs."""
        duals, after = self.duals.y, self.room()
        if self.stages.is_last and not (self.here.is_open or self.are_settled):
            dc = self.newton_change
            if dc is None:
                try:
                    motion = models.last_motion(newton=newton)
                    dc = None if motion is None else self.change(motion)
                except LeastActionError:
                    dc = None  # The duals of the last step will do.
            if dc is not None:
                # They are those of where it leads to: near their bounds that is far from here in room.
                room, end = after, dc.layout.empty()
                np.add(room.c.flat, dc.flat, out=end.flat)
                after = self.duals.room(end)
                duals = self.duals.moved(room, dc, after)
        return self.duals.settled(duals, after)
