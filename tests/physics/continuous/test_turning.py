"""Rotations that are quaternions in continuous time: simulation, constraints, the same motion otherwise described."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from leastaction.mechanics import (
    BodyWrench,
    ContinuousDynamics,
    ContinuousTrajectory,
    Distance,
    Feedback,
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    ball,
    free,
    gain_to_continuous,
    gain_to_discrete,
    legendre_jacobian,
    project_velocity,
    simulate,
    to_continuous,
    to_discrete,
    to_momentum,
    to_velocity,
    tx,
    tz,
)
from leastaction.mechanics.mechanism.turns import moved
from physics.test_quaternions import COM, INERTIA, SPIN, TURNED, by_equations, heavy_top, turns

TIGHT = {"rtol": 1e-12, "atol": 1e-13}


def turns_of(run: ContinuousTrajectory, name: str) -> Rotation:
    return Rotation.from_quat(np.stack([run[f"{name}.q{letter}"] for letter in "xyzw"], axis=-1))


@pytest.mark.parametrize("method", ["DOP853", "Radau", "LSODA"])
def test_heavy_top_is_that_of_eulers_equations(method: str) -> None:
    tight = TIGHT if method == "DOP853" else {"rtol": 1e-9, "atol": 1e-11}
    run = simulate(heavy_top(), TURNED, SPIN, np.linspace(0.0, 2.0, 21), method=method, **tight)
    assert (by_equations(2.0).inv() * turns_of(run, "top")[-1]).magnitude() < (1e-10 if method == "DOP853" else 1e-6)
    # At the instants and between them.
    lengths = np.linalg.norm(np.vstack([run.q, run(np.linspace(0.0, 2.0, 301))[:, :4]]), axis=1)
    assert np.abs(lengths - 1.0).max() < 4e-16
    assert np.ptp(run.energy().total) < 1e-6 * abs(run.energy().total[0])
    assert run.balance is not None
    assert abs(run.balance.lost) < 1e-6 * run.balance.scale
    assert np.abs(run.a - ContinuousDynamics(run.mechanism).accelerations(run.q, run.v).a).max() < 1e-13
    if method == "Radau":
        assert run.effort.jacobians < run.effort.steps  # Newton's method converges: the Jacobian is right


def test_nut_flips_as_eulers_equations_say() -> None:
    moments, start = np.array([0.2, 0.3, 0.4]), np.array([1e-3, 8.0, 1e-3])
    nut = Mechanism([free("nut", axes="quaternion", mass=0.7, inertia=moments)])
    t = np.linspace(0.0, 8.0, 81)
    run = simulate(nut, nut.configuration(), [0.0, 0.0, 0.0, *start], t, rtol=3e-14, atol=1e-15)
    exact = solve_ivp(
        lambda _, w: -np.cross(w, moments * w) / moments, (0.0, 8.0), start, "DOP853", t, rtol=3e-14, atol=1e-16
    )
    assert np.abs(run.v[:, 3:] - exact.y.T).max() < 1e-8
    assert run.v[:, 4].min() < -7.9
    angular = turns_of(run, "nut").apply(moments * run.v[:, 3:])
    assert np.ptp(angular, axis=0).max() < 1e-9


def linked(axes: str) -> Mechanism:
    """Two links on ball joints, of which the lower is tied to the world by a rod and driven."""
    lower = ball("lower", axes=axes, name="low", mass=0.5, com=(0.0, 0.02, -0.3), inertia=(0.02, 0.02, 0.01))
    upper = ball("upper", axes=axes, name="top", mass=0.8, com=(0.03, 0.0, -0.2), inertia=(0.03, 0.02, 0.02))
    tree = [upper, [tz(-0.4), [lower, [tz(-0.5, name="tip")]]], tx(0.6, name="peg")]
    return Mechanism(
        tree,
        [
            Gravity(),
            Distance("tip", "peg", float(np.hypot(0.6, 0.9)), name="rod"),
            BodyWrench("low", force=(0.0, "pull", 0.0)),
        ],
    )


def test_a_closed_loop_moves_as_with_angles() -> None:
    """Where these are regular: constraints, forces, multipliers, prescribed inputs, in the same run."""
    t = np.linspace(0.0, 0.5, 26)
    runs = []
    for axes in ("quaternion", "xyz"):
        m = linked(axes)
        q = m.configuration()
        v = project_velocity(m, q, [0.5, 0.3, -1.0, 0.2, 0.4, 0.7]).v
        runs.append(simulate(m, q, v, t, inputs=lambda at: [0.5 * np.sin(7.0 * at)], **TIGHT))
    poses = [run.mechanism.frame_pose(run.q, "tip") for run in runs]
    assert np.abs(poses[0] - poses[1]).max() < 1e-8
    assert np.abs(runs[0].lam - runs[1].lam).max() < 1e-7 * np.abs(runs[1].lam).max()
    assert max(drift.h for drift in runs[0].drift.values()) < 1e-12
    assert abs(runs[0].balance.lost) < 1e-6 * runs[0].balance.scale


def test_a_pinned_body_is_a_ball_joint() -> None:
    """Held at a point by multipliers, it moves as the top whose point is a joint."""
    body = free("body", axes="quaternion", mass=1.1, com=COM, inertia=INERTIA)
    m = Mechanism([body, tx(0.0, name="point")], [Gravity(), PointToPoint("body", "point", name="pin")])
    run = simulate(m, [0.0, 0.0, 0.0, *TURNED], [0.0, 0.0, 0.0, *SPIN], [0.0, 1.0], **TIGHT)
    assert (by_equations(1.0).inv() * turns_of(run, "body")[-1]).magnitude() < 1e-8


def test_both_kinds_of_time() -> None:
    m = linked("quaternion").with_exchanged({"rod": ()})
    rng = np.random.default_rng(2)
    q = moved(m, m.configuration()[None], rng.standard_normal((1, 6)))[0]
    v = rng.standard_normal(6)
    p = to_momentum(m, q, v)
    assert np.abs(to_velocity(m, q, p) - v).max() < 1e-12
    # How momenta change with turns and velocities, against differences.
    T, h = legendre_jacobian(m, q, v), 1e-3
    for i in range(12):
        e = np.eye(12)[i]
        ends = [to_momentum(m, moved(m, q[None], k * h * e[None, :6])[0], v + k * h * e[6:]) for k in (1, -1, 2, -2)]
        slope = (8.0 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12.0 * h)
        assert np.abs(T[6:, i] - slope).max() < 1e-9
    K = rng.standard_normal((1, m.nx))
    there = gain_to_discrete(m, q, v, K, 0.01)
    assert there.shape == (1, m.ndx)
    back = gain_to_continuous(m, q, v, there, 0.01)
    # What acts along changes of length is left out: there are none.
    small = 1e-6 * rng.standard_normal(12)
    x, near = np.r_[q, v], np.r_[moved(m, q[None], small[None, :6])[0], v + small[6:]]
    assert np.abs((back - K) @ (near - x)).max() < 1e-10
    run = simulate(m, q, v, np.linspace(0.0, 0.2, 41), **TIGHT)
    off = []
    for every in (2, 1):
        other = to_discrete(run, MidpointVI(m), run.t[::every])
        off.append(np.abs(other.q[-1] - run.q[-1]).max())
        again = to_continuous(other)
        off.append(np.abs(again.v - run.v[::every]).max())
        assert np.abs(np.linalg.norm(again(0.033)[:4]) - 1.0) < 1e-15
    assert 3.5 < off[0] / off[2] < 4.5
    assert 3.0 < off[1] / off[3] < 5.0


def test_under_feedback() -> None:
    """A law of the state, whose Jacobian an implicit method uses, stops a spinning body."""
    torque = BodyWrench("body", torque=("a", "b", "c"))
    m = Mechanism([ball("body", axes="quaternion", mass=1.0, inertia=(0.2, 0.3, 0.4))], [torque])
    K = np.hstack([np.zeros((3, 1)), 8.0 * np.eye(3), 2.0 * np.eye(3)])
    law = Feedback(K, np.r_[1.0, np.zeros(6)], np.zeros(3))
    runs = [
        simulate(m, TURNED, [1.0, -2.0, 0.5], [0.0, 6.0], u=law, method=method, rtol=1e-9)
        for method in ("DOP853", "Radau")
    ]
    assert turns_of(runs[0], "body")[-1].magnitude() < 1e-3
    assert np.abs(runs[0].x - runs[1].x).max() < 1e-6
    assert np.abs(turns(runs[0], "body")[0].magnitude() - 2.0 * np.pi / 3.0) < 1e-12
