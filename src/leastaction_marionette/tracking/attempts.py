"""One optimisation of a plan on the way to a first trajectory, which may come to nothing."""

from __future__ import annotations

from collections.abc import Collection

from leastaction.errors import ProjectionError
from leastaction.numerics import Array
from leastaction.optimal import Callback, Method, OptimizationResult, Shooting, Status
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.stage import optimize


def attempted(
    plan: TrackingPlan,
    start: tuple[Array, Array],
    kinds: Collection[str],
    *,
    shooting: Shooting,
    max_iterations: int,
    tolerance: float,
    method: Method = "auto",
    callback: Callback | None = None,
) -> OptimizationResult | None:
    """Return what `optimize` finds from a curve; None where that cannot be projected.

    ``kinds``: of the limits that are stated; the rest is as of `optimize`. Raises `KeyboardInterrupt` where Ctrl-C ends
    it.
    """
    try:
        result = optimize(
            plan.system,
            plan.cost(),
            initial=start,
            limits=plan.limits.of(plan.mechanism, plan.problem.pelvis, kinds),
            free_start=plan.free_start,
            shooting=shooting,
            method=method,
            max_iterations=max_iterations,
            tolerance=tolerance,
            callback=callback,
        )
    except ProjectionError:
        return None
    if result.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return result
