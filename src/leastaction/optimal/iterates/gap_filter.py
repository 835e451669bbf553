"""Whether a curve with gaps between its steps is worth leaving another for.

That is decided by a filter (A. Waechter and L. T. Biegler, On the implementation of an interior-point filter
line-search algorithm, 2006, without the barrier): a trial has to lower the cost or the sum of the gaps, against all
earlier curves. A penalty of the gaps alone would make very short steps: it refuses steps along a curved valley. It does
bound the cost of closing them, though: a step on which they hardly shrink, at a cost many times as high, diverges.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality

# Margins of the filter: the part by which gaps have to shrink, and the part of them by which the cost has to fall; the
# largest sum of gaps in times that at the start, and the part of it below which the cost alone may be looked at.
_SHRINK, _FALL = 1e-5, 1e-5
_MOST, _FEW = 1e4, 1e-4
# Largest rise of the cost in one step, in times the penalty of all gaps.
_DEAREST = 10.0

# Powers of what the cost may gain and of the gaps, which decide whether the cost alone is looked at; Armijo's fraction.
_COST_POWER, _GAP_POWER, _ARMIJO = 2.3, 1.1, 1e-4


class OpenCurve(NamedTuple):
    """States and inputs, where its steps lead to, the gaps, their sum and the largest in parts of the states' sizes.

    ``cost``: of the curve. ``worst_step``: its coarsest step. ``shown``: what it costs without what only guides the
    search. ``length``: of the step that led to it.
    """

    x: Array
    u: Array
    ends: Array
    gaps: Array
    theta: float
    gap: float
    cost: float
    worst_step: StepQuality | None
    shown: float
    length: float = 0.0


class Filter:
    """What no later curve may be worse than in both: sums of gaps, with costs.

    ``first``: the sum of gaps that it began with. ``pairs``: of the two.
    """

    def __init__(self, first: float, pairs: Sequence[tuple[float, float]] = ()) -> None:
        self.first = max(1.0, first)
        self.pairs = list(pairs)

    def takes(
        self, curve: OpenCurve, trial: OpenCurve, length: float, fall: float, noise: float, penalty: float
    ) -> bool:
        """Whether a trial may follow a curve, along which the cost has the derivative `fall`.

        ``penalty``: of a gap, with which the step is one of descent.
        """
        theta, cost = curve.theta, curve.cost
        cost_alone = theta <= _FEW * self.first and fall < 0.0 and length * (-fall) ** _COST_POWER > theta**_GAP_POWER
        if cost_alone:
            good = trial.cost <= cost + _ARMIJO * length * fall + noise
        else:
            good = trial.theta <= (1.0 - _SHRINK) * theta or trial.cost <= cost - _FALL * theta + noise
        good = good and trial.theta <= _MOST * self.first
        good = good and trial.cost <= cost + _DEAREST * penalty * theta + noise
        return good and not any(trial.theta > t and trial.cost > c + noise for t, c in self.pairs)

    def follow(self, old: OpenCurve, new: OpenCurve, fall: float, noise: float) -> None:
        """Remember a curve that was left for one of fewer gaps rather than for a lower cost."""
        if not (fall < 0.0 and new.cost <= old.cost + _ARMIJO * new.length * fall + noise):
            self.pairs.append(((1.0 - _SHRINK) * old.theta, old.cost - _FALL * old.theta))
