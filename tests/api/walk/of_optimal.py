"""Right calls of what is about costs, limits, systems and their optimisation."""

from __future__ import annotations

import io

import numpy as np

import leastaction as la
from api.walk.scenes import (
    TIMES,
    Q,
    V,
    arm,
    flow,
    flow_found,
    flow_price,
    followed,
    found,
    free_arm,
    guess,
    hung,
    hung_guess,
    hung_price,
    integrator,
    line,
    line_price,
    oscillator,
    oscillator_rate,
    price,
    steps,
    tied,
    tied_guess,
    tied_price,
)
from api.walk.values import Call
from leastaction import mechanics as mech
from leastaction import optimal, systems
from leastaction.optimal import continuous

A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.1]])
A_STEPS, B_STEPS = np.tile(A, (5, 1, 1)), np.tile(B, (5, 1, 1))


def height(x):
    return x[..., 1:2]


def limited(*limits: object, **options: object) -> object:
    """Run the system with limits, for those are read when they meet one."""
    return la.optimize(steps(), price(), initial=guess(), limits=list(limits), max_iterations=1, **options)


def calls() -> dict[str, Call]:
    """Return a callable and right arguments by name."""
    start = (np.array([0.5, 0.0]), np.zeros((5, 1)))
    iteration = {
        "method": "auto", "regulator": "descent", "shooting": "auto", "max_iterations": 1,
        "tolerance": 1e-6, "absolute_tolerance": 1e-14, "alpha": 1e-4, "beta": 0.5, "max_backtracks": 20, "chunk": 256,
        "without": (),
    }  # fmt: skip
    options = {**iteration, "collocate": False, "accuracy": None}
    solved = optimal.solve_linear_quadratic(A_STEPS, B_STEPS, Q=np.eye(2), R=np.eye(1))
    optimizer = optimal.Optimizer(line(), line_price(), max_iterations=1)
    optimizer.run(start)
    costs: dict[str, Call] = {
        "QuadraticCost": (
            la.QuadraticCost,
            {
                "x_wanted": np.zeros((6, 2)), "u_wanted": np.zeros((5, 1)), "Q": [1.0, 1.0], "R": [1.0],
                "Q_final": np.eye(2),
            },
        ),
        "QuadraticCost in optimize": (
            lambda **given: la.optimize(
                line(), la.QuadraticCost(**given), initial=start, max_iterations=1
            ),
            {
                "x_wanted": np.zeros((6, 2)), "u_wanted": np.zeros((5, 1)), "Q": [1.0, 1.0], "R": [1.0],
                "Q_final": np.eye(2),
            },
        ),
        "ContinuousQuadraticCost": (
            la.ContinuousQuadraticCost,
            {
                "x_wanted": [0.0, 0.0], "u_wanted": [0.0], "Q": [1.0, 1.0], "R": [1.0], "Q_final": [1.0, 1.0],
                "x_final": [0.0, 0.0], "jumps": (),
            },
        ),
        "ContinuousQuadraticCost in optimize": (
            lambda **given: la.optimize(
                flow(), la.ContinuousQuadraticCost(**given), initial=start_of_flow(), horizon=(0.0, 1.0),
                max_iterations=1,
            ),
            {
                "x_wanted": [0.0, 0.0], "u_wanted": [0.0], "Q": [1.0, 1.0], "R": [1.0], "Q_final": [1.0, 1.0],
                "x_final": [0.0, 0.0], "jumps": (),
            },
        ),
        "PlaceCost": (
            systems.PlaceCost,
            {"cost": price(), "system": steps(), "places": {"B": [0.0, 0.0, 1.0]}, "weights": {"B": 1.0}},
        ),
        "DistanceCost": (
            systems.DistanceCost,
            {"cost": price(), "system": steps(), "pairs": [("A", "B")], "distances": [1.0], "weights": [1.0]},
        ),
        "SmoothCost": (
            systems.SmoothCost, {"cost": tied_price(), "system": tied(), "accelerations": {"hook": 1.0}},
        ),
        "RateCost": (
            optimal.RateCost,
            {"cost": price(), "system": steps(), "rates": {"u": 1.0}, "before": [0.0]},
        ),
        "FunctionCost": (
            lambda **given: la.optimize(line(), optimal.FunctionCost(**given), initial=start, max_iterations=1),
            {
                "stage": lambda x, u, k: x[0] ** 2 + u[0] ** 2, "final": None, "derivatives": "complex-step",
                "final_derivatives": None, "nonnegative": False,
            },
        ),
        "OrientationCost": (
            systems.OrientationCost,
            {"cost": price(), "system": steps(), "orientations": {"B": np.eye(3)}, "weights": {"B": 1.0}},
        ),
        "Oriented": (
            lambda **given: limited(systems.Oriented(**given)),
            {"frame": "B", "rotation": np.eye(3), "within": 3.0, "at": "end"},
        ),
        "Pointing": (
            lambda **given: limited(systems.Pointing(**given)),
            {"frame": "B", "axis": (0.0, 0.0, 1.0), "towards": (0.0, 0.0, 1.0), "within": 3.0, "at": "end"},
        ),
        "PathBound": (
            lambda **given: limited(systems.PathBound(**given)),
            {"path": ["world", "B"], "min": 0.01, "max": 9.0, "at": "end", "name": "string"},
        ),
        "HelpedCost": (optimal.HelpedCost, {"cost": price(), "columns": np.array([0]), "price": np.array([2.0])}),
        "WindowCost": (optimal.WindowCost, {"cost": price(), "start": 1, "stop": 3, "N": 5, "nu": 1}),
        "WindowSystem": (optimal.WindowSystem, {"system": steps(), "start": 1, "stop": 3}),
        "cost_along": (
            optimal.cost_along,
            {
                "system": line(), "cost": line_price(), "initial": start, "method": "newton", "gamma": [0.0, 0.5],
                "horizon": None,
            },
        ),
    }  # fmt: skip
    limits: dict[str, Call] = {
        "Bound": (lambda **given: limited(la.Bound(**given)), {
            "names": "u", "min": -1.0, "max": 1.0, "of": "input", "at": None,
        }),
        "Equal": (lambda **given: limited(la.Equal(**given)), {
            "names": "a", "value": 0.3, "of": "state", "at": "end",
        }),
        "Within": (lambda **given: limited(la.Within(**given)), {
            "quantity": optimal.FunctionQuantity("height", height), "min": -5.0, "max": 5.0, "at": None,
        }),
        "Keep": (lambda **given: limited(systems.Keep(**given)), {
            "frame": "B", "inside": systems.Ball((0.0, 0.0, 0.0), 3.0), "outside": None, "point": (0.0, 0.0, 0.0),
            "origin": None, "at": None,
        }),
        "Periodic": (lambda **given: limited(optimal.Periodic(**given), free_start=True), {
            "names": ["a"], "offset": {"a": 0.1}, "modulo": {},
        }),
        "Ball": (lambda **given: limited(systems.Keep("B", inside=systems.Ball(**given))), {
            "center": (0.0, 0.0, 0.0), "radius": 3.0,
        }),
        "Box": (lambda **given: limited(systems.Keep("B", inside=systems.Box(**given))), {
            "low": (-5.0, -5.0, -5.0), "high": (5.0, 5.0, 5.0),
        }),
        "HalfSpace": (lambda **given: limited(systems.Keep("B", inside=systems.HalfSpace(**given))), {
            "normal": (0.0, 0.0, 1.0), "offset": -5.0,
        }),
        "FunctionQuantity": (lambda **given: limited(la.Within(optimal.FunctionQuantity(**given), max=5.0)), {
            "names": "height", "values": height, "of_state": True, "jacobian": None, "curvature": None,
            "indexed": False, "unit": "m",
        }),
        "Entries": (lambda **given: limited(la.Within(optimal.Entries(**given), max=5.0)), {
            "names": ["first"], "columns": [0], "of_state": True, "factors": 1.0, "kind": "state", "unit": "",
        }),
        "FinalTime": (optimal.FinalTime, {
            "min": 0.5, "max": 2.0, "guess": 1.0, "price": 1.0, "weight": 0.0, "wanted": None,
        }),
        "Parameter": (optimal.Parameter, {
            "name": "A.mass", "min": 0.5, "max": 2.0, "guess": 1.0, "price": 0.0, "weight": 0.1, "wanted": 1.0,
        }),
    }  # fmt: skip
    runs: dict[str, Call] = {
        "optimize": (
            la.optimize,
            {
                "system": line(), "cost": line_price(), "initial": start, "horizon": None, "resume": None,
                "limits": (), "free_start": False, "unknowns": (), "options": None, "callback": None, **iteration,
            },
        ),
        "optimize in continuous time": (
            la.optimize,
            {
                "system": flow(), "cost": flow_price(), "initial": start_of_flow(), "horizon": (0.0, 1.0),
                "resume": None, "limits": (), "free_start": False, "unknowns": (), "callback": None,
                "max_iterations": 1, "tolerance": 1e-6, "method": "auto", "collocate": False,
                "accuracy": optimal.Accuracy(),
            },
        ),
        "optimize_continuous": (
            la.optimize_continuous,
            {
                "system": flow(), "cost": flow_price(), "initial": start_of_flow(), "horizon": (0.0, 1.0),
                "max_iterations": 1,
            },
        ),
        "Optimizer": (
            optimal.Optimizer,
            {
                "system": line(), "cost": line_price(), "limits": (), "horizon": None, "free_start": False,
                "unknowns": (), "options": None, "max_iterations": 1,
            },
        ),
        "Optimizer.run": (optimizer.run, {"initial": start, "resume": None, "callback": None}),
        "Optimizer.run_once": (optimizer.run_once, {"initial": start, "resume": None, "callback": None}),
        "Optimizer.again": (optimizer.again, {"x0": start[0], "shift": 0, "cost": line_price(), "callback": None}),
        "Options": (optimal.Options, options),
        "Options.changed": (optimal.Options().changed, options),
        "Accuracy": (optimal.Accuracy, {"solver": "DOP853", "rtol": 1e-9, "atol": 1e-11, "max_steps": 1000}),
        "coarse_to_fine": (
            optimal.coarse_to_fine,
            {
                "build": build, "t": np.linspace(0.0, 0.4, 9), "initial": (guess()[0], np.zeros((8, 1))),
                "factors": (2, 1), "transfer": None, "resume": None, "callback": None, "max_iterations": 1,
            },
        ),
        "continuation": (
            optimal.continuation,
            {
                "solve": solve, "values": [1.0, 2.0], "scale": "linear", "name": "weight", "accept": None,
                "done": None, "note": None, "easy": 10, "least_step": 0.1, "max_stages": 3, "resume": None,
                "callback": None,
            },
        ),
        "receding_horizon": (
            optimal.receding_horizon,
            {
                "system": line(), "cost": line_price(), "initial": start, "window": 3, "keep": 1, "cost_of": None,
                "resume": None, "callback": None, "max_iterations": 1,
            },
        ),
        "controllability": (
            la.controllability,
            {"system": line(), "x": np.zeros((6, 2)), "u": np.zeros((5, 1)), "window": 2, "scale": None,
             "tolerance": 1e-9},
        ),
        "regulate": (
            la.regulate, {"A": A_STEPS, "B": B_STEPS, "Q": np.eye(2), "R": np.eye(1), "Q_final": np.eye(2)},
        ),
        "steady_state_regulator": (
            optimal.steady_state_regulator, {"A": A, "B": B, "Q": np.eye(2), "R": np.eye(1), "S": None, "dt": 0.1},
        ),
        "regulate_continuous": (
            la.regulate_continuous,
            {
                "A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]], "horizon": (0.0, 1.0), "Q": np.eye(2),
                "R": np.eye(1), "Q_final": np.eye(2), "jumps": (), "accuracy": None,
            },
        ),
        "solve_linear_quadratic": (
            optimal.solve_linear_quadratic,
            {
                "A": A_STEPS, "B": B_STEPS, "Q": np.eye(2), "R": np.eye(1), "S": None, "H": None, "H_scale": 1.0,
                "q": None, "r": None, "c": None, "Q_final": np.eye(2), "q_final": None, "regularize": "none",
                "use_structure": True, "pattern": None, "keep_P": False,
            },
        ),
        "solve_continuous_linear_quadratic": (
            optimal.solve_continuous_linear_quadratic,
            {
                "A": A, "B": B, "horizon": (0.0, 1.0), "Q": np.eye(2), "R": np.eye(1), "S": None, "q": None,
                "r": None, "c": None, "Q_final": None, "q_final": None, "jumps": (), "accuracy": None,
            },
        ),
        "sweep_forward": (
            optimal.sweep_forward,
            {"A": A_STEPS, "B": B_STEPS, "solution": solved, "dx0": None, "c": None, "pattern": None},
        ),
        "adjoint": (
            optimal.adjoint,
            {
                "A": A_STEPS, "B": B_STEPS, "K": np.zeros((5, 1, 2)), "q": np.zeros((5, 2)), "r": np.zeros((5, 1)),
                "q_final": np.zeros(2), "pattern": None,
            },
        ),
        "resample": (
            optimal.resample,
            {"x": np.zeros((6, 2)), "u": np.zeros((5, 1)), "t": TIMES, "times": [0.0, 0.01]},
        ),
        "optimal.check_derivatives": (
            optimal.check_derivatives,
            {
                "system": line(), "x": np.zeros((6, 2)), "u": np.zeros((5, 1)), "cost": line_price(),
                "tolerance": 1e-6, "seed": 0,
            },
        ),
    }  # fmt: skip
    made: dict[str, Call] = {
        "Vectors": (optimal.Vectors, {"n": 3}),
        "ProductSpace": (lambda first: optimal.ProductSpace(first), {"first": optimal.Vectors(2)}),
        "LinearSystem": (optimal.LinearSystem, {"A": A, "B": B, "c": [0.0, 0.0], "N": 5}),
        "LinearContinuousSystem": (optimal.LinearContinuousSystem, {"A": A, "B": B, "c": [0.0, 0.0]}),
        "FunctionSystem": (
            lambda **given: la.optimize(
                optimal.FunctionSystem(**given), line_price(), initial=start, max_iterations=1
            ),
            {"f": oscillator, "nx": 2, "nu": 1, "N": 5, "derivatives": "complex-step", "curvature": None},
        ),
        "FunctionContinuousSystem": (
            lambda **given: la.optimize(
                continuous.FunctionContinuousSystem(**given), flow_price(), initial=start_of_flow(),
                horizon=(0.0, 1.0), max_iterations=1,
            ),
            {
                "f": oscillator_rate, "nx": 2, "nu": 1, "derivatives": "complex-step", "curvature": None, "jumps": (),
            },
        ),
        "PiecewisePolynomial": (
            optimal.PiecewisePolynomial,
            {"breaks": np.array([0.0, 1.0]), "coefficients": np.zeros((1, 2, 1)), "shape": (1,)},
        ),
        "PiecewisePolynomial.constant": (
            optimal.PiecewisePolynomial.constant, {"value": [1.0], "t0": 0.0, "tf": 1.0},
        ),
        "PiecewisePolynomial.through": (
            optimal.PiecewisePolynomial.through, {"t": TIMES, "values": np.zeros((6, 2)), "kind": "cubic"},
        ),
        "PiecewisePolynomial.__call__": (
            optimal.PiecewisePolynomial.through(TIMES, np.zeros((6, 2))).__call__, {"t": 0.01},
        ),
        "PiecewisePolynomial.derivative": (
            optimal.PiecewisePolynomial.through(TIMES, np.zeros((6, 2))).derivative, {"order": 1},
        ),
        "DenseTrajectory.from_functions": (
            optimal.DenseTrajectory.from_functions,
            {"x": [0.0, 0.0], "u": [0.0], "horizon": (0.0, 1.0), "nx": 2, "nu": 1, "tolerance": 1e-6},
        ),
        "DenseTrajectory.from_samples": (
            optimal.DenseTrajectory.from_samples,
            {"t": TIMES, "x": np.zeros((6, 2)), "u": np.zeros((6, 1)), "kind": "cubic"},
        ),
        "DenseTrajectory.sample": (flow_found().dense.sample, {"t": [0.0, 0.5]}),
        "ProjectionOperator": (optimal.ProjectionOperator, {"system": line(), "K": np.zeros((5, 1, 2))}),
        "ProjectionOperator.__call__": (
            optimal.ProjectionOperator(line(), np.zeros((5, 1, 2))).__call__,
            {"xbar": np.zeros((6, 2)), "ubar": np.zeros((5, 1))},
        ),
        "ContinuousProjection": (
            optimal.ContinuousProjection,
            {"system": flow(), "K": flow_found().feedback, "accuracy": None, "jumps": ()},
        ),
        "ContinuousProjection.__call__": (
            optimal.ContinuousProjection(flow(), flow_found().feedback).__call__,
            {"curve": flow_found().dense, "cost": flow_price(), "x0": np.array([0.5, 0.0])},
        ),
        "IterationTable": (la.IterationTable, {"file": io.StringIO(), "then": None}),
        "StageTable": (optimal.StageTable, {"file": io.StringIO(), "then": None}),
        "OptimizationResult.__getitem__": (found().__getitem__, {"name": "a"}),
        "ContinuousOptimizationResult.__getitem__": (flow_found().__getitem__, {"name": "x[0]"}),
        "LimitReport.__getitem__": (found().limits.__getitem__, {"label": "u <= max"}),
        "LimitReport.active": (found().limits.active, {"label": found().limits.sides[0].labels[0]}),
        "LimitReport.dual": (found().limits.dual, {"label": found().limits.sides[0].labels[0]}),
    }  # fmt: skip
    made["LimitReport.__getitem__"][1]["label"] = found().limits.sides[0].labels[0]
    bridges: dict[str, Call] = {
        "MidpointSystem": (la.MidpointSystem, {"integrator": integrator(), "t": TIMES, "multipliers": False}),
        "MidpointSystem.trajectory": (steps().trajectory, {"x": found().x, "u": found().u}),
        "MidpointSystem.states_along": (
            steps().states_along, {"q": np.zeros((6, 2)), "p": np.zeros((6, 2)), "v_rho": None},
        ),
        "MidpointSystem.with_parameters": (steps().with_parameters, {"values": {"A.mass": 1.0}}),
        "MidpointSystem.quantity": (steps().quantity, {"kind": "input"}),
        "MechanismSystem": (la.MechanismSystem, {"dynamics": free_arm()}),
        "MechanismSystem.quantity": (la.MechanismSystem(free_arm()).quantity, {"kind": "input"}),
        "PulledSystem": (systems.PulledSystem, {"integrator": integrator(), "t": TIMES, "at_instants": ["u"]}),
        "Rig": (
            la.Rig,
            {
                "spread": 0.05, "factors": {"A.mass": 1.1}, "stiffness": 2000.0, "smoothing": 0.001, "noise": 0.001,
                "delay": 0.02, "substeps": 2, "seed": 0,
            },
        ),
        "Rig.machine": (la.Rig().machine, {"mechanism": arm()}),
        "Rig.model": (la.Rig().model, {"mechanism": arm()}),
        "Feedback": (
            lambda **given: integrator().simulate(integrator().start(Q), TIMES, inputs=mech.Feedback(**given)),
            {"K": np.ones((1, 4)), "xbar": np.zeros(4), "ubar": np.zeros(1)},
        ),
        "Feedback.__call__": (
            mech.Feedback(np.ones((1, 4)), np.zeros(4), np.zeros(1)).__call__, {"t": 0.0, "x": np.zeros(4)},
        ),
        "play": (
            la.play,
            {
                "system": steps(), "plan": found(), "rig": la.Rig(delay=0.0, substeps=1), "Q": None, "R": None,
                "start": None, "feedback": True,
            },
        ),
        "follow": (
            la.follow,
            {
                "mechanism": free_arm(), "motion": {"a": 0.3 + TIMES}, "weights": {"a": 10.0}, "limits": (),
                "t": TIMES, "start": None, "resume": None, "max_iterations": 1, "tolerance": 1e-3, "threads": 1,
                "progress": None,
            },
        ),
        "Followed.__getitem__": (followed().__getitem__, {"name": "a"}),
        "embed": (
            systems.embed,
            {
                "system": steps(), "cost": price(), "initial": guess(), "help": None, "scale": None, "price": 1.0,
                "tolerance": 1e-3, "stage_iterations": 1, "stage_tolerance": 0.01, "max_stages": 1, "resume": None,
                "callback": None, "max_iterations": 1,
            },
        ),
        "relax": (
            systems.relax,
            {
                "system": tied(), "cost": tied_price(), "initial": tied_guess(), "constraints": ["bar"],
                "stiffness": (10.0, 100.0), "tolerance": 1e-3, "stage_iterations": 1, "stage_tolerance": 1e-3,
                "max_stages": 1, "callback": None, "max_iterations": 1,
            },
        ),
        "by_tensions": (
            systems.by_tensions,
            {
                "system": hung(), "cost": hung_price(), "initial": hung_guess(), "price": 1e-4, "least": None,
                "stage_iterations": 1, "stage_tolerance": 1e-3, "callback": None, "max_iterations": 1,
            },
        ),
        "warm_start": (
            la.warm_start,
            {"found": found(), "from_system": steps(), "to_system": steps(), "start": None, "rename": None},
        ),
        "check_derivatives": (
            la.check_derivatives,
            {"what": steps(), "at": found().x, "arguments": found().u, "tolerance": 1e-5},
        ),
        "PrescribedMotion.through": (
            mech.PrescribedMotion.through, {"t": np.arange(8.0), "rho": np.arange(8.0)[:, None] ** 2, "degree": 5},
        ),
        "PrescribedMotion": (
            mech.PrescribedMotion,
            {"value": lambda t: [t], "velocity": lambda t: [1.0], "acceleration": lambda t: [0.0]},
        ),
        "PrescribedMotion.from_spline": (
            mech.PrescribedMotion.from_spline, {"spline": optimal.PiecewisePolynomial.through(TIMES, TIMES[:, None])},
        ),
        "MidpointSystem.f": (steps().f, {"x": np.array([*Q, *V]), "u": np.zeros(1), "k": 0}),
        "MidpointSystem.linearize": (steps().linearize, {"x": found().x, "u": found().u}),
    }  # fmt: skip
    bridges["check_derivatives"] = (
        lambda what, at, u, tolerance: la.check_derivatives(what, at, u, tolerance=tolerance),
        {"what": steps(), "at": found().x, "u": found().u, "tolerance": 1e-5},
    )
    return {**costs, **limits, **runs, **made, **bridges}


def start_of_flow():
    return [0.5, 0.0], np.zeros(1)


def build(t):
    system = la.MidpointSystem(integrator(), t)
    cost = la.QuadraticCost(np.zeros((system.N + 1, 4)), np.zeros((system.N, 1)), Q=np.ones(4), R=np.eye(1))
    return system, cost


def solve(value, previous):
    return la.optimize(line(), line_price(), initial=(np.array([0.5, 0.0]), np.zeros((5, 1))), max_iterations=1)
