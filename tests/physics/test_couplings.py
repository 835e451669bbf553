"""Joints whose coordinate is a linear expression of variables: against constraints, by hand and by the chain rule."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import (
    Body,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    ball,
    free,
    prismatic,
    project_velocity,
    revolute,
    rx,
    ry,
    rz,
    screw,
    twist,
    tx,
    ty,
    tz,
    universal,
    var,
)
from leastaction.mechanics.elements import Coupling

GRAVITY = Gravity((0.3, -9.8, 0.5))
AXIS, POINT = (0.3, -1.2, 0.7), (0.2, 0.5, -0.4)
HEAVY = {"mass": 0.7, "com": (0.1, -0.2, 0.3), "inertia": (0.3, 0.4, 0.5, 0.01, -0.02, 0.03)}


# The chain rule: a coupled mechanism is one of independent joints at s = E q + s0.

AMOUNTS = (
    var("a"),
    2.0 * var("a") - 0.5 * var("b") + 0.3,
    var("k") - 0.7,
    -var("b") + 1.5 * var("k") + 0.1,
    0.3 * var("c"),
    var("c") - var("a") + 0.2 * var("k"),
    var("b"),
)


def tree_of(amounts, kinematic):
    """One tree with seven joints of every kind, whatever moves them."""

    def given(i):
        return {"value": amounts[i], "kinematic": [n for n in amounts[i].names if n in kinematic]}

    return [
        rz(**given(0), name="f0", **HEAVY), [
            tx(1.0), [
                revolute(**given(1), axis=AXIS, point=POINT, name="f1", **HEAVY), [
                    ry(**given(2), name="f2"), [screw(**given(3), axis="x", pitch=0.2, name="f3", **HEAVY)],
                    prismatic(**given(4), axis=AXIS, name="f4", bodies=[Body(1.0), Body(0.5, com=(1, 0, 0))])],
            ],
        ],
        twist(**given(5), linear=(0.1, 0.2, 0.3), angular=(0.5, -0.4, 1.2), name="f5", **HEAVY), [
            tx(**given(6), name="f6", **HEAVY)],
    ]  # fmt: skip


def coupled_and_independent():
    strings = [Distance("f3", "f6", 1.0, name="string"), Distance("f4", "world", "k", name="wound")]
    coupled = Mechanism(tree_of(AMOUNTS, {"k"}), [GRAVITY, *strings])
    own = [var(f"s{i}") for i in range(7)]
    independent = Mechanism(tree_of(own, set()), [GRAVITY, Distance("f3", "f6", 1.0)])
    E, s0 = coupled.tree.coupling(range(7), coupled.variables)
    assert coupled.variables == ("a", "b", "c", "k")
    assert independent.variables == tuple(f"s{i}" for i in range(7))
    assert np.count_nonzero(E) == 11
    return coupled, independent, E, s0


def test_derivatives_of_the_lagrangian_follow_the_chain_rule():
    coupled, independent, E, s0 = coupled_and_independent()
    rng = np.random.default_rng(21)
    for q, v, dq, dv in rng.uniform(-1.5, 1.5, (3, 4, 4)):
        s, r, ds, dr = E @ q + s0, E @ v, E @ dq, E @ dv
        np.testing.assert_allclose(coupled.core.joint_poses(q[None]), independent.core.joint_poses(s[None]), atol=1e-14)
        one, other = coupled.energy(q, v), independent.energy(s, r)
        assert one.total == pytest.approx(other.total, rel=1e-13)
        for mine, theirs in zip(coupled.core.gradient(q, v), independent.core.gradient(s, r), strict=True):
            np.testing.assert_allclose(mine, E.T @ theirs, rtol=1e-12, atol=1e-12)
        for mine, theirs in (
            *zip(coupled.core.hessian(q, v), independent.core.hessian(s, r), strict=True),
            *zip(coupled.core.third(q, v, dq, dv), independent.core.third(s, r, ds, dr), strict=True),
        ):
            np.testing.assert_allclose(mine, E.T @ theirs @ E, rtol=1e-11, atol=1e-11)


def test_constraints_follow_the_chain_rule():
    coupled, independent, E, s0 = coupled_and_independent()
    for q in np.random.default_rng(22).uniform(-1.5, 1.5, (3, 4)):
        s = E @ q + s0
        assert coupled.constraint_values(q)[0] == pytest.approx(independent.constraint_values(s)[0], abs=1e-12)
        np.testing.assert_allclose(
            coupled.constraint_jacobian(q)[0], independent.constraint_jacobian(s)[0] @ E, atol=1e-12
        )
        # The length of the other string is a variable that also moves joints: both parts count.
        apart = coupled.positions(q, ["f4"])[0]
        J = coupled.frame_jacobian(q, "f4")[:3]
        expected = 2.0 * apart @ J - 2.0 * q[3] * np.eye(4)[3]
        np.testing.assert_allclose(coupled.constraint_jacobian(q)[1], expected, atol=1e-12)
        np.testing.assert_allclose(
            coupled.core.constraint_hessian(q, np.array([1.3, 0.0])),
            E.T @ independent.core.constraint_hessian(s, np.array([1.3])) @ E,
            atol=1e-12,
        )


def test_exact_derivatives_of_a_coupled_step_against_differences():
    mechanism = Mechanism(
        tree_of(AMOUNTS, {"k"}),
        [GRAVITY, Damping(0.3), JointForce("a", input="u"), JointForce("c", input="w")],
    )
    vi = MidpointVI(mechanism)
    rng = np.random.default_rng(23)
    motion = vi.simulate(
        vi.start(rng.uniform(-1, 1, 4), rng.uniform(-1, 1, 4)), [0.0, 0.02], inputs=[0.5, -0.7],
        rho=motion_of_k(rng),
    )  # fmt: skip
    d = vi.linearize(motion)
    x, u = motion.x[0], motion.u[0]

    def end(x, u):
        state = type(motion.last)(0.0, x[:4], x[4:7], x[7:])
        return vi.step(state, 0.02, inputs=u[:2], rho_next=u[2:]).state.x

    h = 1e-6
    for i in range(len(x)):
        step = h * np.eye(len(x))[i]
        np.testing.assert_allclose(d.A[0][:, i], (end(x + step, u) - end(x - step, u)) / (2 * h), atol=1e-6)
    for i in range(len(u)):
        step = h * np.eye(len(u))[i]
        np.testing.assert_allclose(d.B[0][:, i], (end(x, u + step) - end(x, u - step)) / (2 * h), atol=1e-6)


def motion_of_k(rng):
    first = rng.uniform(-1, 1)
    return [[first + 0.01]]


# By hand


def test_a_mimic_joint_that_turns_back_leaves_the_inertia_out():
    """A plate on a parallel linkage does not turn: its inertia is that of a point, ``m l^2``."""
    plate = {"mass": 2.0, "inertia": (1.0, 1.0, 1.0)}
    linkage = [rz("a"), [ty(-1.5), [rz(-var("a"), name="plate", **plate)]]]
    mechanism = Mechanism(linkage, [Gravity((0, -9.8, 0))])
    for q in (0.0, 0.7, -2.0):
        assert mechanism.mass_matrix([q])[0, 0] == pytest.approx(2.0 * 1.5**2, rel=1e-14)
    pendulum = Mechanism([rz("a"), [ty(-1.5, mass=2.0)]], [Gravity((0, -9.8, 0))])
    t = np.linspace(0, 3, 301)
    one, other = (MidpointVI(m).simulate(MidpointVI(m).start([1.0]), t) for m in (mechanism, pendulum))
    np.testing.assert_allclose(one.q, other.q, atol=1e-10)
    assert np.abs(np.diff(one.q[:, 0])).max() > 0.01


def test_a_gear_train_has_the_inertia_of_its_ratio():
    rotor = {"mass": 1.0, "inertia": (0.1, 0.1, 0.2)}
    mechanism = Mechanism(
        [rz("motor", **rotor), tx(1.0), [rz(-0.25 * var("motor") + 0.5, name="wheel", **rotor)]],
        [JointForce("motor", input="torque"), Damping({"motor": 0.05})],
    )
    inertia = 0.2 + 0.25**2 * 0.2
    assert mechanism.mass_matrix([0.3])[0, 0] == pytest.approx(inertia, rel=1e-14)
    vi = MidpointVI(mechanism)
    t = np.linspace(0.0, 2.0, 2001)
    motion = vi.simulate(vi.start([0.0]), t, inputs=[0.8])
    # I a = T - c v
    expected = 0.8 / 0.05 * (t - inertia / 0.05 * (1.0 - np.exp(-0.05 / inertia * t)))
    np.testing.assert_allclose(motion["motor"], expected, atol=1e-6)
    np.testing.assert_allclose(mechanism.frame_velocity([0.3], [2.0], "wheel"), [0, 0, 0, 0, 0, -0.5], atol=1e-15)


def test_a_nut_falls_on_its_screw():
    """``(I + m h^2) a = m g h``; the screw by its pitch and as a coupling of two simple joints."""
    nut = {"mass": 2.0, "inertia": (0.1, 0.1, 0.02)}
    whole = Mechanism([screw("s", axis="z", point=(0.3, 0, 0), pitch=-0.05, com=(0.3, 0, 0), **nut)], [Gravity()])
    parts = Mechanism([tx(0.3), [tz(-0.05 * var("s")), [rz("s", **nut)]]], [Gravity()])
    t = np.linspace(0.0, 1.0, 101)
    acceleration = 2.0 * 9.81 * 0.05 / (0.02 + 2.0 * 0.05**2)
    for mechanism in (whole, parts):
        vi = MidpointVI(mechanism)
        gravity = mechanism.energy([1.0], [0.0]).potential - mechanism.energy([0.0], [0.0]).potential
        scale = -gravity / (2.0 * 9.81 * 0.05)  # whatever g the default is
        motion = vi.simulate(vi.start([0.0]), t)
        np.testing.assert_allclose(motion["s"], 0.5 * acceleration * scale * t**2, atol=1e-10)
    assert scale == pytest.approx(1.0, rel=0.01)


# Against constraints


def test_a_coupling_is_the_same_coupling_held_by_a_constraint():
    def arm(elbow, wrist):
        return [
            rz("shoulder", **HEAVY), [
                tx(1.0), [rz(elbow, **HEAVY), [tx(0.7), [ry(wrist, name="hand", **HEAVY)]]]],
            ty("slide", **HEAVY),
        ]  # fmt: skip

    ratio = -1.5 * var("shoulder") + 0.4
    lean = 0.5 * var("shoulder") + 2.0 * var("slide")
    forces = [GRAVITY, JointForce("shoulder", input="u")]
    coupled = Mechanism(arm(ratio, lean), forces)
    held = Mechanism(
        arm("elbow", "wrist"),
        [
            *forces,
            Coupling({"shoulder": 1.5, "elbow": 1.0}, offset=0.4),
            Coupling({"wrist": 1.0, "shoulder": -0.5, "slide": -2.0}),
        ],
    )
    values, rates = {"shoulder": 0.3, "slide": -0.2}, {"shoulder": 0.7, "slide": 0.5}
    full = values | {"elbow": ratio.value(values), "wrist": lean.value(values)}
    # Velocities have no offset.
    full_rates = rates | {"elbow": -1.05, "wrist": 0.35 + 1.0}
    t = np.linspace(0.0, 2.0, 401)
    torque = np.sin(3.0 * 0.5 * (t[1:] + t[:-1]))[:, None]
    one, other = MidpointVI(coupled), MidpointVI(held)
    start = other.start(held.configuration(full), held.configuration(full_rates))
    short = one.simulate(one.start(coupled.configuration(values), coupled.configuration(rates)), t, inputs=torque)
    long = other.simulate(start, t, inputs=torque)
    # The constrained scheme projects its start; the midpoint rule commutes with a linear coupling.
    for name in ("shoulder", "slide"):
        np.testing.assert_allclose(short[name], long[name], atol=1e-9)
    np.testing.assert_allclose(ratio.value({"shoulder": short["shoulder"]}), long["elbow"], atol=1e-9)
    assert np.ptp(short["shoulder"]) > 1.0


def test_a_coupling_of_both_kinds_is_the_two_joints_behind_each_other():
    """``rz(a + k)`` is ``rz(k)`` and then ``rz(a)``: the same motion and the same momenta."""
    t = np.linspace(0.0, 2.0, 201)
    prescribed = np.sin(2.0 * t)[:, None]
    mixed = [
        tz(0.2),
        [rz({"a": 1.0, "k": 1.0}, kinematic=["k"], **HEAVY), [tx(1.0), [ry("b", **HEAVY)]]],
    ]
    apart = [tz(0.2), [rz("k", kinematic=True), [rz("a", **HEAVY), [tx(1.0), [ry("b", **HEAVY)]]]]]
    motions = []
    for description in (mixed, apart):
        mechanism = Mechanism(description, [GRAVITY, Damping(0.1)])
        vi = MidpointVI(mechanism)
        q, v = mechanism.configuration({"a": 0.4, "b": -0.3}), mechanism.configuration({"k": 2.0})
        motions.append(vi.simulate(vi.start(q, v), t, rho=prescribed))
    np.testing.assert_allclose(motions[0].x, motions[1].x, atol=1e-10)
    assert np.ptp(motions[0]["a"]) > 0.5


def test_a_scissor_of_one_variable_stays_closed():
    """Two crossed bars whose angles mirror each other: the constraint that would close them holds by itself."""
    bars = [
        rz("angle", mass=1.0, inertia=(0.1, 0.1, 0.1)), [tx(1.0, name="right", mass=1.0)],
        ty(1.0 * var("lift"), name="pin", mass=1.0),
        tx(2.0), [rz(np.pi - var("angle"), mass=1.0, inertia=(0.1, 0.1, 0.1)), [tx(1.0, name="left", mass=1.0)]],
    ]  # fmt: skip
    mechanism = Mechanism(bars, [Gravity((0, -9.8, 0)), Distance("right", "left", 0.5, name="gap")])
    q = mechanism.configuration({"angle": np.arccos(0.75), "lift": 0.0})
    v = project_velocity(mechanism, q, np.array([0.0, 0.3])).v
    right, left = mechanism.positions(q, ["right", "left"])
    np.testing.assert_allclose(right + left, [2.0, 2.0 * right[1], 0.0], atol=1e-14)
    vi = MidpointVI(mechanism)
    # The gap fixes the angle, so only the pin falls.
    motion = vi.simulate(vi.start(q, v), np.linspace(0, 0.5, 51))
    np.testing.assert_allclose(motion["angle"], q[0], atol=1e-9)
    np.testing.assert_allclose(motion["lift"], 0.3 * motion.t - 4.9 * motion.t**2, atol=1e-9)


# Compositions


def test_compositions_are_their_simple_joints():
    t = np.linspace(0.0, 1.0, 101)
    named = [
        free("f", axes="xyz", **HEAVY), [
            tx(0.3), [universal("u", **HEAVY), [tz(0.4), [ball("b", axes="zyx", **HEAVY)]]],
        ],
    ]  # fmt: skip
    simple = [
        tx("f.x"), [ty("f.y"), [tz("f.z"), [rx("f.rx"), [ry("f.ry"), [rz("f.rz", **HEAVY), [
            tx(0.3), [rx("u.rx"), [ry("u.ry", **HEAVY), [
                tz(0.4), [rz("b.rz"), [ry("b.ry"), [rx("b.rx", **HEAVY)]]]]]]]]]]]]
    ]  # fmt: skip
    v = np.random.default_rng(24).uniform(-1, 1, 11)
    motions = []
    for description in (named, simple):
        mechanism = Mechanism(description, [GRAVITY])
        vi = MidpointVI(mechanism)
        motions.append(vi.simulate(vi.start(np.zeros(11), v), t))
    np.testing.assert_array_equal(motions[0].x, motions[1].x)


def test_a_prescribed_free_joint_carries_what_hangs_on_it():
    """A pendulum on a hand: massless prescribed frames, and only the acceleration of the hand acts."""
    mechanism = Mechanism(
        [free("hand", axes="xyz", kinematic=True), [ry("swing"), [tz(-1.0, name="bob", mass=1.0)]]],
        [Gravity((0, 0, -9.8))],
    )
    assert (mechanism.nd, mechanism.nrho) == (1, 6)
    vi = MidpointVI(mechanism)
    # Pulled along x by 9.8 m/s^2, a pendulum hangs at 45 degrees and stays there.
    t = np.linspace(0.0, 1.0, 101)
    rho = np.zeros((101, 6))
    rho[:, 0] = 4.9 * t**2
    q = mechanism.configuration({"swing": np.pi / 4})
    motion = vi.simulate(vi.start(q), t, rho=rho)
    np.testing.assert_allclose(motion["swing"], np.pi / 4, atol=1e-9)
