"""The Euler singularity of ball joints is seen, named, and only seen where it matters."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from leastaction.errors import SingularityWarning
from leastaction.mechanics import Mechanism, MidpointVI, ball, free, rx, ry, rz, tz, var
from leastaction.mechanics.mechanism.singularity import NEAR

BODY = {"mass": 1.0, "inertia": (0.4, 0.5, 0.6)}


def turning(mechanism, name, angle, rate, t, **others):
    """Simulate from one angle with one angular velocity, and some more angles."""
    vi = MidpointVI(mechanism)
    start = vi.start(mechanism.configuration({name: angle, **others}), mechanism.configuration({name: rate}))
    return vi.simulate(start, t)


def test_a_motion_through_the_singularity_warns_with_joint_angle_step_and_time():
    mechanism = Mechanism([ball("hip", axes="xyz", **BODY)])
    t = np.linspace(0.0, 1.0, 101)
    with pytest.warns(SingularityWarning) as caught:
        motion = turning(mechanism, "hip.ry", 1.0, 1.0, t)
    assert len(caught) == 1
    # pi/2 - 0.05 - 1 = 0.5208 s after the start.
    message = str(caught[0].message)
    assert "the ball joint 'hip'" in message
    assert "step 53, t = 0.53 s" in message
    assert f"(hip.ry) is {np.degrees(motion['hip.ry'][53]):.2f} degrees" in message
    assert "at 90 its outer and inner axis are parallel, so that hip.rx and hip.rz" in message
    assert caught[0].filename == __file__.replace(".pyc", ".py")
    assert abs(motion["hip.ry"][52] - np.pi / 2) > NEAR > abs(motion["hip.ry"][53] - np.pi / 2)


def test_a_motion_that_stays_away_does_not_warn():
    mechanism = Mechanism([free("torso", axes="xyz", **BODY)])
    turning(mechanism, "torso.ry", 0.0, 1.0, np.linspace(0.0, 1.0, 101))
    # Other angles may be what they like.
    turning(mechanism, "torso.rx", 1.4, 1.0, np.linspace(0.0, 1.0, 101))


@pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning")
def test_a_long_step_over_the_singularity_is_seen_too():
    mechanism = Mechanism([ball("hip", axes="xyz", **BODY)])
    for angle, rate in ((1.4, 4.0), (-1.4, -4.0), (1.8, -4.0)):
        with pytest.warns(SingularityWarning, match=r"'hip'.*step 1, t = 0\.1 s"):
            turning(mechanism, "hip.ry", angle, rate, [0.0, 0.1, 0.2])


def test_proper_euler_angles_are_singular_at_zero():
    mechanism = Mechanism([free("top", axes="zxz", **BODY)])
    t = np.linspace(0.0, 0.1, 11)
    with pytest.warns(SingularityWarning, match=r"'top'.*\(top.rx\) is 1.72 degrees.* at 0 its"):
        turning(mechanism, "top.rx", 0.03, 0.0, t)
    with pytest.warns(SingularityWarning, match=r"is 177.* at 180 its"):
        turning(mechanism, "top.rx", np.radians(177.5), 0.0, t)
    turning(mechanism, "top.rx", np.pi / 2, 0.0, t)


def test_the_angle_counts_not_the_variable():
    half = Mechanism([ball(["a", 0.5 * var("b") + 0.1, "c"], name="hip", **BODY)])
    with pytest.warns(SingularityWarning, match=r"\(0.5 b \+ 0.1\) is 90.00 degrees"):
        turning(half, "b", 2 * (np.pi / 2 - 0.1), 0.1, [0.0, 0.01])
    turning(half, "b", np.pi / 2, 0.1, [0.0, 0.01])


def test_every_joint_warns_once_and_prescribed_ones_never():
    # The angles of a prescribed joint are given, so nothing has to be found where they are singular.
    mechanism = Mechanism([
        ball("one", axes="xyz", **BODY), [ball("two", axes="xyz", **BODY)],
        ball("held", axes="xyz", kinematic=True, **BODY),
        ball("led", axes="xyz", kinematic=["led.rx"], **BODY),
    ])  # fmt: skip
    near = {f"{name}.ry": 1.55 for name in ("one", "two", "held", "led")}
    vi = MidpointVI(mechanism)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        vi.simulate(vi.start(mechanism.configuration(near)), np.linspace(0, 0.1, 11))
    assert [w.category for w in caught] == [SingularityWarning] * 2
    assert ["'one'" in str(caught[0].message), "'two'" in str(caught[1].message)] == [True, True]


def test_a_single_step_warns():
    mechanism = Mechanism([tz(1.0), [ball("hip", axes="xyz", **BODY)]])
    vi = MidpointVI(mechanism)
    state = vi.start([0.0, 1.5, 0.0], [0.0, 1.0, 0.0])
    state = vi.step(state, 0.02).state  # 1.52: 0.0508 from the singularity
    with pytest.warns(SingularityWarning, match=r"'hip'.*at t = 0\.03 s: .*is 87\.66 degrees") as caught:
        vi.step(state, 0.01)
    assert "step" not in str(caught[0].message).split(":")[0]
    assert caught[0].filename == __file__


def test_three_rotations_that_are_no_ball_are_not_watched():
    mechanism = Mechanism([rx("a", **BODY), [ry("b", **BODY), [rz("c", **BODY)]]])
    assert mechanism.balls == ()
    turning(mechanism, "b", 1.57, 0.1, [0.0, 0.01])


@pytest.mark.parametrize("axes", ["xyz", "zxy", "zxz"])
def test_near_the_singularity_angles_turn_as_much_faster_as_is_said(axes):
    mechanism = Mechanism([ball("b", axes=axes, **BODY)])
    for d in (1.0, 0.3, NEAR):
        q = [0.4, mechanism.balls[0].singular + d, -0.7]
        J = mechanism.frame_jacobian(q, "b")[3:]
        rates = np.linalg.inv(J)
        assert np.abs(np.linalg.norm(rates, axis=1)[[0, 2]] - 1 / np.sin(d)).max() < 1e-10
        assert np.linalg.eigvalsh(J.T @ J)[0] == pytest.approx(1 - np.cos(d), rel=1e-10)
    assert 1 / np.sin(NEAR) == pytest.approx(20, rel=1e-3)


def test_the_warning_is_as_wide_as_accuracy_suffers_and_part_of_the_run():
    """A body that turns at 5 rad/s with steps of 10 ms, against its rotation as a quaternion."""
    inertia = np.array([0.1, 0.25, 0.3])
    mechanism = Mechanism([ball("b", axes="xyz", mass=1.0, inertia=tuple(inertia))])
    vi, t = MidpointVI(mechanism), 0.01 * np.arange(101)

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        i, j, k, s = y[:4]
        spin = np.array([[s, -k, j], [k, s, -i], [-j, i, s], [-i, -j, -k]]) @ y[4:]
        return np.concatenate([0.5 * spin, -np.cross(y[4:], inertia * y[4:]) / inertia])

    rng = np.random.default_rng(0)
    quiet, warned = [], []
    for _ in range(30):
        q = rng.uniform(-1.0, 1.0, 3) * [3.0, 0.8, 3.0]
        w = rng.normal(size=3)
        w *= 5.0 / np.linalg.norm(w)
        turned = [Rotation.from_euler("XYZ", q + 1e-6 * e) for e in np.eye(3)]
        here = Rotation.from_euler("XYZ", q)
        by_angles = np.array([(here.inv() * r).as_rotvec() / 1e-6 for r in turned]).T
        y0 = np.concatenate([here.as_quat(), w])
        y = solve_ivp(rates, (0.0, 1.0), y0, rtol=1e-9, atol=1e-10, method="DOP853").y[:4, -1]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            run = vi.simulate(vi.start(q, np.linalg.solve(by_angles, w)), t)
        end = Rotation.from_euler("XYZ", run.q[-1])
        error = (Rotation.from_quat(y).inv() * end).magnitude()
        told = [w for w in caught if w.category is SingularityWarning]
        assert len(run.singularities) == len(told)
        assert all(message in str(run) for message in run.singularities)
        (warned if told else quiet).append(error)
    assert len(quiet) > 15
    assert max(quiet) < 0.02
    assert max(warned) > 0.03
