"""Mechanisms that hold every kind of named parameter, for `test_parameters.py`."""

from __future__ import annotations

import numpy as np
import sympy

from leastaction import mechanics as la
from leastaction.mechanics import Body, Mechanism, world
from leastaction.mechanics import expressions as ex


def bodies() -> list[Body]:
    return [
        Body(0.7, com=(0.1, -0.05, 0.02), inertia=(0.03, 0.04, 0.05, 0.004, -0.003, 0.002)),
        Body(0.4, com=(-0.02, 0.03, 0.2), inertia=(0.02, 0.02, 0.015)),
    ]


def tree() -> la.Branch:
    """Return two arms, in which a length, an angle and a pose lie before, between and after the joints."""
    root = world()
    root.pose(translation=(0.3, -0.2, 0.9), rotation=turned((1.0, 2.0, 0.5), 0.4), name="hook")
    base = root.tx(0.1, name="foot").rx(0.3, name="tilt")
    slide = base.tx("x", name="cart", mass=2.0, inertia=(0.05, 0.06, 0.07))
    upper = slide.rz("a", name="upper", bodies=bodies())
    elbow = upper.ty(-0.5, name="arm").rz(-0.2, name="bend").ty("rho", kinematic=True, name="lift")
    lower = elbow.rx("b", name="lower", bodies=bodies()[:1])
    tip = lower.pose(
        translation=(0.1, -0.4, 0.05),
        rotation=turned((0.0, 1.0, 0.3), 0.7),
        name="tip",
        bodies=bodies()[1:],
    )
    tip.screw("c", axis=(0.0, 0.6, 0.8), pitch=0.3, name="nut", bodies=bodies()[:1])
    other = root.tz(-0.3, name="drop").ry("d", name="other", bodies=bodies()[1:])
    hand = other.twist(
        {"e": 1.0, "d": 0.4},
        linear=(0.1, 0.5, 0.0),
        angular=(1.0, 0.2, 0.3),
        name="hand",
        bodies=bodies()[:1],
    )
    hand.tz(0.35, name="end", mass=0.2, inertia=(0.03, 0.03, 0.03))
    return root


def turned(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * hat + (1.0 - np.cos(angle)) * hat @ hat


def springs() -> Mechanism:
    curve = la.Curve.from_function(lambda s: 3.0 * s + s**3, -2.0, 2.0, pieces=8)
    gap = ex.distance("tip", "end")
    energy = ex.parameter("strength", 0.2) / (gap + ex.parameter("softening", 0.3))
    return Mechanism(
        tree(),
        [
            la.Gravity((0.3, -9.0, 1.0)),
            la.LinearSpring("tip", "hook", 20.0, length=0.4, name="spring"),
            la.LinearSpring("end", "hook", 5.0, name="tie"),
            la.JointSpring({"a": 1.0, "e": -0.7}, 4.0, rest=0.2, name="joint"),
            la.TorsionalSpring("cart", "lower", 2.0, rest=0.1, name="torsion"),
            la.NonlinearSpring(["hook", "tip", "end"], curve, name="curve"),
            la.ElasticString(["hook", "lower", "end"], 30.0, 1.1, smoothing=0.1, name="string"),
            la.ElasticString(["foot", "nut", "hand"], 8.0, 0.9, tension_only=False, name="both_ways"),
            la.InverseSquareGravity("tip", "hand", 0.3, name="attraction"),
            la.Armature("a", 0.3, name="rotor"),
            la.Armature({"e": 2.0, "d": -0.7}, 0.2, name="geared"),
            la.ExpressionPotential(energy, name="user"),
        ],
    )


def forces() -> Mechanism:
    fl = la.Curve.from_function(lambda s: 1.0 - 0.4 * (s - 1.0) ** 2, 0.0, 4.0, pieces=8)
    fv = la.Curve.from_function(lambda v: float(1.0 + 0.3 * np.tanh(v)), -5.0, 5.0, pieces=40)
    motor = ex.input_("voltage") - ex.parameter("emf", 0.3) * ex.speed("a") * (
        1 + ex.parameter("bend", 0.5) * sympy.cos(ex.variable("b"))
    )
    return Mechanism(
        tree(),
        [
            la.Gravity((0.0, 0.0, -9.0), frames=["hand"], name="some"),
            la.Damping({"x": 0.4, "a": 0.1}, default=0.05),
            la.NonlinearDamping("b", (0.2, 0.1, 0.05), name="cubic"),
            la.CoulombFriction("d", 0.4, 0.8, name="friction"),
            la.LinearDamper("tip", "end", 1.5, name="damper"),
            la.Drag("end", 0.4, exponent=1.7, wind=(0.5, -1.0, 0.2), smoothing=0.5, name="air"),
            la.BodyWrench("tip", (1.0, "thrust", -0.5), (0.1, 0.2, 0.3), name="body"),
            la.HybridWrench("end", (0.4, 0.5, 0.6), ("thrust", 0.0, 0.2), name="hybrid"),
            la.SpatialWrench("nut", (0.2, -0.3, 0.1), (0.3, 0.1, -0.2), name="spatial"),
            la.TendonForce(["hook", "lower", "end"], "pull", 2.0, fl, fv, name="tendon"),
            la.JointForce("a", "voltage"),
            la.Servo({"b": 1.4, "x": 0.3}, "voltage", 0.8, 0.1, 2.0, 0.3, 0.2, 0.1, name="servo"),
            la.HybridWrench("tip", (0.0, {"thrust": 0.3}, 0.1), name="rotor_wind"),
            la.TendonForce({("hook", "tip"): 0.5, ("lower", "end"): 1.2}, "pull", name="tackle"),
            la.ExpressionForce(motor, "a", name="motor"),
        ],
    )


def loops() -> Mechanism:
    """Return a mechanism with constraints, and forces, so that the split counts."""
    fixed = ex.variable("c") - ex.parameter("slope", 0.4) * sympy.sin(ex.variable("a"))
    return Mechanism(
        tree(),
        [
            la.Gravity((0.0, -9.0, 2.0)),
            la.Distance("tip", "hook", 0.7, name="rod"),
            la.PathLength(["hook", "cart", "end"], 1.3, name="rope"),
            la.Coupling({"e": 1.0, "a": -0.6, "d": 0.2}, offset=0.1, name="gear"),
            la.PolynomialCoupling({"x": 1.2}, {"b": 0.8, "d": 0.1}, (0.1, 0.2, -0.05, 0.02), name="knee"),
            la.ExpressionConstraint(fixed, name="user"),
            la.Damping(0.3),
            la.LinearSpring("tip", "end", 6.0, length=0.3, name="spring"),
        ],
    )
