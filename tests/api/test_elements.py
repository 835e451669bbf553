"""What elements compile to, their parameters, and how they read."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from api.recorder import Recorder
from api.test_bad_elements import tree
from leastaction import mechanics as la
from leastaction.errors import DescriptionError
from leastaction.mechanics import Curve, Mechanism, pose, rz, tx
from leastaction.mechanics.description.flattening import flatten
from leastaction.mechanics.mechanism.compilation import plan

CURVE = Curve(np.linspace(0.0, 3.0, 9), np.linspace(0.0, 3.0, 9) ** 2)
ROTATION = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
X, THETA, SPIN, YAW, RAIL = range(5)


def compiled(*elements, description=None):
    """The calls that elements come to, and their parameters by value."""
    recorder = Recorder()
    settled = plan(flatten(description or tree()), elements)
    context = settled.emit(recorder)
    values = {name: recorder.numbers[slot] for name, slot in context.parameters.items()}
    return recorder, values


def only(recorder):
    (element,) = recorder.elements
    return element


def points_of(recorder, scalar):
    return [recorder.points[index] for index in scalar[1]]


# Potentials


def test_gravity_on_some_frames_is_the_weight_of_their_masses():
    body = la.Body(2.0, com=(0.0, 1.0, 0.0))
    description = [
        tx("x", name="box", mass=1.0, com=(3.0, 0.0, 0.0), bodies=[body]),
        [rz(np.pi / 2, name="turned", mass=4.0, com=(1.0, 0.0, 0.0))],
    ]
    recorder, values = compiled(la.Gravity((0, -2.0, -9.0), frames=["box", "turned"]), description=description)
    assert values == {
        "gravity(box, turned).vector.x": 0.0,
        "gravity(box, turned).vector.y": -2.0,
        "gravity(box, turned).vector.z": -9.0,
        "gravity(box, turned).mass.box": 3.0,
        "gravity(box, turned).mass.turned": 4.0,
    }
    assert recorder.gravity is None
    box, turned = recorder.elements
    assert box[2] == ("linear", 3.0)
    for (kind, points, directions, variables, tape, vector), com in (
        (box[1], (1.0, 2.0 / 3.0, 0.0)),
        (turned[1], (0.0, 1.0, 0.0)),
    ):
        assert (kind, directions, variables, vector) == ("tape", [], [], (0.0, -2.0, -9.0))
        (point,) = points
        np.testing.assert_allclose(recorder.points[point][1], com, atol=1e-15)
        assert recorder.points[point][0] == 0
        value, gradient, _ = tape.evaluate(np.array([0.5, 2.0, 0.1, *vector]), 3)
        assert value == pytest.approx(2.0 * 2.0 + 9.0 * 0.1)
        np.testing.assert_array_equal(gradient, [0.0, 2.0, 9.0])


def test_partial_gravities_add_up_to_the_whole_one():
    whole = Mechanism(tree(), [la.Gravity()])
    parts = Mechanism(tree(), [la.Gravity(frames=["cart", "bob"]), la.Gravity(frames=["mast", "wheel"])])
    q, v = np.linspace(-0.7, 0.9, whole.nq), np.zeros(whole.nq)
    assert parts.energy(q, v).potential == pytest.approx(whole.energy(q, v).potential, abs=1e-13)
    both = Mechanism(tree(), [la.Gravity(), la.Gravity((0, 0, 9.81), frames=["bob"])])
    assert both.energy(q, v).potential == pytest.approx(
        Mechanism(tree(), [la.Gravity(frames=["cart", "mast", "wheel"])]).energy(q, v).potential,
        abs=1e-13,
    )


def test_springs():
    recorder, values = compiled(la.LinearSpring("post", "bob", 5.0, length=0.5, name="s"))
    _, scalar, law = only(recorder)
    assert scalar[0] == "path"
    assert [joint for joint, _ in points_of(recorder, scalar)] == [-1, THETA]
    assert law == ("spring", 5.0, 0.5)
    assert values == {"s.stiffness": 5.0, "s.length": 0.5}

    recorder, values = compiled(la.JointSpring("theta", 3.0, rest=0.1, name="s"))
    assert only(recorder) == ("potential", ("sum", (THETA,), (1.0,)), ("spring", 3.0, 0.1))
    assert values == {"s.stiffness": 3.0, "s.rest": 0.1}

    recorder, values = compiled(la.JointSpring({"theta": 2.0, "rail": -1.0}, 3.0, name="s"))
    assert only(recorder)[1] == ("sum", (THETA, RAIL), (2.0, -1.0))
    assert values["s.factors.rail"] == -1.0


def test_a_spring_without_a_length_is_smooth_where_its_ends_meet():
    description = [la.tx("x", name="a", mass=1.0), la.ty("y", name="b", mass=1.0)]
    recorder, values = compiled(la.LinearSpring("a", "b", 5.0, name="s"), description=description)
    assert [call[1][0] for call in recorder.elements] == ["component"] * 3
    assert values == {"s.stiffness": 5.0}
    mechanism = Mechanism(description, [la.LinearSpring("a", "b", 5.0)])
    at_rest = np.zeros(2)
    assert mechanism.energy(at_rest, at_rest).potential == 0.0
    assert mechanism.energy([0.3, 0.4], at_rest).potential == pytest.approx(2.5 * 0.25, rel=1e-15)
    L_qq = mechanism.core.hessian(at_rest, at_rest)[0]
    np.testing.assert_allclose(L_qq, -5.0 * np.eye(2), atol=1e-15)


@pytest.mark.parametrize("angle", [-3.0, -1.0, 0.0, 0.4, 2.0, 3.1])
def test_the_torsional_spring_measures_the_angle(angle):
    description = [
        pose(rotation=ROTATION, name="base"),
        [la.revolute("q", axis=(1.0, 2.0, -0.5), name="lid", mass=1.0, inertia=(1, 1, 1))],
    ]
    spring = la.TorsionalSpring("base", "lid", 2.0, axis=(1.0, 2.0, -0.5), rest=0.25)
    energy = Mechanism(description, [spring]).energy([angle], [0.0]).potential
    assert energy == pytest.approx((angle - 0.25) ** 2, rel=1e-13)
    back = la.TorsionalSpring("lid", "base", 2.0, axis=(1.0, 2.0, -0.5), rest=-0.25)
    assert Mechanism(description, [back]).energy([angle], [0.0]).potential == pytest.approx(energy)


def test_nonlinear_spring_and_elastic_string():
    recorder, values = compiled(la.NonlinearSpring(["post", "cart", "bob"], CURVE, name="s"))
    _, scalar, law = only(recorder)
    assert scalar[0] == "path"
    assert len(scalar[1]) == 3
    assert law[0] == "piecewise"
    np.testing.assert_array_equal(law[2], CURVE.integral().coefficients)
    assert values == {"s.scale": 1.0}
    recorder, _ = compiled(la.NonlinearSpring({"x": 2.0}, CURVE))
    assert only(recorder)[1] == ("sum", (X,), (2.0,))

    recorder, values = compiled(la.ElasticString(["post", "bob"], 9.0, 1.5, name="s"))
    assert only(recorder)[2] == ("taut", 9.0, 1.5, 1e-3)
    assert values == {"s.stiffness": 9.0, "s.length": 1.5, "s.smoothing": 1e-3}
    recorder, values = compiled(la.ElasticString(["post", "bob"], 9.0, 1.5, tension_only=False))
    assert only(recorder)[2] == ("spring", 9.0, 1.5)
    assert len(values) == 2


def test_inverse_square_gravity():
    pull = la.InverseSquareGravity("post", "cart", 4.0, name="g")
    assert compiled(pull)[1] == {"g.strength": 4.0}
    mechanism = Mechanism(tree(), [pull])
    q = mechanism.configuration({"x": 4.0})
    assert mechanism.energy(q, 0.0 * q).potential == pytest.approx(-4.0 / 5.0, rel=1e-15)


# Constraints


def test_lengths_and_couplings():
    recorder, values = compiled(la.Distance("post", "bob", 2.0, name="rod"))
    assert recorder.distances[0][2:] == (2.0, -1)
    assert values == {"rod.length": 2.0}

    recorder, values = compiled(la.PathLength(["post", "cart", "bob"], 2.0, name="rope"))
    kind, scalar, number, variable = only(recorder)
    assert (kind, scalar[0], number, variable) == ("constraint", "path", 2.0, None)
    assert values == {"rope.length": 2.0}
    recorder, values = compiled(la.PathLength(["post", "bob"], "winch"))
    assert only(recorder)[2:] == (None, RAIL + 1)
    assert values == {}

    recorder, values = compiled(la.Coupling({"x": 1.0, "theta": -0.2}, offset=0.3, name="gear"))
    assert only(recorder) == ("constraint", ("sum", (X, THETA), (1.0, -0.2)), 0.3, None)
    assert values == {"gear.factors.x": 1.0, "gear.factors.theta": -0.2, "gear.offset": 0.3}


def two_free_bodies():
    options = {"mass": 1.0, "inertia": (1.0, 1.0, 1.0)}
    return [la.free("b", axes="xyz", name="b", **options), la.free("c", axes="xyz", name="c", **options)]


def residuals(element, q):
    """Residuals of a constraint between two free bodies by their suffix, and the bodies' poses."""
    mechanism = Mechanism(two_free_bodies(), [element])
    values = mechanism.constraint_residuals(q)
    poses = [mechanism.frame_pose(q, name) for name in "bc"]
    return {name.partition(".")[2]: h for name, h in values.items()}, poses


