"""A curve that feedback can follow, from one that it cannot: gaps between its steps are closed by the optimiser.

What was found part by part, or with longer steps, is a trajectory but for little. Where limbs swing freely or strings
lose their grip, a roll-out that begins at the start is thrown off it by that. With gaps every step begins where the
curve is (multiple shooting).
"""

from __future__ import annotations

from typing import Final

from leastaction_marionette.tracking.attempts import attempted
from leastaction_marionette.tracking.tracker import Curve, Tracker

_ITERATIONS: Final = 150
_ROUGHLY: Final = 1e-2  # tolerance
_NEARLY: Final = 1e-3  # of the states' sizes are the gaps of a curve that feedback can follow


def closed(tracker: Tracker, curve: Curve) -> Curve:
    """Return a curve near another, which follows the tracker's motion and whose steps nearly meet.

    The other itself where its steps cannot be made. Raises `KeyboardInterrupt` where Ctrl-C ends the search.
    """
    assert tracker.plan is not None
    result = attempted(
        tracker.plan,
        curve,
        tracker.kinds,
        shooting="multiple",
        max_iterations=_ITERATIONS,
        tolerance=_ROUGHLY,
        method=tracker.method,
        callback=lambda record: record.gap < _NEARLY,
    )
    if result is None:
        return curve
    tracker.spend(result, None)
    return result.x, result.u
