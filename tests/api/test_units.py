"""The unit of everything that a mechanism names."""

from __future__ import annotations

import numpy as np
import pytest

import leastaction as la
from leastaction import models, rz, tx, tz
from leastaction.mechanics.expressions import distance


def everything() -> la.Mechanism:
    tree = [
        rz("hip", name="thigh", mass=1.0, inertia=(1.0, 1.0, 1.0)), [
            tx(0.5), [rz("knee", name="shank", mass=1.0, inertia=(1.0, 1.0, 1.0)), [tx(0.5, name="foot")]],
            tx("slide", name="slider", mass=1.0),
        ],
        rz(la.var("both"), name="turning", mass=1.0, inertia=(1.0, 1.0, 1.0)),
        [tx(la.var("both"), name="sliding", mass=1.0)],
        rz(2.0 * la.var("geared"), name="gear", mass=1.0, inertia=(1.0, 1.0, 1.0)),
        la.screw("nut", axis="z", pitch=0.01, name="nut", mass=1.0, inertia=(1.0, 1.0, 1.0)),
        tz(2.0, name="above"),
    ]  # fmt: skip
    return la.Mechanism(
        tree,
        [
            la.Gravity(),
            la.JointForce("hip", "hip torque"),
            la.JointForce("slide", "slide force"),
            la.JointForce("both", "of both"),
            la.JointForce({"hip": 1.0, "knee": -1.0}, "differential"),
            la.JointForce({"hip": 1.0, "slide": 1.0}, "mixed"),
            la.Motor("thigh", "shank", "motor"),
            la.Motor("thigh", "shank", "current", gain=0.1),
            la.LinearMotor("above", "foot", "piston"),
            la.TendonForce(["above", "foot"], "tendon"),
            la.TendonForce(["above", "foot"], "activation", gain=300.0),
            la.BodyWrench("foot", force=["fx", 0.0, "shared"], torque=["tx", "shared", 0.0]),
            la.JointForce("hip", "torque of two"),
            la.Motor("thigh", "shank", "torque of two"),
            la.LinearSpring("above", "foot", 10.0, "slack"),
            la.TorsionalSpring("thigh", "shank", 10.0, rest="rest angle"),
            la.JointSpring("knee", 1.0, rest="rest knee"),
            la.Distance("above", "foot", "length", name="string"),
            la.PathLength(["above", "slider", "foot"], "path length", name="path"),
            la.Coupling({"hip": 1.0, "geared": 2.0}, "hip and gear", name="gears"),
            la.Coupling({"hip": 1.0, "slide": 2.0}, "odd", name="rack"),
            la.PointOnPlane("above", "nut", name="plane"),
            la.PointOnLine("above", "sliding", name="line"),
            la.PointToPoint("above", "shank", "xy", name="point"),
            la.PrescribedPath("foot", x="foot x", name="path x"),
            la.HingeLoop("above", "turning", name="hinge"),
            la.FixedOrientation("above", "gear", name="attitude"),
            la.ExpressionConstraint(distance("foot", "above") - 1.0, name="own"),
        ],
    )


def test_units_of_everything():
    m = everything()
    units = m.units
    assert set(units) == {*m.variables, *m.inputs, *m.constraints}
    rad, length, none = "rad", "m", ""
    expected = {
        "hip": rad, "knee": rad, "slide": length, "both": none, "geared": rad, "nut": rad,
        "slack": length, "rest angle": rad, "rest knee": rad, "length": length, "path length": length,
        "hip and gear": rad, "odd": none, "foot x": length,
        "hip torque": "N m", "slide force": "N", "of both": none, "differential": "N m", "mixed": none, "motor": "N m",
        "current": none, "piston": "N", "tendon": "N", "activation": none, "fx": "N", "tx": "N m", "shared": none,
        "torque of two": "N m",
        "string": "m^2", "path": length, "gears": rad, "rack": none, "plane": length, "line.across1": length,
        "line.across2": length, "point.x": length, "point.y": length, "path x.x": length, "hinge.x": length,
        "hinge.y": length, "hinge.z": length, "hinge.tilt1": none, "hinge.tilt2": none, "attitude.x": none,
        "attitude.y": none, "attitude.z": none, "own": none,
    }  # fmt: skip
    assert dict(units) == expected
    with pytest.raises(TypeError):
        units["hip"] = "m"


def test_a_variable_that_prescribes_what_a_joint_has_keeps_the_unit_of_the_joint():
    m = la.Mechanism([tx("a", name="a", mass=1.0), tx("b", kinematic=True)], [la.JointSpring("a", 2.0, rest="b")])
    assert m.units["b"] == "m"


def test_units_of_trajectories_are_those_of_their_multipliers():
    m = la.Mechanism(
        [tx("x"), [tz("z", name="bob", mass=1.0)], tz(1.0, name="above")],
        [
            la.Gravity(),
            la.Distance("above", "bob", 1.0, name="string"),
            la.PathLength(["above", "bob"], 1.0, name="path"),
        ],
    )
    vi = la.MidpointVI(m)
    run = vi.simulate(vi.start(m.configuration()), np.linspace(0.0, 0.02, 3))
    assert dict(run.units) == {"x": "m", "z": "m", "string": "N s/m", "path": "N s"}
    assert run.state_units == ("m", "m", "kg m/s", "kg m/s")
    swing = m.with_exchanged({"path": ()})
    made = la.simulate(swing, swing.configuration(), swing.configuration({"x": 1.0}), t=np.linspace(0.0, 0.02, 3))
    assert dict(made.units) == {"x": "m", "z": "m", "string": "N/m"}
    assert made.state_units == ("m", "m", "m/s", "m/s")


def test_ready_mechanisms():
    for name in models.MODELS:
        mechanism = models.build(name)
        assert all(mechanism.units[each] for each in mechanism.variables), name
