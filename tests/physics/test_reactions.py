"""The wrench in every joint: against Pinocchio's recursion, and by the balance of forces."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import (
    Damping,
    ElasticString,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    ball,
    equilibrium,
    project_configuration,
    rx,
    rz,
    simulate,
    tx,
    ty,
    tz,
)
from leastaction.mechanics.mechanism.reactions import reactions
from physics.laws import G


def test_against_the_recursion_of_pinocchio(rng: np.random.Generator) -> None:
    pin = pytest.importorskip("pinocchio")
    from oracles.pinocchio_models import mechanism_of

    model = pin.buildSampleModelManipulator()
    m = mechanism_of(model)
    q, v, a = (rng.normal(size=(4, m.nq)) for _ in range(3))
    found = reactions(m, q, v, a, np.zeros((4, m.n_inputs)), np.zeros((4, 0)))
    for k in range(4):
        data = model.createData()
        pin.rnea(model, data, q[k], v[k], a[k])
        pin.forwardKinematics(model, data, q[k])
        for j in range(1, model.njoints):
            turn, wrench = data.oMi[j].rotation, found[model.names[j]][k]
            local = np.concatenate([turn.T @ wrench[:3], turn.T @ wrench[3:]])
            assert local == pytest.approx(data.f[j].vector, rel=1e-9, abs=1e-9)


def test_of_ball_and_free_joints_against_the_recursion_of_pinocchio(rng: np.random.Generator) -> None:
    """A free body with an arm: a ball joint, a hinge and another ball joint."""
    pin = pytest.importorskip("pinocchio")
    from oracles.pinocchio_models import mechanism_of

    model, parent = pin.Model(), 0
    kinds = pin.JointModelFreeFlyer, pin.JointModelSpherical, pin.JointModelRY, pin.JointModelSpherical
    for i, kind in enumerate(kinds):
        parent = model.addJoint(parent, kind(), pin.SE3.Random(), f"joint {i}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Random())
    m, data = mechanism_of(model, quaternions=True), model.createData()
    for _ in range(3):
        their_q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
        q, at = [], 0
        for kind in kinds:
            size = kind().nq
            part, at = their_q[at : at + size], at + size
            q += [*part[:-4], *np.roll(part[-4:], 1)] if size >= 4 else [*part]
        v, a = rng.normal(size=(2, m.nv))
        # Their velocity of a free body is in its own axes.
        R = pin.Quaternion(their_q[3:7]).matrix()
        their_v, their_a = v.copy(), a.copy()
        their_v[:3], their_a[:3] = R.T @ v[:3], R.T @ a[:3] - np.cross(v[3:6], R.T @ v[:3])
        pin.rnea(model, data, their_q, their_v, their_a)
        pin.forwardKinematics(model, data, their_q)
        found = reactions(m, np.array([q]), v[None], a[None], np.zeros((1, m.n_inputs)), np.zeros((1, 0)))
        assert len(found) == 7  # three slides, and one for each rotation
        for j in range(1, model.njoints):
            turn, wrench = data.oMi[j].rotation, found[model.names[j]][0]
            local = np.concatenate([turn.T @ wrench[:3], turn.T @ wrench[3:]])
            assert local == pytest.approx(data.f[j].vector, rel=1e-9, abs=1e-9)


def test_of_a_ball_joint_is_that_of_its_three_angles() -> None:
    """In a run, to second order; and the bearing of a top at rest carries its weight."""
    body = {"mass": 0.7, "com": (0.05, 0.0, -0.3), "inertia": (0.02, 0.03, 0.01)}
    runs = []
    for axes in ("quaternion", "xyz"):
        m = Mechanism(
            [tx("s", mass=0.3), [ball("b", axes=axes, name="body", **body)]], [Gravity(), JointSpring("s", 9.0)]
        )
        vi = MidpointVI(m)
        start = vi.start(m.configuration({"s": 0.1}), [0.2, 1.0, -0.5, 2.0])
        runs.append(vi.simulate(start, np.linspace(0.0, 1.0, 2001)).reactions())
    assert np.abs(runs[0]["body"] - runs[1]["body"]).max() < 1e-4
    assert np.ptp(runs[0]["body"], axis=0)[:3].min() > 0.1


def four_bar() -> Mechanism:
    crank = rx("a", mass=0.5, com=(0, 0, -0.2), inertia=(0.01, 0.01, 0.001), name="crank")
    coupler = rx("b", mass=0.8, com=(0, 0, -0.3), inertia=(0.03, 0.03, 0.002), name="coupler")
    rocker = rx("c", mass=0.6, com=(0, 0, -0.25), inertia=(0.02, 0.02, 0.002), name="rocker")
    tree = [crank, [tz(-0.4), [coupler, [tz(-0.6, name="P")]]], ty(0.5), [rocker, [tz(-0.5, name="Q")]]]
    return Mechanism(tree, [Gravity(), JointSpring("a", 1.0), PointToPoint("P", "Q", "yz", name="loop")])


def test_a_linkage_at_rest_hangs_on_its_two_bearings() -> None:
    m = four_bar()
    rest = equilibrium(m, project_configuration(m, [-0.3, 1.4, 0.2], attempts=5).q).q
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(rest), np.linspace(0.0, 0.05, 6))
    found = run.reactions()
    assert set(found) == {"crank", "coupler", "rocker"}
    carried = found["crank"][1] + found["rocker"][1]
    assert carried[:3] == pytest.approx([0.0, 0.0, 1.9 * G], abs=1e-6)
    # The spring of the crank's own bearing is what turns there.
    assert found["crank"][1][3] == pytest.approx(-rest[m.variables.index("a")], abs=1e-6)
    assert found["coupler"][1][3] == pytest.approx(0.0, abs=1e-6)


def test_a_body_in_motion_by_newton_and_by_both_kinds_of_time() -> None:
    """Newton's law for the bob of a driven, damped pendulum on a slide, which an elastic string pulls too."""
    tree = [
        tx("s", mass=1.0, name="slide"),
        [rz("yaw", name="head"), [rx("a", name="arm"), [tz(-1.0, mass=2.0, name="bob")]]],
    ]
    string = ElasticString(["hook", "bob"], 20.0, 0.5, tension_only=False, name="string")
    m = Mechanism(
        [*tree, ty(1.0, name="hook")],
        [Gravity(), JointForce("a", input="u"), Damping({"a": 0.3, "yaw": 0.2}), string, JointSpring("s", 50.0)],
    )
    q0, v0, t = [0.1, 0.3, 0.8], [0.5, 1.0, -0.5], np.linspace(0.0, 1.0, 2001)
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(q0, v0), t, inputs=[0.7])
    places = run["bob"]
    a = np.diff(places, 2, axis=0) / (t[1] - t[0]) ** 2
    between = m.positions(run.q, ["hook"])[1:-1, 0] - places[1:-1]
    length = np.linalg.norm(between, axis=1, keepdims=True)
    pulled = 20.0 * (length - 0.5) * between / length
    needed = 2.0 * (a + np.array([0.0, 0.0, G])) - pulled
    found = run.reactions()
    assert np.abs(found["arm"][:, :3] - needed).max() < 1e-4
    c = simulate(m, q0, v0, t[::100], inputs=[0.7]).reactions()
    for name in ("slide", "head", "arm"):
        assert np.abs(found[name][99::100] - c[name][1:-1]).max() < 1e-3
