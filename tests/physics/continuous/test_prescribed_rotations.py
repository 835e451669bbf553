"""Rotations that are prescribed as quaternions in continuous time: a bar that a hand turns, and its twin of angles."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from leastaction.mechanics import (
    ContinuousDynamics,
    ContinuousTrajectory,
    Gravity,
    IntegrationStatus,
    Mechanism,
    MidpointVI,
    PrescribedMotion,
    ball,
    gain_to_continuous,
    gain_to_discrete,
    legendre_jacobian,
    rz,
    simulate,
    to_continuous,
    to_discrete,
    tx,
    tz,
)
from leastaction.mechanics.mechanism.turns import moved
from leastaction.numerics.arrays import Array
from leastaction.numerics.rotations import body_accelerations, body_rates, product

TIGHT = {"rtol": 1e-10, "atol": 1e-11}
T = np.linspace(0.0, 0.5, 11)


def angles(t: float) -> Array:
    """Return angles about x, y, z and both their derivatives, (3, 3)."""
    return np.array([
        [0.6 * np.sin(5.0 * t), 0.4 * np.sin(4.0 * t + 0.3), 2.0 * t],
        [3.0 * np.cos(5.0 * t), 1.6 * np.cos(4.0 * t + 0.3), 2.0],
        [-15.0 * np.sin(5.0 * t), -6.4 * np.sin(4.0 * t + 0.3), 0.0],
    ])  # fmt: skip


@cache
def quaternions(t: float) -> Array:
    """Return the quaternion of these angles and both its derivatives, (3, 4), by the rule of products."""
    out = np.array([[1.0, 0.0, 0.0, 0.0], [0.0] * 4, [0.0] * 4])
    for (a, v, acceleration), axis in zip(angles(t).T, np.eye(4)[1:], strict=True):
        turn = np.cos(0.5 * a) * np.eye(4)[0] + np.sin(0.5 * a) * axis
        rate = 0.5 * v * product(turn, axis)
        bent = 0.5 * acceleration * product(turn, axis) - 0.25 * v**2 * turn
        q, dq, ddq = out
        out = np.array([
            product(q, turn),
            product(dq, turn) + product(q, rate),
            product(ddq, turn) + 2.0 * product(dq, rate) + product(q, bent),
        ])  # fmt: skip
    return out


def along(curve) -> PrescribedMotion:
    return PrescribedMotion(*(lambda t, order=order: curve(t)[order] for order in range(3)))


def carried(axes: str) -> Mechanism:
    """Return a chain on a bar that is turned: a hinge, and a ball joint."""
    bar = ball("bar", axes=axes, kinematic=True, mass=0.3, com=(0.1, 0.0, 0.05), inertia=(0.01, 0.02, 0.015))
    upper = rz("swing", name="upper", mass=0.5, com=(0.1, 0.0, -0.2), inertia=(0.02, 0.01, 0.03))
    lower = ball("lower", mass=0.3, com=(0.1, 0.1, 0.0), inertia=(0.01, 0.01, 0.02))
    return Mechanism([bar, [tx(0.4), [upper, [tz(-0.4), [lower]]]]], [Gravity()])


def swung(axes: str, t: Array = T, **options: object) -> ContinuousTrajectory:
    m, curve = carried(axes), quaternions if axes == "quaternion" else angles
    q = np.r_[0.3, 1.0, 0.0, 0.0, 0.0, curve(0.0)[0]]
    given = {"rho": along(curve), **TIGHT, **options}
    run = simulate(m, q, None, t, **given)
    assert run.status is IntegrationStatus.COMPLETED, run.message
    return run


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_it_carries_as_by_three_angles(method: str) -> None:
    tight = {} if method == "DOP853" else {"rtol": 1e-6, "atol": 1e-8}
    one, other = (swung(axes, method=method, **tight) for axes in ("quaternion", "xyz"))
    exact = 1e-8 if method == "DOP853" else 1e-4
    assert np.abs(one.q[:, :5] - other.q[:, :5]).max() < exact
    assert np.abs(one.energy().total - other.energy().total).max() < 10.0 * exact
    assert np.array_equal(one.rho, [quaternions(t)[0] / np.linalg.norm(quaternions(t)[0]) for t in T])
    assert np.ptp(one.energy().total) > 0.1  # the hand does work, which is found
    assert one.balance is not None
    assert abs(one.balance.lost) < 1e-6 * one.balance.scale
    assert one(0.33).shape == (one.mechanism.nx,)
    if method == "Radau":
        assert one.effort.jacobians < one.effort.steps  # Newton's method converges: the Jacobian is right


def test_rates_and_accelerations_of_a_quaternion_of_any_length() -> None:
    """Along a curve of turns about one axis they are known; a length that changes is without effect."""
    t, axis = 0.7, np.array([2.0, -1.0, 2.0]) / 3.0
    angle, rate, bent = np.sin(3.0 * t), 3.0 * np.cos(3.0 * t), -9.0 * np.sin(3.0 * t)
    q = np.r_[np.cos(0.5 * angle), np.sin(0.5 * angle) * axis]
    turn = np.r_[0.0, axis]
    dq = 0.5 * rate * product(q, turn)
    ddq = 0.5 * bent * product(q, turn) - 0.25 * rate**2 * q
    long, growth, more = 1.3, 0.4, -0.7
    grown = long * q, growth * q + long * dq, more * q + 2.0 * growth * dq + long * ddq
    assert np.abs(body_rates(*grown[:2]) - rate * axis).max() < 1e-15 * 10
    assert np.abs(body_accelerations(*grown) - bent * axis).max() < 1e-14 * 10


def test_a_spline_rows_and_accelerations_are_the_same_motion() -> None:
    whole = swung("quaternion")
    m, q0, v0 = whole.mechanism, whole.q[0], whole.v[0]
    fine = np.linspace(0.0, 0.5, 101)
    rows = np.array([quaternions(t)[0] for t in fine])
    longer = make_interp_spline(fine, rows * (1.0 + 0.2 * np.sin(3.0 * fine))[:, None], k=5)
    splined = simulate(m, q0, v0, T, rho=longer, **TIGHT)
    assert np.abs(splined.q - whole.q).max() < 1e-7
    signs = np.where(np.arange(101) % 7 < 3, 1.0, -1.0)[:, None]  # of either sign
    rowed = simulate(m, q0, v0, fine, rho=signs * rows, **TIGHT)
    assert np.abs(rowed.q[::10] - whole.q).max() < 1e-7

    def rho_a(t: float) -> Array:
        return body_accelerations(*quaternions(t))

    driven = simulate(m, q0, v0, T, rho_a=rho_a, **TIGHT)
    assert np.abs(driven.q - whole.q).max() < 1e-8
    assert np.abs(driven.a[:, m.nd :] - whole.rho_a).max() < 1e-8


def test_conversions_are_of_second_order() -> None:
    run = swung("quaternion")
    m, vi = run.mechanism, MidpointVI(run.mechanism, threads=1)
    off = []
    for steps in (50, 100):
        t = np.linspace(0.0, 0.5, steps + 1)
        there = to_discrete(run, vi, t)
        back = to_continuous(there)
        sampled = to_discrete(run, vi, t, sampled=True)
        k = steps // 2
        step = vi.step(sampled.state(k), 0.5 / steps, rho_next=sampled.rho[k + 1]).state
        inner = slice(3, -3)
        off.append([
            np.abs(there.q[-1] - run.q[-1]).max(),
            np.abs(back.v - run(t)[:, m.nq :]).max(),
            np.abs(back.a - np.array([_accelerations(run, at) for at in t]))[inner].max(),
            np.abs(there.v_rho[1:] - sampled.v_rho[1:]).max() + 1e-30,
            np.abs(step.q - sampled.q[k + 1]).max(),
        ])  # fmt: skip
    orders = np.log2(np.array(off[0]) / np.array(off[1]))
    assert np.abs(orders[:3] - 2.0).max() < 0.35, orders
    assert off[1][3] < 1e-12
    assert orders[4] > 2.6, orders


def _accelerations(run: ContinuousTrajectory, t: float) -> Array:
    x, u, m = run(t), run.input(t), run.mechanism
    a = ContinuousDynamics(m).accelerations(x[: m.nq], x[m.nq :], u[: m.n_inputs], u[m.n_inputs :]).a
    return np.r_[a, u[m.n_inputs :]]


def test_gains_go_there_and_back() -> None:
    m, dt, rng = carried("quaternion"), 0.1, np.random.default_rng(6)
    q = moved(m, m.configuration()[None], rng.standard_normal((1, m.nv)))[0]
    v, K = rng.standard_normal(m.nv), rng.standard_normal((3, m.nx))
    there = gain_to_discrete(m, q, v, K, dt)
    assert there.shape == (3, m.ndx)
    back = gain_to_continuous(m, q, v, there, dt)
    dx = rng.standard_normal(m.ndx)
    small = 1e-6 * dx
    near = np.r_[moved(m, q[None], small[None, : m.nv])[0], v + small[m.nv :]] - np.r_[q, v]
    assert np.abs((back - K) @ near).max() < 1e-10
    # A step turns by what the velocity makes of it, and the acceleration.
    du = -there @ (legendre_jacobian(m, q, v) @ dx)
    assert np.abs(du - (dt * dx[m.nv + m.nd :] - dt**2 * K @ near / 1e-6)).max() < 1e-4
