"""Robots with a free flyer whose rotation is a quaternion, and their derivatives by turns, as Pinocchio has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("example_robot_data")
pytest.importorskip("sympy")

import pinocchio as pin

from derivatives.test_continuous_pinocchio import RELATIVE, model_of
from leastaction.mechanics import ContinuousDynamics
from oracles.pinocchio_models import mechanism_of

ROBOTS = ("solo12", "talos")


def off(ours: Any, theirs: Any) -> float:
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_dynamics_and_derivatives(name: str) -> None:
    """Pinocchio's flyer has its linear velocity in the axes of the body: theirs are T of ours, T = diag(R', 1)."""
    model = model_of(name)
    m, data, n = mechanism_of(model, quaternions=True), model.createData(), model.nv
    dynamics = ContinuousDynamics(m, threads=1)
    rng = np.random.default_rng(4)
    turn, place, joints = rng.standard_normal(4), rng.standard_normal(3), rng.uniform(-0.8, 0.8, n - 6)
    turn /= np.linalg.norm(turn)
    q, v, a = np.r_[place, turn, joints], *rng.standard_normal((2, n))
    tau = np.r_[np.zeros(6), 10.0 * rng.standard_normal(n - 6)]
    their_q = np.r_[place, np.roll(turn, -1), joints]
    R = pin.Quaternion(np.roll(turn, -1)).matrix()
    T = np.eye(n)
    T[:3, :3] = R.T
    linear, w = R.T @ v[:3], v[3:6]

    def swept(a: Any) -> Any:  # dT/dt v, and that of another vector along a turn
        return np.r_[np.cross(a[:3], a[3:]), np.zeros(n - 3)]

    drift = swept(np.r_[linear, w])
    inertia = np.triu(pin.crba(model, data, their_q))
    inertia = T.T @ (inertia + np.triu(inertia, 1).T) @ T
    assert off(m.mass_matrix(q), inertia) < RELATIVE
    bias = T.T @ pin.rnea(model, data, their_q, T @ v, drift)
    assert off(dynamics.inverse_dynamics(q, v, np.zeros(n)), bias) < RELATIVE
    needed = T.T @ pin.rnea(model, data, their_q, T @ v, T @ a + drift)
    assert off(dynamics.inverse_dynamics(q, v, a), needed) < RELATIVE
    theirs = np.linalg.solve(T, pin.aba(model, data, their_q, T @ v, tau) - drift)
    d = dynamics.linearize(q, v, tau[6:])
    assert off(d.a, theirs) < RELATIVE
    by_q, by_v, by_tau = (np.array(part) for part in pin.computeABADerivatives(model, data, their_q, T @ v, tau))
    by_tau = np.triu(by_tau) + np.triu(by_tau, 1).T
    hat = pin.skew
    turned, swept_by_q, moved_a, swept_by_v = (np.zeros((n, n)) for _ in range(4))
    turned[:3, 3:6] = hat(linear)  # of T v by turns: -d x (R' v)
    moved_a[:3, 3:6] = hat(R.T @ theirs[:3])
    swept_by_q[:3, 3:6] = -hat(w) @ hat(linear)
    swept_by_v[:3, :3], swept_by_v[:3, 3:6] = -hat(w) @ R.T, hat(linear)
    d_q = np.linalg.solve(T, by_q @ T + by_v @ turned - moved_a - swept_by_q)
    d_v = np.linalg.solve(T, by_v @ T - swept_by_v)
    assert off(d.a_dq, d_q) < RELATIVE
    assert off(d.a_dv, d_v) < RELATIVE
    assert off(d.a_du, np.linalg.solve(T, by_tau[:, 6:])) < RELATIVE
