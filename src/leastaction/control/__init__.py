"""Control: regulators, estimators, predictive control, closed loops, and many runs at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily

if TYPE_CHECKING:
    from leastaction.control.gains import SteadyGain, lqe, lqr
    from leastaction.control.kalman import Estimate, KalmanFilter
    from leastaction.control.predictive import MPC, PredictiveInfo
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.control.gains": "SteadyGain lqe lqr",
            "leastaction.control.kalman": "Estimate KalmanFilter",
            "leastaction.control.predictive": "MPC PredictiveInfo",
        },
    )

__all__ = ["MPC", "Estimate", "KalmanFilter", "PredictiveInfo", "SteadyGain", "lqe", "lqr"]
