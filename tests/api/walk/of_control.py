"""Right calls of what controls, estimates and runs many motions at once."""

from __future__ import annotations

import numpy as np

import leastaction as la
from api.walk.of_data import fields_of
from api.walk.scenes import TIMES, Q, flow_price, integrator, line, line_price, price, steps
from api.walk.values import Call
from leastaction import control, costs
from leastaction.control import monte_carlo

A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.1]])


def calls() -> dict[str, Call]:
    """Return a callable and right arguments by name."""
    x0 = integrator().start(Q).x
    kalman = {
        "system": line(), "measure": np.eye(2), "noise": [0.1, 0.1], "process": [0.1, 0.1], "x": [0.0, 0.0],
        "spread": 1.0, "kind": "extended",
    }  # fmt: skip
    t = np.arange(6.0)
    mpc = control.MPC(line(), line_price(), horizon=3)
    looped = control.close_loop(line(), lambda t, x: [0.0], [0.5, 0.0], t)
    many = control.simulate_many(integrator(), np.array([x0, x0]), TIMES, threads=1)
    estimate = control.KalmanFilter(**kalman).run(np.zeros((6, 2)), np.zeros((5, 1)))
    loop = {
        "plant": line(), "controller": lambda t, x: [0.0], "x": [0.5, 0.0], "t": t, "measure": None, "noise": 0.0,
        "delay": 0.0, "estimator": None, "disturbance": None, "substeps": 1, "seed": 0,
    }  # fmt: skip
    mpc(0.0, np.array([0.5, 0.0]))
    made = [looped, many, estimate, mpc.info, control.Failed("it failed")]
    return {
        "MPC": (
            control.MPC,
            {
                "system": steps(), "cost": price(), "limits": (la.Bound("u", -1.0, 1.0),), "horizon": 3,
                "iterations": 1, "budget": None, "tolerance": 1e-4,
            },
        ),
        "MPC.__call__": (mpc.__call__, {"t": 0.0, "x": np.array([0.5, 0.0])}),
        "MPC.prepare": (control.MPC(line(), line_price(), horizon=3).prepare, {"x": [0.5, 0.0], "t": 0.0, "u": None}),
        "KalmanFilter": (control.KalmanFilter, kalman),
        "KalmanFilter.predict": (control.KalmanFilter(**kalman).predict, {"u": [0.0]}),
        "KalmanFilter.correct": (control.KalmanFilter(**kalman).correct, {"y": [0.0, 0.0]}),
        "KalmanFilter.run": (control.KalmanFilter(**kalman).run, {"y": np.zeros((6, 2)), "u": np.zeros((5, 1))}),
        "close_loop": (control.close_loop, loop),
        "monte_carlo": (
            monte_carlo,
            {
                "run": lambda rng: control.close_loop(line(), lambda t, x: [0.0], [0.5, 0.0], t), "runs": 1, "seed": 0,
                "progress": None,
            },
        ),
        "CostSum": (costs.CostSum, {"costs": [line_price(), line_price()]}),
        "ContinuousCostSum": (costs.ContinuousCostSum, {"costs": [flow_price(), flow_price()]}),
        "ContinuousPlaceCost": (
            costs.ContinuousPlaceCost,
            {
                "system": la.MechanismSystem(steps().mechanism), "places": {"B": [0.0, 0.0, 0.0]},
                "weights": {"B": 1.0},
            },
        ),
        "ContinuousOrientationCost": (
            costs.ContinuousOrientationCost,
            {
                "system": la.MechanismSystem(steps().mechanism), "orientations": {"B": np.eye(3)},
                "weights": {"B": 1.0},
            },
        ),
        "GaussNewton": (
            lambda **given: la.optimize(
                line(), costs.GaussNewton(**given), initial=([0.5, 0.0], np.zeros((5, 1))), max_iterations=1
            ),
            {"residual": lambda x, u, k: [x[0], u[0]], "final": lambda x: [x[0]], "derivatives": "complex-step"},
        ),
        "ContinuousFunctionCost": (
            costs.ContinuousFunctionCost,
            {
                "rate": lambda x, u, t: x[0] ** 2 + u[0] ** 2, "final": None, "derivatives": "complex-step",
                "final_derivatives": None, "nonnegative": True, "jumps": (),
            },
        ),
        "ContinuousGaussNewton": (
            costs.ContinuousGaussNewton,
            {"residual": lambda x, u, t: [x[0], u[0]], "final": None, "derivatives": "complex-step", "jumps": ()},
        ),
        "tracking": (
            costs.tracking,
            {
                "system": steps(), "weights": {"a": 1.0}, "wanted": None, "effort": 0.1, "inputs": None,
                "final": None, "during": None,
            },
        ),
        "tracking in continuous time": (
            costs.tracking,
            {
                "system": la.MechanismSystem(steps().mechanism), "weights": {"a": 1.0}, "wanted": {"a": 0.5},
                "effort": 0.1, "inputs": None, "final": {"*": 1.0}, "during": (0.1, 0.2),
            },
        ),
        "MovingHorizonEstimator": (
            control.MovingHorizonEstimator,
            {
                "system": line(), "measure": np.eye(2), "noise": [0.1, 0.1], "process": [0.1, 0.1], "x": [0.0, 0.0],
                "spread": 1.0, "horizon": 3, "limits": (),
            },
        ),
        "lqr": (control.lqr, {"A": A, "B": B, "Q": [1.0, 1.0], "R": [1.0], "dt": 0.1, "S": None}),
        "lqe": (control.lqe, {"A": A, "C": np.eye(2), "W": np.eye(2), "V": np.eye(2), "dt": 0.1}),
        "simulate_many": (
            control.simulate_many,
            {
                "integrator": integrator(), "x0": np.array([x0, x0]), "t": TIMES, "inputs": None, "parameters": None,
                "threads": 1,
            },
        ),
        "linearize_many": (
            control.linearize_many,
            {"integrator": integrator(), "t": TIMES, "x": many.x, "u": many.u, "threads": 1},
        ),
        "optimize_many": (
            control.optimize_many,
            {
                "system": line(), "cost": line_price(), "starts": [([0.5, 0.0], np.zeros((5, 1)))], "workers": 1,
                "keep": None, "progress": None, "max_iterations": 1,
            },
        ),
        "sweep": (
            control.sweep, {"task": float, "values": [1.0, 2.0], "workers": 1, "keep": None, "progress": None},
        ),
        **{type(each).__name__: (type(each), fields_of(each)) for each in made},
    }  # fmt: skip