Q = np.random.default_rng(3).uniform(-1.0, 1.0, 12)


def test_point_on_plane_and_on_line():
    normal = np.array([0.6, -1.0, 2.0])
    h, (b, c) = residuals(la.PointOnPlane("b", "c", normal=normal), Q)
    assert h == {"": pytest.approx((b[:3, :3] @ normal) @ (b[:3, 3] - c[:3, 3]), rel=1e-12)}

    h, (b, c) = residuals(la.PointOnLine("b", "c", direction="y"), Q)
    apart = b[:3, :3].T @ (b[:3, 3] - c[:3, 3])
    assert h == {"across1": pytest.approx(apart[2]), "across2": pytest.approx(apart[0])}

    line = np.array([3.0, -1.0, 2.0]) / np.sqrt(14.0)
    h, (b, c) = residuals(la.PointOnLine("b", "c", direction=3.0 * line), Q)
    apart = b[:3, :3].T @ (b[:3, 3] - c[:3, 3])
    off = apart - line * (line @ apart)
    assert np.hypot(*h.values()) == pytest.approx(np.linalg.norm(off), rel=1e-12)


@pytest.mark.parametrize("axis", ["x", "y", "z", (1.0, -2.0, 0.5)])
def test_a_hinge_leaves_the_turning_about_its_axis(axis):
    hinge = la.HingeLoop("base", "lid", axis=axis)
    vector = np.eye(3)["xyz".index(axis)] if isinstance(axis, str) else axis
    place = {"translation": (0.3, 1.0, -2.0), "rotation": ROTATION}
    held = [la.revolute("q", axis=vector, mass=1.0, inertia=(1, 1, 1), name="lid")]
    options = {"mass": 1.0, "inertia": (1, 1, 1)}
    mechanism = Mechanism([pose(**place, name="base"), held], [hinge])
    for angle in (0.0, 0.8, -2.5):
        assert np.abs(mechanism.constraint_values([angle])).max() < 1e-15
    # A body that is free where the lid is keeps one degree of freedom of its six.
    loose = [pose(**place, name="base"), [la.free("f", axes="xyz", name="lid", **options)]]
    assert Mechanism(loose, [hinge]).degrees_of_freedom(np.zeros(6)) == 1
    assert Mechanism(loose, [hinge]).constraints == tuple(
        f"hinge(base, lid).{end}" for end in ("x", "y", "z", "tilt1", "tilt2")
    )
    planar = Mechanism(loose, [la.HingeLoop("base", "lid", axis=axis, planar=True)])
    assert planar.degrees_of_freedom(np.zeros(6)) == 4
    q = np.array([*(0.7 * np.asarray(vector)), 0.0, 0.0, 0.0])
    assert np.abs(planar.constraint_values(q)).max() < 1e-15, "it slides along the axis"


