"""A first trajectory of a long motion, found part by part.

A search over a minute is as weak as its weakest place: a step that is too long anywhere is too long for all of it. So
parts of it are followed one by one, each as if it were the motion, and overlap. There two of them are the same motion,
but for some tenths of a second near the end of the one and the start of the other: what is a second ahead, or ago,
hardly matters. In the middle of that one passes over into the other. What is joined is no trajectory by little. Limbs
that swing freely, as most do on few strings, remember what was longer ago than that: what follows the curve by feedback
is thrown off it. So gaps stay between its steps until the optimiser has closed them (multiple shooting), and a few
iterations over all of the motion lead to the minimum.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, ProjectionError
from leastaction.numerics import Array, smooth_rise
from leastaction_marionette.tracking.found import CUT_SHORT, TrackingSearch
from leastaction_marionette.tracking.motors import with_motors
from leastaction_marionette.tracking.plan import Curve
from leastaction_marionette.tracking.tracker import Checkpoints, Tracker, improved
from leastaction_marionette.turns import unit

LONG: Final = 30.0
"""Seconds from which on a motion is followed part by part."""

_PART: Final = 15.0  # s, about the length of a part
_OVERLAP: Final = 3.0  # s, for which two are the same; in the middle third one passes over into the other
_ITERATIONS: Final = 150  # of the last optimisation of a part


def parts_of(t: Array) -> list[tuple[int, int]]:
    """Return the first and last instants of the parts of a motion with these times; one if it is not long."""
    dt, steps = float(t[1] - t[0]), len(t) - 1
    if steps * dt < LONG:
        return [(0, steps)]
    overlap = max(3, round(_OVERLAP / dt))
    count = int(np.ceil((steps - overlap) / max(1, round((_PART - _OVERLAP) / dt))))
    starts = [round(i * (steps - overlap) / count) for i in range(count + 1)]
    return [(start, after + overlap) for start, after in pairwise(starts)]


def found_in_parts(tracker: Tracker, begun: TrackingSearch | None) -> Tracker | None:
    """Return a tracker that starts from a curve which is nearly a trajectory; None where it is followed as a whole.

    So it is if the motion is short, or where a part leads nowhere. ``begun``: a search that was cut short after some
    parts. Raises `KeyboardInterrupt` where Ctrl-C ends one.
    """
    parts, t = parts_of(tracker.motion.t), tracker.motion.t
    if len(parts) < 2:
        return None
    found = None if begun is None else (begun.result.x, begun.result.u)
    for number, (start, stop) in enumerate(parts, start=1):
        if found is not None and len(found[1]) >= stop:
            continue
        tracker.say(f"part {number} of {len(parts)}, from {t[start]:.4g} to {t[stop]:.4g} s:")
        motion = replace(tracker.motion, t=t[start : stop + 1] - t[start], q=tracker.motion.q[start : stop + 1])
        part = replace(
            tracker,
            motion=motion,
            callback=None,
            kept=Checkpoints(None, np.inf),
            left=_ITERATIONS,
        )
        try:
            part, result = improved(with_motors(part.planned()))
        except (ArgumentError, ProjectionError) as error:
            tracker.say(f"it cannot be followed by itself: {error}")
            return None
        if result.status in CUT_SHORT:
            raise KeyboardInterrupt
        tracker = replace(tracker, effort=replace(part.effort, first_cost=tracker.effort.first_cost))
        x, u = (result.x, result.u) if found is None else joined(found, (result.x, result.u), start)
        found = unit(tracker.plan.mechanism.coordinates, x), u
        none = np.zeros((len(u), u.shape[1], tracker.plan.system.ndx))
        done = replace(result, x=found[0], u=u, K=none, projection_gain=none, limits=None, state=None)
        tracker.kept(partial(replace, tracker.as_search(done, counted=True), parts=True), at_once=True)
    assert found is not None
    tracker.say("the parts are joined")
    return replace(tracker, start=found, shooting="multiple")


def joined(before: Curve, after: Curve, start: int) -> Curve:
    """Return two curves as one, of which the second begins at instant ``start`` of the first, before that ends."""
    (x, u), (x_after, u_after) = before, after
    overlap = len(u) - start
    share = smooth_rise(3.0 * np.arange(overlap + 1) / overlap - 1.0)[:, None]

    def passed_over(one: Array, other: Array) -> Array:
        there = one[start:]
        n = len(there)
        return np.concatenate([one[:start], there + share[:n] * (other[:n] - there), other[n:]])

    return passed_over(x, x_after), passed_over(u, u_after)
