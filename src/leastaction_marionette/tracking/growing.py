"""A first trajectory from a motion that grows.

Where motors lead to no motion that strings make, a smaller one is followed first: a part of the way from the first pose
to each wanted one. A puppet that hangs still is near the smallest, and each size begins where the last one ended. All
limits hold from the first iterate on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.numerics import Array
from leastaction.optimal import OptimizationResult
from leastaction_marionette.tracking.attempts import attempted
from leastaction_marionette.tracking.limits import KINDS
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import at_rest

SIZES: Final = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of the way from the first pose to the wanted ones."""

_ITERATIONS: Final = 60
_ROUGHLY: Final = 0.02


def grown(
    plan: TrackingPlan,
    coarse: TrackingPlan,
    motion: Motion,
    say: Callable[[str], object],
    count: Callable[[OptimizationResult, float], None],
) -> tuple[Array, Array]:
    """Return a trajectory of a plan that follows a motion, found by following ever larger parts of it.

    ``coarse``: the same plan with longer steps, or itself; ``motion``: that of the coarse one, which is taken for all
    but the last. ``say``: told of every size. ``count``: told of every optimisation, and by which its costs are those
    of the plan. Raises `KeyboardInterrupt` where Ctrl-C ends one. The trajectory is shorter where there is none.
    """
    try:
        found = at_rest(coarse)
    except ArgumentError:
        found = coarse.hung()
        if len(found[1]) < coarse.system.N:
            return found
    scale = plan.system.N / coarse.system.N
    for size in SIZES:
        part = coarse if size == SIZES[-1] else smaller(coarse, motion, size)
        found = _followed(part, found, say, lambda result: count(result, scale), size)
    if plan is coarse:
        return found
    fine = plan.inside(*plan.finer(coarse, *found), coarse.cost().value(*found) * scale)
    return _followed(plan, fine, say, lambda result: count(result, 1.0), SIZES[-1])


def _followed(
    plan: TrackingPlan,
    start: tuple[Array, Array],
    say: Callable[[str], object],
    count: Callable[[OptimizationResult], None],
    size: float,
) -> tuple[Array, Array]:
    """Return what one optimisation finds; the start where it finds nothing."""
    result = attempted(plan, start, KINDS, shooting="single", max_iterations=_ITERATIONS, tolerance=_ROUGHLY)
    if result is None:  # a larger part may be found from the last
        return start
    count(result)
    say(f"{100.0 * size:.0f} % of the motion: cost {result.cost:.4g}")
    return result.x, result.u


def smaller(plan: TrackingPlan, motion: Motion, size: float) -> TrackingPlan:
    """Return the plan of a motion that goes a part of the way from the first pose of another to each of its poses.

    ``plan``: that of the motion.
    """
    first = motion.q[:1]
    return plan.following(replace(motion, q=np.asarray(first + size * (motion.q - first))))