def test_fixed_orientation_holds_the_wanted_rotation():
    rng = np.random.default_rng(8)
    for wanted in (None, *(np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(4))):
        rotation = None if wanted is None else wanted * np.linalg.det(wanted)
        options = {"mass": 1.0, "inertia": (1.0, 1.0, 1.0)}
        description = [
            la.free("b", axes="xyz", name="b", **options),
            [
                pose(rotation=np.eye(3) if rotation is None else rotation),
                [la.free("c", axes="xyz", name="c", **options)],
            ],
        ]
        mechanism = Mechanism(description, [la.FixedOrientation("b", "c", rotation=rotation)])
        q = np.array([*rng.uniform(-1.0, 1.0, 9), 0.0, 0.0, 0.0])
        assert np.abs(mechanism.constraint_values(q)).max() < 1e-15
        # The three angles of the joint between them are about the turned axes here.
        turned = np.eye(3) if rotation is None else rotation
        jacobian = mechanism.constraint_jacobian(q)
        np.testing.assert_allclose(jacobian[:, 9:], -turned, atol=1e-14)
        assert np.abs(jacobian[:, :9]).max() < 1e-14
        assert mechanism.constraints == tuple(f"fixed_orientation(b, c).{a}" for a in "xyz")


def test_prescribed_path():
    element = la.PrescribedPath("bob", x="to", z="up")
    mechanism = Mechanism(tree(), [element])
    assert mechanism.kinematic == ("rail", "to", "up")
    assert mechanism.constraints == ("prescribed_path(bob).x", "prescribed_path(bob).z")
    q = mechanism.configuration({"x": 0.4, "theta": 0.3, "to": 0.2, "up": -1.0})
    expected = mechanism.positions(q, ["bob"])[0, [0, 2]] - [0.2, -1.0]
    np.testing.assert_allclose(mechanism.constraint_values(q), expected, atol=1e-15)


