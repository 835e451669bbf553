"""Accelerations with rotations that are quaternions, and their derivatives: against JAX on SO(3) and differences."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from derivatives.along_directions import check_along
from derivatives.test_prescribed_rotations import CASES, carried
from derivatives.test_quaternions import AT_JOINTS, FORCES, PIN, ROD, WRENCH, tumbling, turned
from leastaction.mechanics import BodyWrench, ContinuousDynamics, Element, Gravity, Mechanism, ball, tx, tz
from leastaction.mechanics.mechanism.turns import moved
from leastaction.numerics.arrays import Array

RELATIVE = 1e-11


MOMENTS = np.array([[0.3, 0.02, -0.01], [0.02, 0.45, 0.03], [-0.01, 0.03, 0.25]])
COMS = np.array([[0.1, -0.05, 0.4], [0.02, 0.1, 0.2]])
ARM = 0.7


def two_tops_on_a_cart() -> Mechanism:
    """A top whose point slides along x, and one that hangs on it."""
    upper = ball("upper", axes="quaternion", mass=1.2, com=COMS[0], inertia=MOMENTS)
    lower = ball("lower", axes="quaternion", name="hand", mass=0.8, com=COMS[1], inertia=0.5 * MOMENTS)
    wrench = BodyWrench("hand", torque=("roll", 0.2, "yaw"))
    return Mechanism([tx("cart", mass=2.0), [upper, [tz(ARM), [lower]]]], [Gravity(), wrench])


def accelerations_in_jax(q: Array) -> Any:
    """Return the accelerations of these tops written anew in JAX, a function of ``[dq; v; u]``.

    By Hamel's equations: for the Lagrangian L of rotations R and angular velocities w in the bodies,
    ``d/dt L_w = L_w x w + X L + torque``, with X the derivatives by turns in the body.
    """
    jnp = pytest.importorskip("jax").numpy
    from jax import grad, hessian, jacfwd

    def hat(a: Any) -> Any:
        return jnp.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])

    def near_zero(a: Any) -> Any:  # exp, with derivatives at zero to the fourth order
        A = hat(a)
        return jnp.eye(3) + A + A @ A / 2.0 + A @ A @ A / 6.0 + A @ A @ A @ A / 24.0

    def rotation(p: Any) -> Any:
        v = jnp.array(p[1:])
        return (p[0] ** 2 - v @ v) * jnp.eye(3) + 2.0 * jnp.outer(v, v) + 2.0 * p[0] * hat(v)

    start = rotation(q[1:5]), rotation(q[5:9])

    def L(place: Any, v: Any, at: Any) -> Any:
        """By how far the place is moved from where it is, by turns in the bodies."""
        (x, R, S), s, w, o = at, v[0], v[1:4], v[4:]
        R, S = R @ near_zero(place[1:4]), S @ near_zero(place[4:])
        x = x + place[0]
        hip = jnp.array([0.0, 0.0, ARM])
        first = jnp.array([s, 0.0, 0.0]) + R @ jnp.cross(w, COMS[0])
        spin = S.T @ w + o  # of the lower one, in its axes
        joint = jnp.array([s, 0.0, 0.0]) + R @ jnp.cross(w, hip)
        second = joint + R @ S @ jnp.cross(spin, COMS[1])
        kinetic = 0.5 * (2.0 * s**2 + 1.2 * first @ first + 0.8 * second @ second)
        kinetic = kinetic + 0.5 * w @ MOMENTS @ w + 0.25 * spin @ MOMENTS @ spin
        return kinetic - 9.81 * (1.2 * (R @ COMS[0]) + 0.8 * (R @ hip + R @ S @ COMS[1]))[2]

    def accelerations(th: Any) -> Any:
        dq, v, u = th[:7], th[7:14], th[14:]
        at = q[0] + dq[0], start[0] @ near_zero(dq[1:4]), start[1] @ near_zero(dq[4:])
        zero = jnp.zeros(7)
        by_place, by_v = grad(L, 0)(zero, v, at), grad(L, 1)(zero, v, at)
        moving = jacfwd(lambda place: grad(L, 1)(place, v, at))(zero) @ v
        swept = jnp.concatenate([jnp.zeros(1), jnp.cross(by_v[1:4], v[1:4]), jnp.cross(by_v[4:], v[4:])])
        own = jnp.array([u[0], 0.2, u[1]])  # of the lower one, which turns with the upper one too
        torque = jnp.concatenate([jnp.zeros(1), at[2] @ own, own])
        return jnp.linalg.solve(hessian(L, 1)(zero, v, at), by_place + swept + torque - moving)

    return accelerations


@pytest.mark.slow
def test_first_and_second_derivatives_are_those_of_jax() -> None:
    jax = pytest.importorskip("jax")
    m, rng = two_tops_on_a_cart(), np.random.default_rng(1)
    q, v, u = turned(m, rng), 2.0 * rng.standard_normal(7), rng.standard_normal(2)
    dynamics, z = ContinuousDynamics(m), rng.standard_normal(7)
    with jax.enable_x64(True):
        function, th = accelerations_in_jax(q), jax.numpy.concatenate([np.zeros(7), v, u])
        slope = jax.jacfwd(function)
        a, first, second = (np.asarray(jax.jit(each)(th)) for each in (function, slope, jax.jacfwd(slope)))
    d = dynamics.linearize(q, v, u)
    assert np.abs(dynamics.accelerations(q, v, u).a - a).max() < RELATIVE * np.abs(a).max()
    assert np.abs(d.a - a).max() < RELATIVE * np.abs(a).max()
    assert np.abs(d.all - first).max() < RELATIVE * np.abs(first).max()
    assert np.abs(dynamics.tensors(q, v, u).a - second).max() < RELATIVE * np.abs(second).max()
    found = dynamics.curvature(q, v, u, z_a=z)
    assert np.abs(found - np.tensordot(z, second, 1)).max() < RELATIVE * np.abs(second).max()
    needed = dynamics.inverse_dynamics(q, v, a, u=u)
    assert np.abs(needed).max() < 1e-10


@pytest.mark.parametrize(
    "elements",
    [(), FORCES, (WRENCH,), (ROD,), AT_JOINTS, (PIN, *FORCES, WRENCH)],
    ids=["free", "forces", "wrench", "rod", "at joints", "all"],
)
def test_derivatives_are_those_of_differences(elements: tuple[Element, ...]) -> None:
    """Where constraints are off too, which a stabilisation pulls back."""
    check_differences(tumbling(*elements))


@pytest.mark.parametrize("elements", list(CASES.values()), ids=list(CASES))
def test_derivatives_of_what_is_carried_are_those_of_differences(elements: tuple[Element, ...]) -> None:
    """On a bar that is prescribed, whose turns, angular velocity and its derivative are arguments."""
    check_differences(carried(*elements))


def check_differences(m: Mechanism) -> None:
    """Hold both orders of derivatives to differences of the accelerations, in any configuration."""
    rng = np.random.default_rng(3)
    q, v, u = turned(m, rng), 2.0 * rng.standard_normal(m.nv), rng.standard_normal(m.n_inputs)
    rho_a = 0.3 * np.arange(1, m.nrho + 1)
    dynamics = ContinuousDynamics(m, constraint_damping=3.0, constraint_stiffness=5.0)
    ends = np.cumsum([0, m.nv, m.nv, m.n_inputs, m.nrho])

    def solved(d: Array) -> Array:
        dq, dv, du, da = (d[begin:end] for begin, end in pairwise(ends))
        out = dynamics.accelerations(moved(m, q[None], dq[None])[0], v + dv, u + du, rho_a + da)
        return np.concatenate([out.a, out.lam])

    first = dynamics.linearize(q, v, u, rho_a).all
    z = rng.standard_normal(m.nd + m.nc)
    second = dynamics.curvature(q, v, u, rho_a, z_a=z[: m.nd], z_lam=z[m.nd :])
    assert np.abs(second - second.T).max() < 1e-13 * np.abs(second).max()
    check_along(solved, first, second, z, rng)
