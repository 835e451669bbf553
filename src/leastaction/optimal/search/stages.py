"""The stages of a discrete problem: gaps that close, inputs that get less dear, barriers that fall."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.pool import empty
from leastaction.optimal.iterates.curve import LONGEST_WITH_GAPS
from leastaction.optimal.limits.sides import some
from leastaction.optimal.loop import Stages
from leastaction.optimal.result import Status
from leastaction.optimal.search.beginning import Beginning
from leastaction.optimal.search.parts import SearchParts

# Eased stages: factor by which inputs are less dear from one to the next; part of the cost that is left to be gained
# where one but the last is over, and its most iterations.
_STRIDE, _LOOSE, _LONGEST = 10.0, 1e-2, 20


class DiscreteStages(Stages):
    """What is so in the stage that a problem is in.

    Gaps are closed in the first, whose barriers are the softest. Only a problem without limits has dearer inputs.
    """

    def __init__(self, parts: SearchParts, beginning: Beginning) -> None:
        self.parts, self.beginning = parts, beginning

    @property
    def patience(self) -> int:
        # Steps may close gaps in place of lowering the cost.
        return 1 if self.parts.curve is None else LONGEST_WITH_GAPS

    @property
    def longest(self) -> int | None:
        curve = self.parts.curve
        if curve is not None:
            return curve.longest_stage
        return None if self.parts.ease == 1.0 else _LONGEST

    @property
    def is_passing(self) -> bool:
        limits = self.parts.limits
        return limits is not None and not (self.is_open or limits.stages.is_near_end or limits.duals.hopeless())

    @property
    def is_open(self) -> bool:
        return self.parts.here.is_open

    @property
    def violates_limits(self) -> bool:
        limits = self.parts.limits
        return not (limits is None or self.is_open or limits.are_met)

    @property
    def remark(self) -> str:
        ease = self.parts.ease
        return "" if ease == 1.0 else f"inputs are {ease:.4g} times as dear as asked for"

    @property
    def unfinished(self) -> str:
        curve, ease = self.parts.curve, self.parts.ease
        if curve is not None:
            before = self.beginning.begun.earlier
            return curve.unfinished(
                "no trajectory yet" if before is None else "the trajectory that it had come to before them"
            )
        if ease == 1.0:
            return ""
        return (
            f"It had begun again, and inputs are still {ease:.4g} times as dear as asked for: the iterations did "
            "not suffice for all stages."
        )

    @property
    def violated(self) -> str:
        if not self.violates_limits:
            return ""
        return f"Limits are still violated: {self.parts.report().violated(self.parts.system.when)}."

    def tolerated(self, goal: float) -> float:
        parts = self.parts
        if parts.limits is not None:
            goal = parts.limits.tolerated(goal)
        if parts.curve is not None:
            goal = parts.curve.tolerated(goal)
        elif parts.ease != 1.0:
            goal = max(goal, _LOOSE * abs(parts.here.value))
        return parts.grid.tolerated(goal, parts.here)

    def loosen(self) -> bool:
        """Make a stage again that led nowhere, otherwise; return whether there is another way.

        Without the leeway it was lent; else with all excess as dear, where limits are far off.
        """
        parts, limits = self.parts, self.parts.limits
        if limits is None:
            return False
        if limits.duals.leeway.is_lent:
            limits.duals.leeway.give_all_back()
            limits.forget_leeway()
        elif self.is_open or not limits.stages.look_for_the_least(limits.limits()):
            return False
        parts.set_out()
        return True

    def verdict(self) -> tuple[Status, str] | None:
        """Return that limits contradict each other, or that only barriers which nobody asked for make a minimum."""
        parts, limits = self.parts, self.parts.limits
        if limits is None or self.is_open:
            return None
        if not limits.are_met:
            return Status.INFEASIBLE, parts.report().contradiction(parts.system.when)
        return None if limits.is_determined(parts.models) else (Status.NO_DIRECTION, "")

    def advance(self, *, moved: bool) -> bool:
        """Go on from the minimum of a stage to the next, and return whether there is one.

        Without gaps; with inputs that are less dear; with dearer excess, where a limit needs it, or else with a smaller
        barrier.
        """
        parts, limits = self.parts, self.parts.limits
        if self.is_open:
            return self.beginning.leave_gaps()
        if parts.ease != 1.0:
            parts.ease_off(_STRIDE)
            return True
        if limits is None:
            return False
        models, before = parts.models, limits.duals.y.flat
        was_lent = limits.duals.leeway.is_lent
        more = limits.stages.advance(limits.plain_value(), limits.limits(), moved=moved)
        if was_lent:
            limits.forget_leeway()  # there may be less of it
        after = limits.duals.y.flat
        limits.forget_room()  # it is one of other prices, even where there is no more
        if more:
            are_others = some(np.not_equal(before, after, out=empty(after.shape, np.bool_)))
            curvature = None if are_others else models.curvature
            parts.set_out()
            models.curvature = curvature  # of the same duals
        return more