# Forces


def test_damping_registers_what_was_written():
    recorder, values = compiled(la.Damping({"theta": 0.0, "x": 0.2}, name="oil"))
    assert recorder.damping == [(X, 0.2), (THETA, 0.0)]
    assert values == {"oil.x": 0.2, "oil.theta": 0.0}
    _, values = compiled(la.Damping(0.1), la.Damping({"x": 0.5}))
    assert values["damping#2.x"] == 0.5
    assert values["damping.theta"] == 0.1


def test_forces_that_oppose_a_velocity():
    recorder, values = compiled(la.NonlinearDamping("theta", (0.1, -0.2, 0.3), name="d"))
    law = ("polynomial", 0.0, 0.1, 0.0, -0.2, 0.0, 0.3)
    assert only(recorder) == ("force", ("sum", (THETA,), (1.0,)), -1.0, None, None, law)
    assert values == {"d.c1": 0.1, "d.c3": -0.2, "d.c5": 0.3}

    recorder, values = compiled(la.CoulombFriction("x", force=3.0, speed=0.01, name="f"))
    assert only(recorder)[2:] == (-1.0, None, None, ("tanh", 3.0, 0.01))
    assert values == {"f.force": 3.0, "f.speed": 0.01}

    recorder, values = compiled(la.LinearDamper("post", "bob", 0.7, name="c"))
    assert only(recorder)[1][0] == "path"
    assert only(recorder)[2:] == (-1.0, None, None, ("linear", 0.7))
    assert values == {"c.coefficient": 0.7}


