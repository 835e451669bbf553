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

__all__ = [
    "MPC", "ClosedLoop", "Estimate", "Failed", "KalmanFilter", "LoopBands", "ManyRuns",
    "MovingHorizonEstimator", "PredictiveInfo", "SteadyGain", "close_loop", "linearize_many", "lqe", "lqr",
    "monte_carlo", "optimize_many", "play", "simulate", "simulate_many", "sweep",
]  # fmt: skip
