"""The state of the choice of a direction: which method is tried when, and with which part of the curvature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.numerics.frozen import changed

# Least and largest factor by which the part of the curvature grows after a good step, and the factor of its recovery.
_LEAST_GROWTH, _LARGEST_GROWTH, _RECOVERY = 1.1, 2.0, 1.03

# Ratios of an expected decrease to the last one below which a run converges: of any decrease, and of one that is less
# than the third number, times the cost.
_ARRIVING = 0.1, 0.5, 1e-3

# Shift below which there is none, and share of the curvature below which less is tried only after more failed.
_LEAST_SHIFT, _LEAST_SCALE = 1e-8, 1.0 / 64.0

# Ratio of the best length of a step to its length above which the next may be longer than a full one, by at most that
# ratio; and the largest length.
_FURTHER, _FURTHEST = 4.0, 8.0


@dataclass(frozen=True)
class NewtonSchedule:
    """The state of the choice of a direction, from one iteration to the next.

    The automatic choice begins with quasi-Newton, whose model holds far from the minimum too, and stays with it while
    it predicts the decrease of the cost. Then it tries Newton's method; while that fails, it waits for ever more
    iterations until it tries again.

    Attributes
    ----------
    wait : int
        Iterations to go until Newton's method is tried.
    failures : int
        How often it failed since it last worked.
    scale : float
        The part of the curvature that is tried first.
    growth : float
        Factor by which that part grows after a step that went well. Every model that turns out to have no
        minimum costs time, so it is the smaller the more often that happened.
    shift : float
        What is added to the weights of every deviation where nothing else lowers the cost
        (Levenberg-Marquardt); 0 while that is not needed.
    expected : float
        Expected decrease of the last step; NaN before the first.
    length : float
        Length of the last step.
    full : bool
        Whether that was a full step, by a model without a shift.
    reach : float
        Where the cost was seen to fall much further than to the end of the last step, how long the next one may be
        if it is of the same method; else 0.
    holds : bool
        Whether the last step lowered the cost by what its model had predicted, or the run begins at a minimum.
    method : str
        That of the last step.
    spent : int
        Iterations in this stage.
    wary : bool
        Whether a model of Newton's had no minimum though little was left to be gained: the end may be a saddle.
    """

    wait: int = 1
    failures: int = 0
    scale: float = 1.0
    growth: float = 2.0
    shift: float = 0.0
    expected: float = np.nan
    length: float = 1.0
    full: bool = False
    reach: float = 0.0
    holds: bool = False
    method: str = ""
    spent: int = 0
    wary: bool = False

    def after_failure(self) -> NewtonSchedule:
        """Return the schedule after a Newton direction that could not be followed."""
        # One more than the wait, for the iteration that is still to be made by another method.
        wait = min(2**self.failures, 8) + 1
        scale = max(self.scale, _LEAST_SCALE)
        return changed(self, wait=wait, failures=self.failures + 1, scale=scale)

    def after_indefinite(self, scale: float, *, wary: bool = False) -> NewtonSchedule:
        """Return the schedule after a Newton model that had no minimum; this part is tried next."""
        return changed(self, scale=scale, growth=max(self.growth**0.5, _LEAST_GROWTH), wary=wary or self.wary)

    def after_step(
        self,
        method: str,
        curvature_scale: float,
        length: float,
        agreement: float,
        expected: float,
        value: float,
        *,
        held: bool = False,
        free: bool = False,
    ) -> NewtonSchedule:
        """Return the schedule after an accepted step.

        ``method``: whose direction it followed. ``curvature_scale``: the part of the dynamics' curvature in its model.
        ``length``: its length. ``agreement``: decrease of the cost, relative to the decrease of the model over its full
        step. ``expected``, ``value``: expected decrease, and the cost. ``held``: whether it lowered the cost by what
        its model had predicted. ``free``: whether its length says nothing of the next.
        """
        shift = self.shift * (0.1 if length == 1.0 else 1.0)
        new: dict[str, Any] = {
            "shift": 0.0 if shift < _LEAST_SHIFT else shift,
            "expected": expected,
            "length": 1.0 if free else length,
            "full": length == 1.0 and method in ("newton", "newton-damped", "quasi-newton"),
            # Of an exact model it would be noise.
            "reach": _reach(length, agreement) if method == "newton-damped" else 0.0,
            "method": method,
            "holds": held,
            "spent": self.spent + 1,
        }
        if method == "negative-curvature":
            new |= {"shift": 0.0, "length": 1.0}
        elif curvature_scale > 0.0:
            fast, falling, little = _ARRIVING
            part = falling if expected < little * abs(value) else fast
            arriving = expected < part * self.expected
            new |= {
                "wait": 0,
                "failures": 0,
                "scale": 1.0 if arriving else min(1.0, self.growth * curvature_scale),
                "growth": min(_LARGEST_GROWTH, self.growth * _RECOVERY),
            }
        else:
            # A quasi-Newton model that is off by a share s of the true curvature is off by s in the
            # decrease too, and the expected decrease falls by s^2 with every step: good enough if s < 0.1. Short steps
            # are predicted by any model.
            new["wait"] = max(self.wait - 1, 1 if abs(agreement - 1.0) < 0.1 and self.shift == 0.0 else 0)
        return changed(self, **new)


def _reach(length: float, agreement: float) -> float:
    """Return how long a step should have been, if that is much more than it was; else 0."""
    # The parabola through the cost before, its slope, and the cost after.
    bend = (2.0 * length - agreement) / length**2
    best = 1.0 / max(bend, 1e-3)
    return min(best, _FURTHER * length, _FURTHEST) if best > _FURTHER else 0.0
