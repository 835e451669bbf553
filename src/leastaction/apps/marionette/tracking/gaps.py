"""A curve that feedback can follow, from one that it cannot: gaps between its steps are closed by the optimiser.

What was found part by part, or with longer steps, is a trajectory but for little. Where limbs swing freely or strings
lose their grip, a roll-out that begins at the start is thrown off it by that. With gaps every step begins where the
curve is (multiple shooting).
"""

from __future__ import annotations

from typing import Final

from leastaction.apps.marionette.tracking.tracker import Curve, Tracker
from leastaction.errors import ProjectionError
from leastaction.optimal import Status, optimize

_ITERATIONS: Final = 150
_ROUGHLY: Final = 1e-2  # tolerance
_NEARLY: Final = 1e-3  # of the states' sizes are the gaps of a curve that feedback can follow


def closed(tracker: Tracker, curve: Curve) -> Curve:
    """Return a curve near another, which follows the tracker's motion and whose steps nearly meet.

    The other itself where its steps cannot be made. Raises `KeyboardInterrupt` where Ctrl-C ends the search.
    """
    plan = tracker.plan
    assert plan is not None
    try:
        result = optimize(
            plan.system,
            plan.cost(),
            initial=curve,
            limits=tracker.limits.of(plan.mechanism, tracker.problem.pelvis, tracker.kinds),
            free_start=plan.free_start,
            shooting="multiple",
            method=tracker.method,
            max_iterations=_ITERATIONS,
            tolerance=_ROUGHLY,
            callback=lambda record: record.gap < _NEARLY,
        )
    except ProjectionError:
        return curve
    if result.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    tracker.spend(result, None)
    return result.x, result.u
