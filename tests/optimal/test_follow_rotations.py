"""Wanted turns of joints and orientations of frames are followed, all the way round."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction import BodyWrench, Gravity, JointForce, Mechanism, ball, follow, free, rx, ry, rz, tz
from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.mechanics import MidpointVI
from leastaction.optimal import QuadraticCost, check_derivatives
from leastaction.systems import MidpointSystem, OrientationCost

T = np.linspace(0.0, 1.0, 51)
BODY = {"mass": 0.5, "inertia": (2e-3, 3e-3, 4e-3)}
ROUND = 2.0 * np.pi * (3.0 - 2.0 * T) * T**2


def shoulder() -> Mechanism:
    """An arm on a ball joint, turned by torques in the axes of its upper bone, with an elbow."""
    arm = [ball("shoulder", axes="quaternion", name="upper", com=(0.0, 0.0, -0.1), **BODY), [tz(-0.2), [
        rx("elbow", name="fore", com=(0.0, 0.0, -0.1), **BODY), [tz(-0.2, name="hand")]]]]  # fmt: skip
    return Mechanism(
        arm, [Gravity(), BodyWrench("upper", torque=tuple("abc")), JointForce("elbow", input="elbow motor")]
    )


def test_a_joint_is_turned_all_the_way_round() -> None:
    swing = Rotation.from_rotvec(ROUND[:, None] * [0.6, 0.8, 0.0])
    found = follow(shoulder(), {"shoulder": swing.as_quat(scalar_first=True), "elbow": 0.5 - 0.5 * np.cos(ROUND)},
                   {"shoulder": 100.0, "elbow": 100.0}, t=T)  # fmt: skip
    assert found.result.success
    assert max(found.errors.values()) < 0.01
    made = Rotation.from_quat(found.result.x[:, :4], scalar_first=True)
    assert found.errors["shoulder"] == pytest.approx(np.sqrt(np.mean((swing.inv() * made).magnitude() ** 2)), rel=1e-6)


def test_frames_are_turned_and_placed_as_wanted() -> None:
    m = Mechanism([free("body", axes="quaternion", **BODY)], [BodyWrench("body", tuple("xyz"), tuple("abc"))])
    R = Rotation.from_rotvec(ROUND[:, None] * [0.0, 0.6, 0.8])
    place = np.stack([T**2, 0.0 * T, np.sin(T) ** 2], axis=1)
    found = follow(m, {"body": R.as_matrix()}, {"body": 100.0}, t=T)
    assert found.result.success
    assert found.errors["body"] < 0.01
    both = follow(m, {"world": place * 0.0, "body": R.as_matrix()}, {"body": 100.0}, t=T)
    assert both.errors["world"] == 0.0
    only = follow(m, {"body": place}, {"body": 1000.0}, t=T)
    assert only.errors["body"] < 0.01


def test_orientations_are_reached_by_joints_that_nothing_is_said_of() -> None:
    tree = [rz("a", name="first", **BODY), [ry("b", name="second", **BODY), [rx("c", name="third", **BODY)]]]
    m = Mechanism(tree, [JointForce(name, input=f"motor {name}") for name in "abc"])
    R = Rotation.from_euler("ZYX", np.stack([0.8 * ROUND / 6.0, 0.5 * ROUND / 6.0, -0.4 * ROUND / 6.0], axis=1))
    found = follow(m, {"third": R.as_matrix()}, {"third": 1000.0}, t=T)
    assert found.result.success
    assert found.errors["third"] < 1e-2
    assert found["a"][-1] == pytest.approx(0.8 * ROUND[-1] / 6.0, abs=0.02)


def test_what_is_no_rotation_is_told() -> None:
    m = shoulder()
    with pytest.raises(ArgumentError, match="motion: 'shoulder': got a quaternion of length 2"):
        follow(m, {"shoulder": np.tile([2.0, 0.0, 0.0, 0.0], (51, 1))}, t=T)
    with pytest.raises(ArgumentError, match="motion: 'hand': got a matrix that is no rotation"):
        follow(m, {"hand": np.tile(np.diag([1.0, 1.0, 2.0]), (51, 1, 1))}, t=T)
    with pytest.raises(ArgumentError, match="motion: 'hand': got part of a rotation at t = 0 s, expected whole"):
        follow(m, {"hand": np.tile(np.diag([1.0, 1.0, np.nan]), (51, 1, 1))}, t=T)
    with pytest.raises(ArgumentError, match="nothing is called 'shuolder'"):
        follow(m, {"shuolder": np.zeros((51, 4))}, t=T)


def test_rotations_with_gaps_are_followed_through_what_is_known() -> None:
    """Of a joint by its quaternion and of a frame by its own, as of markers that were hidden for a while."""
    m = Mechanism([free("body", **BODY)], [BodyWrench("body", tuple("xyz"), tuple("abc"))])
    whole = Rotation.from_rotvec(ROUND[:, None] * [0.0, 0.6, 0.8])
    quaternions = np.roll(whole.as_quat(), 1, axis=1)
    hidden = (T > 0.3) & (T < 0.5)
    gappy, matrices = quaternions.copy(), whole.as_matrix()
    gappy[hidden], matrices[hidden] = np.nan, np.nan
    tail = Mechanism([free("body", **BODY), [tz(0.1, name="tail")]], [BodyWrench("body", tuple("xyz"), tuple("abc"))])
    for machine, name, given in ((m, "body", gappy), (tail, "tail", gappy), (tail, "tail", matrices)):
        found = follow(machine, {name: given}, {name: 100.0}, t=T)
        assert found.result.success
        assert found.errors[name] < 0.01
        assert np.isnan(found.wanted[name][hidden]).all()
        made = Rotation.from_quat(np.roll(found.result.x[:, 3:7], -1, axis=1))
        off = (whole.inv() * made).magnitude()
        assert off[hidden].max() < 0.1  # the way that costs least is near what was hidden
    # Of keyframes all but a few instants.
    keys = np.full_like(quaternions, np.nan)
    keys[[0, 25, 50]] = quaternions[[0, 25, 50]]
    found = follow(m, {"body": keys}, {"body": 100.0}, t=T)
    assert found.result.success
    assert found.errors["body"] < 0.01


def test_a_price_on_orientations_has_none_where_they_are_left_out() -> None:
    m = shoulder()
    system = MidpointSystem(MidpointVI(m), T)
    rng = np.random.default_rng(2)
    R = Rotation.from_rotvec(rng.standard_normal((51, 3))).as_matrix()
    R[10:20] = np.nan
    rest = np.eye(system.nx)[0]
    still = QuadraticCost(rest, np.zeros(4), Q=np.zeros(system.ndx), R=np.ones(4), space=system)
    cost = OrientationCost(still, system, {"hand": R}, {"hand": [1.0, 2.0, 3.0]})
    x = np.tile(system.integrator.start(m.configuration({"elbow": 0.7})).x, (51, 1))
    u = rng.standard_normal((50, 4))
    prices = cost.stage_values(x[:50], u, 0) - still.stage_values(x[:50], u, 0)
    assert np.flatnonzero(np.abs(prices) < 1e-12).tolist() == list(range(10, 20))
    part = cost.window(15, 30, N=50, nu=4)
    np.testing.assert_allclose(part.stage_values(x[15:30], u[15:30], 0), cost.stage_values(x[:50], u, 0)[15:30])
    x = system.rollout(x[0], x, 0.1 * u, np.zeros((50, 4, system.ndx)), 0, 50).x
    assert check_derivatives(system, x, 0.1 * u, cost=cost).ok


def test_a_motion_has_quaternions_by_their_numbers() -> None:
    m = shoulder()
    swing = np.roll(Rotation.from_rotvec(ROUND[:, None] * [0.3, 0.4, 0.0]).as_quat(), 1, axis=1)
    coarse = Motion(m.coordinates, T[::5], np.hstack([swing, 0.5 - 0.5 * np.cos(ROUND)[:, None]])[::5])
    found = follow(m, coarse.resample(0.02), {"shoulder": 100.0, "elbow": 100.0})
    assert found.result.success
    assert set(found.errors) == {"shoulder", "elbow"}
    assert found.errors["shoulder"] < 0.05
