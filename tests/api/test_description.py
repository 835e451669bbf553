"""Descriptions come out as the mechanism that they draw."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

from api.recorder import Recorder
from conformance.loader import load_case
from leastaction.errors import ArgumentError, UnitWarning
from leastaction.mechanics import (
    Body,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    pose,
    prismatic,
    revolute,
    rx,
    ry,
    rz,
    screw,
    twist,
    tx,
    ty,
    tz,
    var,
    world,
)
from leastaction.mechanics.description.flattening import flatten
from leastaction.mechanics.mechanism.compilation import plan


def cart():
    return [tx("x", name="cart", mass=10.0), [rz("theta"), [ty(-1.0, name="bob", mass=1.0)]]]


def branched():
    """Every kind of frame, in several branches."""
    return [
        tz(0.3), [
            rx("a", mass=1.0, com=(0.1, 0.2, 0.3), inertia=(0.3, 0.4, 0.5, 0.01, 0.02, 0.03)), [
                pose(translation=(0.1, -0.2, 0.3), rotation=rotation()), [
                    ty("b", name="slide", mass=2.0), [tx(0.1), tx(0.1, mass=0.5)],
                    ry(0.4), [rz("k", kinematic=True), [tx(1.0, name="tip", mass=0.1)]],
                ],
                tz(-0.5), [rz("c"), [tx(0.7, mass=1.0, inertia=(0.1, 0.1, 0.1))]],
            ],
        ],
        tx("d", name="other", mass=3.0),
    ]  # fmt: skip


def rotation():
    """Return a rotation of no special form."""
    q, r = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def recorded(description, elements=(), **orders):
    recorder = Recorder()
    plan(flatten(description), elements, **orders).emit(recorder)
    return recorder


def test_nested_and_chained_descriptions_are_the_same_mechanism():
    tree = world()
    tree.tx("x", name="cart", mass=10.0).rz("theta").ty(-1.0, name="bob", mass=1.0)
    nested, chained = Mechanism(cart()), Mechanism(tree)
    assert chained.frames == nested.frames == ("world", "cart", "rz(theta)", "bob")
    assert chained.variables == nested.variables == ("x", "theta")
    assert str(chained) == str(nested)
    q, v = np.array([0.3, 0.7]), np.array([1.1, -0.4])
    assert chained.energy(q, v) == nested.energy(q, v)


def test_any_place_of_a_chain_stands_for_the_whole_tree():
    tip = world().tx("x", name="cart", mass=10.0).rz("theta").ty(-1.0, name="bob", mass=1.0)
    assert Mechanism(tip).frames == Mechanism(tip.root).frames


def test_nested_lists_and_chains_mix():
    tree = world()
    tree.tx("x", name="cart", mass=10.0).add([rz("theta"), [ty(-1.0, name="bob", mass=1.0)]])
    assert str(Mechanism(tree)) == str(Mechanism(cart()))


def test_compiled_calls_of_the_cart():
    elements = [Gravity((0, -9.8, 0)), Damping({"x": 0.01}), JointForce("theta", input="u")]
    calls = recorded([*cart()], elements)
    assert [(parent, variable) for parent, _, _, variable in calls.joints] == [(-1, 0), (0, 1)]
    np.testing.assert_array_equal(calls.joints[0][2], [1, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(calls.joints[1][2], [0, 0, 0, 0, 0, 1])
    # The constant frame of the bob is merged into the pendulum's joint.
    (_, m1, c1, _), (joint, m2, c2, _) = calls.bodies
    assert (joint, m1, m2) == (1, 10.0, 1.0)
    np.testing.assert_array_equal(c1, [0, 0, 0])
    np.testing.assert_array_equal(c2, [0, -1, 0])
    np.testing.assert_array_equal(calls.gravity, [0, -9.8, 0])
    assert calls.damping == [(0, 0.01)]
    assert calls.forces == [(1, 0)]


def test_joints_are_in_preorder_with_contiguous_subtrees():
    assert recorded(branched()).subtrees_are_contiguous()


def test_poses_agree_with_an_independent_product_of_transformations():
    mechanism = Mechanism(branched())
    recorder = recorded(branched())
    axis = {"x": 0, "y": 1, "z": 2}
    for q in np.random.default_rng(0).uniform(-2.0, 2.0, (5, mechanism.nq)):
        values = mechanism.named(q)
        worlds = [np.eye(4)]
        for frame in mechanism.tree.frames[1:]:
            spec = frame.frame
            amount = None if spec.coordinate is None else spec.coordinate.value(values)
            local = np.eye(4)
            if spec.matrix is not None:
                local = spec.matrix
            elif spec.transform[0] == "t":
                local[axis[spec.transform[1]], 3] = amount
            else:
                # Rodrigues' formula, another way than the package's.
                e = np.eye(3)[axis[spec.transform[1]]]
                cross = np.cross(np.eye(3), e)
                local[:3, :3] += np.sin(amount) * cross + (1 - np.cos(amount)) * cross @ cross
            worlds.append(worlds[frame.parent] @ local)
        for name, expected in zip(mechanism.frames, worlds, strict=True):
            np.testing.assert_allclose(mechanism.frame_pose(q, name), expected, atol=1e-14)
        np.testing.assert_allclose(mechanism.core.joint_poses(q[None])[0], recorder.joint_poses(q), atol=1e-14)


def test_bodies_turn_with_the_constant_frames_that_carry_them():
    inertia = np.array([[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])
    turn = rotation()
    calls = recorded(
        [rz("a"), [pose(translation=(1, 2, 3), rotation=turn, mass=2.0, com=(0.1, 0.2, 0.3),
                        inertia=(0.3, 0.4, 0.5, 0.01, 0.02, 0.03))]]
    )  # fmt: skip
    _, _, com, moved = calls.bodies[0]
    np.testing.assert_allclose(com, turn @ [0.1, 0.2, 0.3] + [1, 2, 3], atol=1e-15)
    np.testing.assert_allclose(moved, turn @ inertia @ turn.T, atol=1e-15)


def test_inertia_by_three_six_and_nine_numbers():
    three, six = Body(1, inertia=(1, 2, 3)), Body(1, inertia=(1, 2, 3, 0, 0, 0))
    nine = Body(1, inertia=np.diag([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(three.inertia, six.inertia)
    np.testing.assert_array_equal(three.inertia, nine.inertia)
    assert Body(1, inertia=(2, 2, 3, 0.1, 0.2, 0.3)).inertia[0].tolist() == [2.0, 0.1, 0.2]


def test_several_bodies_on_a_frame_add_up():
    two = Mechanism([rx("a", bodies=[Body(1.0, com=(0, 1, 0)), Body(2.0, com=(0, -1, 0))])])
    assert two.mass_matrix([0.3])[0, 0] == pytest.approx(3.0, rel=1e-15)


def test_names_of_unnamed_frames_are_readable_and_follow_the_tree():
    assert Mechanism(branched()).frames == (
        "world",
        "world/tz(0.3)",
        "rx(a)",
        "rx(a)/pose",
        "slide",
        "slide/tx(0.1)",
        "slide/tx(0.1)#2",
        "rx(a)/pose/ry(0.4)",
        "rz(k)",
        "tip",
        "rx(a)/tz(-0.5)",
        "rz(c)",
        "rz(c)/tx(0.7)",
        "other",
    )


def test_variables_come_in_the_order_of_the_tree_or_as_asked():
    mechanism = Mechanism(branched())
    assert mechanism.dynamic == ("a", "b", "c", "d")
    assert mechanism.kinematic == ("k",)
    assert (mechanism.nd, mechanism.nrho, mechanism.nq, mechanism.nx) == (4, 1, 5, 10)
    other = Mechanism(branched(), dynamic=["d", "b", "a", "c"])
    assert other.variables == ("d", "b", "a", "c", "k")
    values = {"a": 0.1, "b": 0.2, "c": 0.3, "d": 0.4, "k": 0.5}
    q1, q2 = mechanism.configuration(values), other.configuration(values)
    np.testing.assert_allclose(mechanism.positions(q1), other.positions(q2), atol=1e-15)
    order = [mechanism.variables.index(name) for name in other.variables]
    np.testing.assert_allclose(other.mass_matrix(q2), mechanism.mass_matrix(q1)[np.ix_(order, order)], atol=1e-14)


def test_inputs_are_shared_by_name_and_ordered_as_asked():
    forces = [JointForce("x", input="p"), JointForce("theta", input="q")]
    assert Mechanism(cart(), forces).inputs == ("p", "q")
    assert Mechanism(cart(), forces, inputs=["q", "p"]).inputs == ("q", "p")
    shared = [JointForce("x", input="p"), JointForce("theta", input="p")]
    assert Mechanism(cart(), shared).nu == 1


def test_damping_for_all_for_some_and_for_the_others():
    assert recorded(cart(), [Damping(0.2)]).damping == [(0, 0.2), (1, 0.2)]
    assert recorded(cart(), [Damping({"theta": 0.3})]).damping == [(1, 0.3)]
    assert recorded(cart(), [Damping({"theta": 0.3}, default=0.1)]).damping == [(0, 0.1), (1, 0.3)]


def test_a_length_may_be_a_kinematic_variable_of_its_own():
    elements = [Distance("world", "bob", "rope", name="string")]
    mechanism = Mechanism(cart(), elements)
    assert mechanism.kinematic == ("rope",)
    assert mechanism.constraints == ("string",)
    assert recorded(cart(), elements).distances == [(0, 1, 0.0, 2)]
    q = mechanism.configuration({"x": 3.0, "theta": np.pi, "rope": 3.0})
    assert mechanism.constraint_residuals(q)["string"] == pytest.approx(3**2 + 1 - 9)
    # By x: 2 px. By theta: the bob at the top of its circle moves along -x. By rope: -2 L.
    np.testing.assert_allclose(mechanism.constraint_jacobian(q), [[6.0, -6.0, -6.0]], atol=1e-12)
    assert mechanism.degrees_of_freedom(q) == 1


def test_points_are_shared_between_constraints():
    elements = [Distance("world", "bob", 1.0), Distance("cart", "world", 1.0)]
    assert len(recorded(cart(), elements).points) == 3


def test_constraints_without_a_name_are_numbered():
    twice = [Distance("world", "bob", 1.0), Distance("world", "bob", 1.0)]
    names = ("distance(world, bob)", "distance(world, bob)#2")
    assert Mechanism(cart(), twice).constraints == names


def test_questions_take_one_configuration_or_a_batch():
    mechanism = Mechanism(branched(), [Gravity(), Distance("tip", "other", 1.0, name="rod")])
    q = np.random.default_rng(1).normal(size=(4, mechanism.nq))
    v = np.random.default_rng(2).normal(size=(4, mechanism.nq))
    poses, points = mechanism.frame_pose(q, "tip"), mechanism.positions(q, ["tip", "world"])
    energy, residual = mechanism.energy(q, v), mechanism.constraint_residuals(q)
    for k in range(4):
        np.testing.assert_array_equal(poses[k], mechanism.frame_pose(q[k], "tip"))
        np.testing.assert_array_equal(points[k], mechanism.positions(q[k], ["tip", "world"]))
        assert energy.total[k] == mechanism.energy(q[k], v[k]).total
        assert residual["rod"][k] == mechanism.constraint_residuals(q[k])["rod"]
    assert mechanism.positions(q).shape == (4, len(mechanism.frames), 3)
    assert mechanism.named(q)["b"].tolist() == q[:, 1].tolist()
    assert mechanism.named(q[2]) == dict(zip(mechanism.variables, q[2].tolist(), strict=True))


def test_energy_momentum_and_inertia_of_the_cart_in_closed_form():
    mechanism = Mechanism(cart(), [Gravity((0.0, -9.8, 0.0))])
    q, v = np.array([0.4, 0.9]), np.array([0.7, -1.3])
    c = np.cos(q[1])
    inertia = np.array([[11.0, c], [c, 1.0]])
    np.testing.assert_allclose(mechanism.mass_matrix(q), inertia, rtol=1e-14)
    np.testing.assert_allclose(mechanism.momentum(q, v), inertia @ v, rtol=1e-14)
    energy = mechanism.energy(q, v)
    assert energy.kinetic == pytest.approx(0.5 * v @ inertia @ v, rel=1e-14)
    assert energy.potential == pytest.approx(-9.8 * c, rel=1e-14)
    assert energy.total == energy.kinetic + energy.potential


def test_a_configuration_takes_any_one_number():
    mechanism = Mechanism(cart())
    for value in (0.1, np.float64(0.1), np.array(0.1), np.float32(0.1), 1):
        assert mechanism.configuration({"x": value})[0] == value
    for wrong in (np.array([0.1]), np.array("0.1"), np.array(1j), "0.1"):
        with pytest.raises(ArgumentError, match=r"'x'.*expected a number"):
            mechanism.configuration({"x": wrong})


def test_the_number_of_inputs_has_its_old_name_too():
    mechanism = Mechanism(cart(), [JointForce("x", input="F")])
    assert mechanism.n_inputs == mechanism.nu == mechanism.core.n_inputs == 1


def test_configuration_and_named_are_inverse():
    mechanism = Mechanism(branched())
    q = mechanism.configuration({"k": 0.5, "a": -1}, default=2)
    assert mechanism.named(q) == {"a": -1.0, "b": 2.0, "c": 2.0, "d": 2.0, "k": 0.5}
    np.testing.assert_array_equal(mechanism.configuration(mechanism.named(q)), q)


def test_a_mechanism_is_immutable_and_compared_by_what_it_is():
    mechanism = Mechanism(cart())
    with pytest.raises(AttributeError, match="immutable"):
        mechanism.nd = 3
    with pytest.raises(AttributeError, match="immutable"):
        mechanism.anything = 3
    with pytest.raises(AttributeError, match="immutable"):
        del mechanism.nd
    mechanism.elements.clear()
    with pytest.raises(ValueError, match="read-only"):
        mechanism.tree.frames[1].pose[0, 0] = 2.0
    with pytest.raises(AttributeError, match="immutable"):
        mechanism.tree.frames[1].frame.bodies[0].mass = -1.0
    assert copy.copy(mechanism) is mechanism
    assert copy.deepcopy([mechanism])[0] is mechanism
    assert len({mechanism, Mechanism(cart())}) == 1


def test_later_changes_of_the_description_do_not_reach_the_mechanism():
    tree = world()
    tree.tx("x", mass=1.0)
    mechanism = Mechanism(tree)
    tree.ty("y", mass=1.0)
    coefficients = {"x": 1.0}
    damping = Damping(coefficients)
    coefficients["x"] = 9.0
    assert mechanism.variables == ("x",)
    assert damping.named["x"] == 1.0


def test_a_pickled_mechanism_is_the_same_again():
    elements = [Gravity(), Damping({"a": 0.1}), Distance("tip", "other", "rope", name="string")]
    mechanism = Mechanism(branched(), elements, dynamic=["d", "b", "a", "c"])
    again = pickle.loads(pickle.dumps(mechanism))
    assert str(again) == str(mechanism)
    q = np.random.default_rng(4).normal(size=mechanism.nq)
    np.testing.assert_array_equal(again.positions(q), mechanism.positions(q))
    assert again.energy(q, q) == mechanism.energy(q, q)
    assert again.elements == mechanism.elements


def test_the_printed_view_shows_the_tree_and_the_elements():
    mechanism = Mechanism(
        [*cart(), rx("k", kinematic=True)],
        [Damping(0.1), Distance("world", "bob", 1.5, name="rope"), JointForce("x", input="push")],
    )
    assert str(mechanism).splitlines() == [
        "world",
        "├── cart  tx(x)  [10 kg]",
        "│   └── rz(theta)",
        "│       └── bob  ty(-1)  [1 kg]",
        "└── rx(k)  kinematic",
        "Damping: every dynamic variable 0.1",
        "Distance 'rope': world to bob, 1.5 m",
        "JointForce: push on x",
        "dynamic (2): x, theta",
        "kinematic (1): k",
        "inputs (1): push",
        "constraints (1): rope",
    ]
    assert repr(mechanism) == "<Mechanism: 5 frames, nd 2, nrho 1, n_inputs 1, nc 1>"


def test_a_chain_deeper_than_python_recurses():
    description = [tx(0.1, mass=1.0)]
    for k in range(1500):
        description = [rz(f"q{k}"), [tx(1.0, mass=1.0), description]]
    flat = flatten(description)
    assert len(flat.joints) == 1500
    assert flat.joints[-1].variables == ("q0",)


def test_a_mechanism_may_be_all_prescribed_or_all_dynamic():
    prescribed = Mechanism([rx("k", kinematic=True, mass=1.0)])
    assert (prescribed.nd, prescribed.nrho) == (0, 1)
    assert prescribed.energy([0.2], [0.0]).kinetic == 0.0
    with pytest.raises(ArgumentError, match="got shape"):
        prescribed.energy([0.2, 0.1], [0.0])


def test_the_conformance_loader_reads_every_kind_of_frame(tmp_path):
    frames = [
        {"name": "World", "parent": None, "transform": "world"},
        {"name": "c", "parent": "World", "transform": "const", "matrix": np.eye(4).tolist()},
        {"name": "f", "parent": "c", "transform": "rx", "config": "q"},
        {"name": "m", "parent": "f", "transform": "ty", "value": 2.0, "mass": 3.0,
         "inertia": [0.1, 0.2, 5.0]},
        {"name": "g", "parent": "m", "transform": "tz", "config": "k"},
    ]  # fmt: skip
    case = {
        "dynamic_configs": ["q"], "kinematic_configs": ["k"], "inputs": ["u"], "frames": frames,
        "potentials": [{"type": "gravity", "vector": [0, 0, -9.8]}],
        "forces": [{"type": "config_force", "config": "q", "input": "u"}],
        "constraints": [{"type": "distance", "frames": ["World", "g"], "length": 2.0}],
    }  # fmt: skip
    (tmp_path / "case.json").write_text(json.dumps(case))
    np.savez(tmp_path / "case.npz", dt=0.01)
    mechanism, arrays, waiting = load_case(tmp_path / "case.json")
    assert waiting == []
    assert float(arrays["dt"]) == 0.01
    assert mechanism.variables == ("q", "k")
    assert mechanism.frames[0] == "World"
    assert mechanism.mass_matrix([0.0, 0.0])[0, 0] == pytest.approx(3.0 * 4.0 + 0.1)
    case["forces"].append({"type": "unheard_of"})
    (tmp_path / "case.json").write_text(json.dumps(case))
    assert load_case(tmp_path / "case.json").waiting == ["unheard_of"]


def test_a_pose_with_a_name_or_a_body_coincides_with_its_parent():
    for make in (
        lambda: pose(name="marker"),
        lambda: pose(name="marker", mass=1.0),
        lambda: world().pose(name="marker").frame,
    ):
        frame = make()
        assert frame.name == "marker"
        np.testing.assert_array_equal(frame.matrix, np.eye(4))
    assert pose(mass=2.0).bodies[0].mass == 2.0
    mechanism = Mechanism([tx("x", mass=1.0), [pose(name="marker")]])
    np.testing.assert_array_equal(mechanism.positions([0.5], ["marker"]), [[0.5, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("make", "angle"),
    [
        (lambda: rz(90), "90"),
        (lambda: rz("a", offset=-45.0), "-45"),
        (lambda: rx(2.0 * var("a") + 180.0), "180"),
        (lambda: revolute(30.0, axis="x"), "30"),
        (lambda: screw(-90.0, axis="x", pitch=0.1), "-90"),
        (lambda: twist(45.0, angular=(0.0, 0.0, 2.0)), "90"),
        (lambda: world().ry(90), "90"),
    ],
)
def test_degrees_where_radians_belong_are_noticed(make, angle):
    with pytest.warns(UnitWarning, match=rf"{angle} rad is more than a full turn.*np\.radians"):
        make()


def test_ordinary_angles_and_long_ways_are_not_taken_for_degrees():
    rz(2.0 * np.pi), rz(-2.0 * np.pi), tz(90.0), prismatic(-500.0, axis="x")
    twist(90.0, linear=(1.0, 0.0, 0.0))
    rz({"a": 100.0})
