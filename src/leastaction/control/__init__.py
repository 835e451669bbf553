"""Control: regulators, estimators, predictive control, closed loops, and many runs at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily

if TYPE_CHECKING:
    from leastaction.control.gains import SteadyGain, lqe, lqr
    from leastaction.control.kalman import Estimate, KalmanFilter
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.control.gains": "SteadyGain lqe lqr",
            "leastaction.control.kalman": "Estimate KalmanFilter",
        },
    )

__all__ = ["Estimate", "KalmanFilter", "SteadyGain", "lqe", "lqr"]
