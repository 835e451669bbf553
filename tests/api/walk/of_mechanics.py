"""Right calls of what is about mechanisms, their elements and their runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import leastaction as la
from api.walk.scenes import Q, Square, V, arm, continuous, free_arm, held, integrator, run
from api.walk.values import Call
from leastaction import mechanics as mech
from leastaction.mechanics import expressions as ex


def calls() -> dict[str, Call]:
    """Return a callable and right arguments by name."""
    m, vi, arm2 = free_arm(), integrator(), arm()
    start, dynamics = vi.start(Q), mech.ContinuousDynamics(m)
    tape = mech.TapeMeasure(m, ["world", "B"])
    curve = mech.Curve([0.0, 1.0, 2.0], [0.0, 1.0, 3.0])
    q3 = held()
    of_mechanism = {
        f"Mechanism.{name}": (getattr(m, name), arguments)
        for name, arguments in {
            "configuration": {"values": {"a": 0.1}, "default": 0.0},
            "positions": {"q": Q, "names": ["A"]},
            "frame_pose": {"q": Q, "name": "B", "inverse": False},
            "frame_velocity": {"q": Q, "v": V, "frame": "B", "point": [0.0, 0.0, 0.1], "axes": "frame"},
            "frame_jacobian": {"q": Q, "frame": "B", "point": [0.0, 0.0, 0.1], "axes": "world"},
            "frame_jacobian_derivative": {"q": Q, "frame": "B", "order": 1},
            "frame_pose_derivative": {"q": Q, "frame": "B", "order": 1, "inverse": False},
            "energy": {"q": Q, "v": V},
            "momentum": {"q": Q, "v": V},
            "total_momentum": {"q": Q, "v": V},
            "mass_matrix": {"q": Q},
            "center_of_mass": {"q": Q},
            "lagrangian": {"q": Q, "v": V},
            "potential": {"q": Q, "element": "gravity"},
            "force": {"q": Q, "v": V, "u": [1.0], "element": None},
            "with_parameters": {"values": {"A.mass": 2.0}, "allow_nonphysical": False},
        }.items()
    }
    of_constraints = {
        f"Mechanism.{name}": (getattr(arm2, name), {"q": q3})
        for name in (
            "constraint_values",
            "constraint_residuals",
            "constraint_jacobian",
            "constraint_rank",
            "redundancy",
        )
    }
    of_steps = {
        "MidpointVI.start": (vi.start, {"q": Q, "v": V, "p": None, "t": 0.0}),
        "MidpointVI.start_from_configurations": (
            vi.start_from_configurations,
            {"q0": Q, "q1": Q, "dt": 0.01, "inputs": [0.0], "t": 0.0},
        ),
        "MidpointVI.step": (vi.step, {"state": start, "dt": 0.01, "inputs": [0.0], "rho_next": None}),
        "MidpointVI.simulate": (
            vi.simulate,
            {"start": start, "t": [0.0, 0.01], "inputs": [0.0], "rho": None, "law_at": "start"},
        ),
        "MidpointVI.discrete_lagrangian": (vi.discrete_lagrangian, {"q1": Q, "q2": Q, "dt": 0.01}),
        "MidpointVI.balance": (vi.balance, {"trajectory": run()}),
        "MidpointVI.driving_force": (vi.driving_force, {"trajectory": run()}),
        "Trajectory.velocity": (run().velocity, {"name": "a"}),
        "Trajectory.__getitem__": (run().__getitem__, {"name": "a"}),
        "TapeMeasure.length": (tape.length, {"q": Q}),
        "TapeMeasure.rate": (tape.rate, {"q": Q, "v": V}),
        "Curve.__call__": (curve.__call__, {"x": 0.5, "derivative": 1}),
    }
    functions: dict[str, Call] = {
        "MidpointVI": (
            la.MidpointVI,
            {
                "mechanism": m,
                "split": "left",
                "tolerance": 1e-12,
                "max_iterations": 20,
                "threads": 1,
                "at_instants": (),
            },
        ),
        "ContinuousDynamics": (mech.ContinuousDynamics, {"mechanism": m}),
        "TapeMeasure": (mech.TapeMeasure, {"mechanism": m, "frames": ["world", "B"]}),
        "project_configuration": (
            mech.project_configuration,
            {
                "mechanism": arm2, "q": q3, "hold": ["a"], "move_kinematic": False, "weights": None,
                "tolerance": 1e-12, "max_iterations": 50, "attempts": 2,
            },
        ),
        "project_velocity": (
            mech.project_velocity,
            {"mechanism": arm2, "q": q3, "v": np.zeros(3), "hold": (), "move_kinematic": False, "tolerance": 1e-10},
        ),
        "check_consistent": (mech.check_consistent, {"mechanism": arm2, "q": q3, "tolerance": 1e-8}),
        "configuration_by": (
            mech.configuration_by, {"mechanism": arm2, "q": q3, "names": ["bar.length"], "hold": ["a"]},
        ),
        "equilibrium": (
            mech.equilibrium,
            {
                "mechanism": arm2, "q_guess": q3, "hold": (), "inputs": [0.0], "kind": "minimum", "tolerance": 1e-10,
                "max_iterations": 50,
            },
        ),
        "find_contradiction": (mech.find_contradiction, {"mechanism": arm2, "q": q3, "hold": ()}),
        "to_velocity": (
            mech.to_velocity,
            {"mechanism": m, "q": Q, "p": V, "v_rho": None, "keep_constraints": False},
        ),
        "to_momentum": (mech.to_momentum, {"mechanism": m, "q": Q, "v": V}),
        "legendre_jacobian": (mech.legendre_jacobian, {"mechanism": m, "q": Q, "v": V}),
        "ContinuousDynamics.inverse_dynamics": (
            dynamics.inverse_dynamics,
            {"q": Q, "v": V, "a": V},
        ),
        "to_continuous": (mech.to_continuous, {"run": run()}),
        "to_discrete": (mech.to_discrete, {"trajectory": continuous(), "integrator": vi, "t": None, "sampled": False}),
        "Body": (
            mech.Body,
            {"mass": 1.0, "com": [0.0, 0.0, 0.1], "inertia": [1.0, 1.0, 1.0], "allow_nonphysical": False},
        ),
        "Curve": (
            mech.Curve,
            {"x": [0.0, 1.0, 2.0], "y": [0.0, 1.0, 3.0], "slopes": None, "curvatures": None, "between": "smooth"},
        ),
        "Curve.from_function": (
            mech.Curve.from_function, {"function": np.tanh, "start": -1.0, "end": 1.0, "pieces": 8},
        ),
        "tx": (mech.tx, {"value": "x", "mass": 1.0, "com": [0.0, 0.0, 0.0], "inertia": None, "name": "f"}),
        "revolute": (mech.revolute, {"value": "x", "axis": [0.0, 0.0, 1.0], "point": [0.0, 1.0, 0.0]}),
        "prismatic": (mech.prismatic, {"value": "x", "axis": [0.0, 0.0, 1.0]}),
        "screw": (mech.screw, {"value": "x", "axis": [0.0, 0.0, 1.0], "point": [0.0, 0.0, 0.0], "pitch": 0.1}),
        "ball": (mech.ball, {"variables": "ball", "axes": "xyz"}),
        "universal": (mech.universal, {"variables": "cross", "axes": "xy"}),
        "free": (mech.free, {"variables": "body", "axes": "xyz"}),
        "pose": (
            mech.pose,
            {
                "matrix": None, "translation": [0.0, 0.0, 1.0], "rotation": np.eye(3), "name": "f", "mass": 1.0,
                "bodies": (),
            },
        ),
        "twist": (
            mech.twist,
            {"value": "x", "linear": [0.0, 0.0, 1.0], "angular": [0.0, 0.0, 0.0], "kinematic": False},
        ),
        "rx": (mech.rx, {"value": {"a": 2.0}, "offset": 0.1, "kinematic": ["a"]}),
        "var": (mech.var, {"name": "a"}),
        "ry": (mech.ry, {"value": "x"}),
        "rz": (mech.rz, {"value": "x"}),
        "ty": (mech.ty, {"value": "x"}),
        "tz": (mech.tz, {"value": "x"}),
        "coordinate": (ex.coordinate, {"expression": ex.variable("a")}),
        "direction": (ex.direction, {"frame": "B", "vector": "x"}),
        "distance": (ex.distance, {"frame1": "world", "frame2": "B"}),
        "input_": (ex.input_, {"name": "u"}),
        "parameter": (ex.parameter, {"name": "k", "value": 2.0}),
        "point": (ex.point, {"frame": "B"}),
        "rate": (ex.rate, {"expression": ex.variable("a")}),
        "speed": (ex.speed, {"name": "a"}),
        "unit_vector": (ex.unit_vector, {"frame": "B", "vector": "x"}),
        "time": (ex.time, {}),
        "variable": (ex.variable, {"name": "a"}),
        "Mechanism": (
            la.Mechanism,
            {
                "description": [mech.rx("a", name="f"), [mech.tz(-1.0, mass=1.0)]], "elements": [mech.Gravity()],
                "dynamic": ["a"], "kinematic": (), "inputs": (),
            },
        ),
        "check_function": (mech.check_function, {"function": Square(), "z": [1.0, 2.0]}),
        "world": (mech.world, {"name": "ground"}),
        "momentum_by": (mech.momentum_by, {"mechanism": m, "q": Q, "v": V, "names": ["A.mass"]}),
        "gain_to_continuous": (
            mech.gain_to_continuous, {"mechanism": m, "q": Q, "v": V, "K": np.ones((1, 4)), "dt": 0.01},
        ),
        "gain_to_discrete": (
            mech.gain_to_discrete, {"mechanism": m, "q": Q, "v": V, "K": np.ones((1, 4)), "dt": 0.01},
        ),
        "Projection": (mech.Projection, {"tolerance": 1e-10}),
        "Event": (mech.Event, {"function": "a", "terminal": True, "direction": 0.0, "value": 0.1}),
        "Baumgarte": (mech.Baumgarte, {"time_constant": 0.1, "damping_ratio": 1.0}),
        "simulate": (
            mech.simulate,
            {"dynamics": m, "q0": Q, "v0": V, "t": [0.0, 0.01], "rtol": 1e-6, "atol": 1e-8, "max_step": 0.01},
        ),
    }  # fmt: skip
    elements: dict[str, Call] = {
        f"element {kind.__name__}": (_built(kind), arguments)
        for kind, arguments in (
            (mech.Gravity, {"vector": (0.0, 0.0, -9.81), "frames": None}),
            (mech.LinearSpring, {"frame1": "world", "frame2": "B", "stiffness": 1.0, "length": 0.5}),
            (mech.JointSpring, {"variable": "a", "stiffness": 1.0, "rest": 0.0}),
            (mech.ElasticString, {"frames": ["world", "B"], "stiffness": 1.0, "length": 1.0, "tension_only": True}),
            (mech.Distance, {"frame1": "world", "frame2": "B", "length": 1.0}),
            (mech.PathLength, {"frames": ["world", "A", "B"], "length": 2.0}),
            (mech.PointToPoint, {"frame1": "world", "frame2": "B", "axes": "yz"}),
            (mech.PointOnLine, {"line": "world", "frame": "B", "direction": (0.0, 1.0, 0.0)}),
            (mech.PointOnPlane, {"plane": "world", "frame": "B", "normal": (0.0, 1.0, 0.0)}),
            (mech.JointForce, {"variable": "a", "input": "u"}),
            (mech.Damping, {"coefficients": {"a": 0.1}}),
            (mech.CoulombFriction, {"on": "a", "force": 1.0, "speed": 0.1}),
            (mech.LinearDamper, {"frame1": "world", "frame2": "B", "coefficient": 1.0}),
            (mech.TendonForce, {"frames": ["world", "B"], "input": "u", "gain": 1.0}),
            (mech.BodyWrench, {"frame": "B", "force": (0.0, 1.0, "u"), "torque": (0.0, 0.0, 0.0)}),
            (mech.HingeLoop, {"frame1": "world", "frame2": "B", "axis": "x", "planar": True}),
            (mech.FixedOrientation, {"frame1": "world", "frame2": "B", "rotation": np.eye(3)}),
            (mech.InverseSquareGravity, {"frame1": "world", "frame2": "B", "strength": 1.0}),
            (mech.LinearMotor, {"frame1": "world", "frame2": "B", "input": "u", "gain": 1.0}),
            (mech.Motor, {"frame1": "world", "frame2": "B", "input": "u", "axis": "x", "gain": 1.0}),
            (mech.NonlinearDamping, {"on": "a", "coefficients": [0.1, 0.2]}),
            (mech.NonlinearSpring, {"on": "a", "force": mech.Curve([0.0, 1.0], [0.0, 1.0])}),
            (mech.TorsionalSpring, {"frame1": "A", "frame2": "B", "stiffness": 1.0, "axis": "x", "rest": 0.1}),
            (mech.PrescribedPath, {"frame": "B", "x": None, "y": "y", "z": "z"}),
            (mech.Coupling, {"factors": {"a": 1.0, "b": -2.0}, "offset": 0.1}),
            (mech.HybridWrench, {"frame": "B", "force": (0.0, 1.0, "u"), "torque": None}),
            (mech.SpatialWrench, {"frame": "B", "force": None, "torque": (0.0, 1.0, "u")}),
            (mech.Armature, {"variable": "a", "inertia": 0.1}),
            (
                mech.Servo,
                {
                    "on": "a",
                    "input": "u",
                    "gain": 1.0,
                    "offset": 0.0,
                    "stiffness": 1.0,
                    "damping": 0.1,
                    "gain_by_place": 0.0,
                    "gain_by_rate": 0.0,
                },
            ),
            (mech.PolynomialCoupling, {"on": "a", "of": "b", "coefficients": (0.0, 1.0, 0.5)}),
            (mech.ExpressionConstraint, {"expression": ex.variable("a") - ex.variable("b")}),
            (mech.ExpressionPotential, {"expression": ex.distance("world", "B") ** 2}),
            (mech.ExpressionForce, {"expression": ex.input_("u"), "along": "a"}),
            (mech.PythonConstraint, {"function": Square(), "points": (), "directions": (), "variables": ["a"]}),
            (mech.PythonPotential, {"function": Square(), "points": (), "directions": (), "variables": ["a"]}),
            (
                mech.PythonForce,
                {
                    "function": Square(),
                    "input": "u",
                    "magnitude": None,
                    "measured": (),
                    "gain": 1.0,
                    "points": (),
                    "directions": (),
                    "variables": ["a"],
                },
            ),
            (mech.Drag, {"frame": "B", "coefficient": 0.1, "exponent": 2.0, "wind": (0.0, 0.0, 0.0)}),
        )
    }
    return {**functions, **of_steps, **of_mechanism, **of_constraints, **elements}


def _built(kind: type) -> Callable[..., Any]:
    """Return what makes a mechanism with an element of a kind."""

    def build(**arguments: Any) -> la.Mechanism:
        links = [mech.rx("a"), [mech.tz(-1.0, mass=1.0, name="A"), [mech.rx("b"), [mech.tz(-1.0, mass=0.5, name="B")]]]]
        return la.Mechanism(links, [kind(**arguments, name="it")])

    return build
