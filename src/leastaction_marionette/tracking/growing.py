"""A first trajectory from a motion that grows.

Where no motion that strings make is near to what motors lead to, a smaller one is followed first: a part of the way
from the first pose to each wanted one. A puppet that hangs still is near the smallest, and each size begins where the
last one ended (`leastaction.starts.continuation`). All limits hold from the first iterate on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.optimal import OptimizationResult, StartResult, StartStatus, continuation
from leastaction_marionette.tracking.limits import KINDS
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import at_rest
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.turns import on_the_way

SIZES: Final = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of the way from the first pose to the wanted ones."""

_ITERATIONS: Final = 60  # of each size
_ROUGHLY: Final = 0.02  # tolerance of each size
_LEAST_STEP: Final = 0.25  # share of the way between two sizes, with which the search ends


def grown(plan: TrackingPlan, motion: Motion, say: Callable[[str], object]) -> StartResult:
    """Return what following ever larger parts of a motion leads to; ``plan``: that of the motion.

    Raises `KeyboardInterrupt` where Ctrl-C ends it, `ProjectionError` where not even the smallest can be followed.
    """
    try:
        start = at_rest(plan)
    except ArgumentError:
        start = plan.hung()

    def solve(size: float, earlier: OptimizationResult | None) -> OptimizationResult:
        part = plan if size == SIZES[-1] else smaller(plan, motion, size)
        return optimize(
            part.system,
            part.cost(),
            initial=start if earlier is None else (earlier.x, earlier.u),
            limits=part.limits.of(part.mechanism, part.problem.pelvis, KINDS),
            free_start=part.mechanism.coordinates,
            shooting="single",
            max_iterations=_ITERATIONS,
            tolerance=_ROUGHLY,
        )

    found = continuation(
        solve,
        SIZES,
        name="size",
        accept=lambda _: True,
        easy=0,
        least_step=_LEAST_STEP,
        callback=lambda record: say(f"{100.0 * record.value:.0f} % of the motion: cost {record.cost:.4g}") and False,
    )
    if found.status is StartStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return found


def smaller(plan: TrackingPlan, motion: Motion, size: float) -> TrackingPlan:
    """Return the plan of a motion that goes a part of the way from the first pose of another to each of its poses."""
    return plan.following(replace(motion, q=on_the_way(motion.names, motion.q[0], motion.q, size)))
