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

from leastaction.apps.marionette.tracking.limits import KINDS
from leastaction.apps.marionette.tracking.plan import Plan
from leastaction.apps.marionette.tracking.poses import at_rest
from leastaction.apps.marionette.tracking.problem import TrackingProblem
from leastaction.errors import ProjectionError
from leastaction.io.motion.motion import Motion
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult, Status, optimize

SIZES: Final = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of the way from the first pose to the wanted ones."""

_ITERATIONS: Final = 60
_ROUGHLY: Final = 0.02


def grown(
    plan: Plan,
    motion: Motion,
    say: Callable[[str], object],
    count: Callable[[OptimizationResult, bool], None],
) -> tuple[Array, Array]:
    """Return a trajectory of a plan that follows a motion, found by following ever larger parts of it.

    ``motion``: that of the plan. ``say``: told of every size. ``count``: told of every optimisation, and that no motors
    helped in it. Raises `KeyboardInterrupt` where Ctrl-C ends one.
    """
    found = plan.hung()
    if len(found[1]) < plan.system.N:
        found = at_rest(plan)
    for size in SIZES:
        part = plan if size == SIZES[-1] else smaller(plan, motion, size)
        try:
            result = optimize(
                part.system,
                part.cost(),
                initial=found,
                limits=part.limits.of(part.mechanism, part.problem.pelvis, KINDS),
                free_start=part.free_start,
                shooting="single",
                max_iterations=_ITERATIONS,
                tolerance=_ROUGHLY,
            )
        except ProjectionError:  # a larger one may be found from the last
            continue
        if result.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        count(result, False)
        found = result.x, result.u
        say(f"{100.0 * size:.0f} % of the motion: cost {result.cost:.4g}")
    return found


def smaller(plan: Plan, motion: Motion, size: float) -> Plan:
    """Return the plan of a motion that goes a part of the way from the first pose of another to each of its poses.

    ``plan``: that of the motion.
    """
    problem, first = plan.problem, motion.q[:1]
    part = replace(motion, q=np.asarray(first + size * (motion.q - first)))
    return Plan(
        TrackingProblem(problem.mechanism, part, problem.weights, problem.threads, problem.follow),
        plan.weights,
        plan.limits,
    )
