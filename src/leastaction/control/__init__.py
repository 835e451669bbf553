"""Control: regulators, estimators, predictive control, closed loops, and many runs at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily

if TYPE_CHECKING:
    from leastaction.control.bands import LoopBands, monte_carlo
    from leastaction.control.closed_loop import close_loop
    from leastaction.control.gains import SteadyGain, lqe, lqr
    from leastaction.control.kalman import Estimate, KalmanFilter
    from leastaction.control.many import ManyRuns, linearize_many, simulate_many
    from leastaction.control.moving_horizon import MovingHorizonEstimator
    from leastaction.control.predictive import MPC
    from leastaction.control.rigs.play import play
    from leastaction.control.simulation import simulate
    from leastaction.control.sweeps import Failed, optimize_many, sweep
    from leastaction.systems.closed_loop import ClosedLoop, PredictiveInfo
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.control.closed_loop": "close_loop",
            "leastaction.control.gains": "SteadyGain lqe lqr",
            "leastaction.control.kalman": "Estimate KalmanFilter",
            "leastaction.control.many": "ManyRuns linearize_many simulate_many",
            "leastaction.control.bands": "LoopBands monte_carlo",
            "leastaction.control.moving_horizon": "MovingHorizonEstimator",
            "leastaction.control.predictive": "MPC",
            "leastaction.control.rigs.play": "play",
            "leastaction.control.simulation": "simulate",
            "leastaction.control.sweeps": "Failed optimize_many sweep",
            "leastaction.systems.closed_loop": "ClosedLoop PredictiveInfo",
        },
    )

__all__ = [
    "MPC", "ClosedLoop", "Estimate", "Failed", "KalmanFilter", "LoopBands", "ManyRuns",
    "MovingHorizonEstimator", "PredictiveInfo", "SteadyGain", "close_loop", "linearize_many", "lqe", "lqr",
    "monte_carlo", "optimize_many", "play", "simulate", "simulate_many", "sweep",
]  # fmt: skip