def test_tendon_force():
    recorder, values = compiled(la.TendonForce(["post", "cart", "bob"], "u", gain=2.0, name="m"))
    kind, scalar, gain, given, by_length, by_velocity = only(recorder)
    assert (kind, scalar[0], gain, given) == ("force", "path", 2.0, 0)
    assert (by_length, by_velocity) == (("polynomial", -1.0), None)
    assert values == {"m.gain": 2.0}

    recorder, _ = compiled(la.TendonForce(["post", "bob"], "u", force_length=CURVE, force_velocity=CURVE))
    *_, by_length, by_velocity = only(recorder)
    assert (by_length[0], by_length[-1]) == ("piecewise", -1.0)
    assert (by_velocity[0], by_velocity[-1]) == ("piecewise", 1.0)


def test_wrenches_share_inputs_with_other_elements():
    elements = [
        la.JointForce("x", input="push"),
        la.BodyWrench("bob", force=("thrust", 0.5, 0.0), torque=(0, 0, "push"), name="w"),
        la.SpatialWrench("bob", torque=(1, 2, 3)),
    ]
    recorder, values = compiled(*elements)
    assert plan(flatten(tree()), elements).inputs == ("push", "thrust")
    body, spatial = recorder.elements
    assert body[1:3] == ("body", THETA)
    np.testing.assert_array_equal(body[3][:3, 3], [0.0, -1.0, 0.0])
    assert body[4:] == ([None, 0.5, 0.0, 0.0, 0.0, None], [1, -1, -1, -1, -1, 0])
    assert spatial[1] == "spatial"
    assert spatial[4] == [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    assert {name for name in values if name.startswith("w.")} == {"w.fy", "w.fz", "w.tx", "w.ty"}
    assert values["spatial_wrench(bob).tz"] == 3.0


def test_drag():
    drag = la.Drag("bob", 0.3, exponent=2.5, wind=(1.0, -0.5, 0.2), smoothing=0.1, name="air")
    recorder, values = compiled(drag)
    assert [call[1][0][3] for call in recorder.elements] == [0, 1, 2], "first along x, y and z"
    assert values == {
        "air.coefficient": 0.3,
        "air.exponent": 2.5,
        "air.smoothing": 0.1,
        "air.wind.x": 1.0,
        "air.wind.y": -0.5,
        "air.wind.z": 0.2,
    }
    mechanism = Mechanism([tx("x"), [la.ty("y"), [la.tz("z", name="ball", mass=1.0)]]], [la.Drag("ball", 0.3, **AIR)])
    v = np.array([0.3, 2.0, -1.0])
    w = v - AIR["wind"]
    expected = -0.3 * (w @ w + 0.01) ** 0.75 * w
    np.testing.assert_allclose(mechanism.core.force(np.zeros(3), v, np.zeros(0)), expected, rtol=1e-14)


AIR = {"exponent": 2.5, "wind": (1.0, -0.5, 0.2), "smoothing": 0.1}


# All of them


ELEMENTS = {
    "(0, 0, -9.81) m/s^2 on cart, bob": la.Gravity(frames=["cart", "bob"]),
    "cart to bob, 2 N m^2": la.InverseSquareGravity("cart", "bob", 2.0),
    "cart to bob, 5 N/m, length 0.5 m": la.LinearSpring("cart", "bob", 5.0, length=0.5),
    "2 x - theta, stiffness 5, rest 0": la.JointSpring({"x": 2.0, "theta": -1.0}, 5.0),
    "world to mast about y, 5 N m/rad, rest 0.1 rad": la.TorsionalSpring("world", "mast", 5.0, axis="y", rest=0.1),
    "post to bob, force over 0 to 3": la.NonlinearSpring(["post", "bob"], CURVE),
    "post to cart to bob, 5 N/m, length 1 m, tension only": la.ElasticString(["post", "cart", "bob"], 5.0, 1.0),
    "post to bob, rope": la.PathLength(["post", "bob"], "rope"),
    "post to bob, 2 m": la.Distance("post", "bob", 2.0),
    "bob on the plane of post across (0, 1, 1)": la.PointOnPlane("post", "bob", normal=(0, 1, 1)),
    "bob on the line of post along x": la.PointOnLine("post", "bob"),
    "bob on post about z, planar": la.HingeLoop("bob", "post", planar=True),
    "mast turned like world": la.FixedOrientation("world", "mast"),
    "mast at a fixed rotation from world": la.FixedOrientation("world", "mast", rotation=ROTATION),
    "x - 0.1 theta = 0.2": la.Coupling({"x": 1.0, "theta": -0.1}, offset=0.2),
    "bob at x = px, z = pz": la.PrescribedPath("bob", x="px", z="pz"),
    "theta, c1 0.1, c3 0.2": la.NonlinearDamping("theta", (0.1, 0.2)),
    "cart to bob, 0.3 N s/m": la.LinearDamper("cart", "bob", 0.3),
    "theta, 0.3 beyond a speed of 0.01": la.CoulombFriction("theta", force=0.3, speed=0.01),
    "bob, force (u, 0, 1) N": la.BodyWrench("bob", force=("u", 0, 1)),
    "bob, torque (0, 0, t) N m": la.HybridWrench("bob", torque=(0, 0, "t")),
    "bob, force (0, 0, 1) N, torque (1, 0, 0) N m": la.SpatialWrench(
        "bob", force=(0, 0, 1), torque=np.array([1.0, 0.0, 0.0])
    ),
    "u along post to bob, gain 2, force by length": la.TendonForce(["post", "bob"], "u", gain=2.0, force_length=CURVE),
    "bob, coefficient 0.1, exponent 2, wind (1, 0, 0) m/s": la.Drag("bob", 0.1, wind=(1, 0, 0)),
}


@pytest.mark.parametrize("text", ELEMENTS)
def test_how_an_element_reads_and_that_it_is_a_value(text):
    element = ELEMENTS[text]
    assert element.describe() == text
    again = pickle.loads(pickle.dumps(element))
    assert again == element
    assert hash(again) == hash(element)
    assert f"{type(element).__name__}: {text}\n" in str(Mechanism(tree(), [element]))


def test_they_all_fit_in_one_mechanism_with_finite_numbers_and_named_parameters():
    mechanism = Mechanism(tree(), list(ELEMENTS.values()))
    rng = np.random.default_rng(0)
    q, v = rng.uniform(0.1, 0.5, (2, mechanism.nq))
    assert np.isfinite(mechanism.energy(q, v).total)
    assert np.isfinite(mechanism.constraint_jacobian(q)).all()
    assert np.isfinite(mechanism.core.force(q, v, np.ones(mechanism.nu))).all()
    again = pickle.loads(pickle.dumps(mechanism))
    assert again.elements == mechanism.elements

    _, values = compiled(*ELEMENTS.values())
    assert len(values) == len(set(values))
    for name in values:
        element, _, field = name.rpartition(").")
        assert f"{element})" in mechanism.elements, name
        assert field
    for name, element in mechanism.elements.items():
        numbers = [
            field
            for field in ("stiffness", "rest", "coefficient", "strength", "offset", "gain", "speed")
            if getattr(element, field, None) is not None
        ]
        assert {f"{name}.{field}" for field in numbers} <= set(values)


# Numbers that are not fields: the mechanism keeps them beside the elements.
BESIDE = {"mass.cart", "mass.bob", "scale"}


@pytest.mark.parametrize("text", ELEMENTS)
def test_a_parameter_that_changes_is_the_element_described_with_it(text):
    mechanism = Mechanism(tree(), [ELEMENTS[text]])
    (name,) = mechanism.elements
    own = {p: v for p, v in mechanism.parameters.items() if p.startswith(f"{name}.")}
    assert set(own) == set(compiled(ELEMENTS[text])[1])
    q = np.linspace(0.2, 0.9, mechanism.nq)
    for parameter, old in own.items():
        value = 1.1 * old + 0.01
        changed = mechanism.with_parameters({parameter: value})
        assert changed.parameters == {**mechanism.parameters, parameter: value}
        if parameter.removeprefix(f"{name}.") in BESIDE:
            continue
        described = Mechanism(tree(), list(changed.elements.values()))
        assert described.parameters == changed.parameters
        assert described.energy(q, q).total == changed.energy(q, q).total
        np.testing.assert_array_equal(described.constraint_values(q), changed.constraint_values(q))
        u = np.ones(mechanism.nu)
        np.testing.assert_array_equal(described.core.force(q, q, u), changed.core.force(q, q, u))


def test_a_spring_keeps_its_length_and_a_refused_number_is_an_error():
    spring = Mechanism(tree(), [la.LinearSpring("post", "bob", 2.0, length=1.0, name="s")])
    with pytest.raises(DescriptionError, match="'s': length: got 0"):
        spring.with_parameters({"s.length": 0.0})
    for element, parameter in (
        (la.LinearSpring("post", "bob", 2.0, name="e"), "e.stiffness"),
        (la.Damping(0.1, name="e"), "e.x"),
        (la.NonlinearDamping("x", (1.0, 2.0), name="e"), "e.c3"),
        (la.Drag("bob", 1.0, name="e"), "e.coefficient"),
    ):
        with pytest.raises(DescriptionError, match=r"'e'.*-1"):
            Mechanism(tree(), [element]).with_parameters({parameter: -1.0})


@pytest.mark.parametrize("far", [1.0, 1e6, 1e300])
def test_frames_that_only_turn_about_each_other_have_no_distance(far):
    options = {"mass": 1.0, "inertia": (1.0, 1.0, 1.0)}
    axis = {"axis": (1.0, 2.0, 3.0), "point": (0.3, -far, 0.2)}
    description = [
        la.revolute("a", **axis, **options, name="arm"),
        [pose(translation=(0.3, -far, 0.2), rotation=ROTATION, name="joint")],
        pose(translation=(0.3, -far, 0.2), name="eye"),
        [la.ball("b", axes="xyz", name="ball", **options), [la.tz(1e-3 * far, name="off")]],
    ]
    context = plan(flatten(description), []).context()
    assert far == 1e300 or context.always_together("joint", "eye")
    assert context.always_together("eye", "ball")
    assert not context.always_together("joint", "off")
    assert not context.always_together("joint", "arm")


def test_equal_elements_have_parameters_of_their_own():
    spring = la.LinearSpring("post", "bob", 2.0)
    _, values = compiled(spring, spring)
    assert values == {"spring(post, bob).stiffness": 2.0, "spring(post, bob)#2.stiffness": 2.0}
    context = plan(flatten(tree()), [spring, spring]).emit(Recorder())
    assert len(set(context.parameters.values())) == 2


def test_a_string_may_be_called_like_the_variable_of_its_length():
    string = la.Distance("world", "bob", "rope", name="rope")
    description = [tx("x"), [la.ty("y", name="bob", mass=2.0)]]
    mechanism = Mechanism(description, [la.Gravity((0.0, -10.0, 0.0)), string])
    vi = la.MidpointVI(mechanism)
    start = vi.start(mechanism.configuration({"y": -1.0, "rope": 1.0}))
    run = vi.simulate(start, 0.01 * np.arange(5), rho=np.ones((5, 1)))
    tensions = run.tensions()["rope"]
    np.testing.assert_allclose(tensions, [10.0, 20.0, 20.0, 20.0], rtol=1e-10)
