"""Steps with rotations that are quaternions: A, B and second derivatives against JAX on SO(3) and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from derivatives.along_directions import check_step
from leastaction import _core
from leastaction.mechanics import (
    BodyWrench,
    CoulombFriction,
    Damping,
    Distance,
    Element,
    Gravity,
    JointForce,
    JointSpring,
    LinearDamper,
    LinearSpring,
    Mechanism,
    MidpointVI,
    NonlinearDamping,
    PointToPoint,
    Servo,
    ball,
    free,
    project_velocity,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.numerics.arrays import Array
from leastaction.systems import MidpointSystem

RELATIVE = 1e-11
DT = 0.07


def top_on_cart() -> Mechanism:
    """A heavy top whose point slides along x."""
    top = ball("top", axes="quaternion", mass=1.2, com=(0.1, -0.05, 0.4), inertia=(0.3, 0.45, 0.25, 0.02, -0.01, 0.03))
    return Mechanism([tx("cart", mass=2.0), [top]], [Gravity(), BodyWrench("top", torque=("roll", 0.2, "yaw"))])


def equations_in_jax(x: np.ndarray, u: np.ndarray, phi: np.ndarray, x_next: np.ndarray) -> Any:
    """Return the equations of a step of that top and its next momenta, written anew in JAX.

    They are functions of ``[dx; du; ddt]`` and of the change of the next configuration, in the charts of both states.
    """
    jax = pytest.importorskip("jax")
    jnp = jax.numpy
    com, g = jnp.array([0.1, -0.05, 0.4]), 9.81
    inertia = jnp.array([[0.3, 0.02, -0.01], [0.02, 0.45, 0.03], [-0.01, 0.03, 0.25]])

    def hat(a: Any) -> Any:
        return jnp.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])

    def near_zero(a: Any) -> Any:  # exp, with derivatives at zero to the fourth order
        A = hat(a)
        return jnp.eye(3) + A + A @ A / 2.0 + A @ A @ A / 6.0 + A @ A @ A @ A / 24.0

    def exponential(a: Any) -> Any:  # not at zero
        A, square = hat(a), a @ a
        angle = jnp.sqrt(square)
        return jnp.eye(3) + jnp.sin(angle) / angle * A + (1.0 - jnp.cos(angle)) / square * A @ A

    def logarithm(R: Any) -> Any:  # not of the identity
        w = jnp.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
        sine = jnp.sqrt(w @ w)
        return jnp.arctan2(sine, (jnp.trace(R) - 1.0) / 2.0) / sine * w

    def small_turn(R: Any) -> Any:  # a logarithm whose derivatives at the identity are right to the second order
        return jnp.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0

    qw, qx, qy, qz = x[1:5]
    v = jnp.array([qx, qy, qz])
    R1 = (qw**2 - v @ v) * jnp.eye(3) + 2.0 * jnp.outer(v, v) + 2.0 * qw * hat(v)
    R2 = R1 @ exponential(jnp.asarray(phi))

    def energy(R: Any, speed: Any, w: Any) -> Any:
        velocity = jnp.array([speed, 0.0, 0.0]) + R @ jnp.cross(w, com)
        kinetic = 0.5 * 1.2 * velocity @ velocity + 0.5 * w @ inertia @ w + 0.5 * 2.0 * speed**2
        return kinetic - 1.2 * g * (R @ com)[2]

    def Ld(q1: Any, start: Any, q2: Any, end: Any, dt: Any) -> Any:
        turn = logarithm(start.T @ end)
        return dt * energy(start @ exponential(turn / 2.0), (q2 - q1) / dt, turn / dt)

    def work(a: Any, b: Any, start: Any, end: Any, u: Any, dt: Any) -> Any:
        """Of the torque at the middle, by how turns of the ends turn the middle: its derivatives at zero are meant."""
        R = start @ exponential(logarithm(start.T @ end) / 2.0)
        moved, reached = start @ near_zero(a), end @ near_zero(b)
        middle = moved @ exponential(logarithm(moved.T @ reached) / 2.0)
        return dt * jnp.array([u[0], 0.2, u[1]]) @ small_turn(R.T @ middle)

    def rows(q1: Any, start: Any, q2: Any, end: Any, u: Any, dt: Any) -> tuple[Any, Any]:
        zero = jnp.zeros(3)

        def moved(s: Any, a: Any, t: Any, b: Any) -> Any:
            return Ld(q1 + s, start @ near_zero(a), q2 + t, end @ near_zero(b), dt)

        s, a, t, b = jax.grad(moved, argnums=(0, 1, 2, 3))(0.0, zero, 0.0, zero)
        by_start, by_end = jax.grad(work, argnums=(0, 1))(zero, zero, start, end, u, dt)
        a, b = a + by_start, b + by_end
        return jnp.concatenate([s[None], a]), jnp.concatenate([t[None], b])

    def equations(w: Any) -> tuple[Any, Any]:
        th, y = w[:11], w[11:]
        q1, start = x[0] + th[0], R1 @ near_zero(th[1:4])
        end = R2 @ near_zero(y[1:])
        before, after = rows(q1, start, x_next[0] + y[0], end, jnp.asarray(u) + th[8:10], DT + th[10])
        return jnp.asarray(x[5:]) + th[4:8] + before, after

    return equations


@pytest.mark.slow
def test_first_and_second_derivatives_are_those_of_jax() -> None:
    jax = pytest.importorskip("jax")
    m = top_on_cart()
    vi = MidpointVI(m, tolerance=1e-15)
    q = m.configuration({"cart": 0.3, "top.qw": 0.5, "top.qx": 0.5, "top.qy": -0.5, "top.qz": 0.5})
    state, u = vi.start(q, [0.4, 3.0, -4.0, 6.0]), np.array([0.3, -0.4])
    run = vi.simulate(state, [0.0, DT], inputs=u)
    phi = run.v[0, 1:] * DT
    assert 0.4 < np.linalg.norm(phi) < 0.7
    d = vi.linearize(run)
    z = np.array([0.7, 1.0, -2.0, 0.5, -0.3, 0.9, 0.4, -1.1])
    with jax.enable_x64(True):
        equations = equations_in_jax(run.x[0], u, phi, run.x[1])
        zero = jax.numpy.zeros(15)
        F, G = (np.asarray(each) for each in equations(zero))
        F_w, G_w = (np.asarray(each) for each in jax.jacfwd(equations)(zero))
        mu = -np.linalg.solve(F_w[:, 11:].T, z[:4] + G_w[:, 11:].T @ z[4:])
        bent = jax.jacfwd(jax.jacfwd(lambda w: mu @ equations(w)[0] + z[4:] @ equations(w)[1]))(zero)
    assert np.abs(F).max() < 1e-13
    assert np.abs(G - run.x[1, 5:]).max() < 1e-13
    by_theta = np.vstack([np.eye(11), -np.linalg.solve(F_w[:, 11:], F_w[:, :11])])
    first = np.vstack([by_theta[11:], G_w @ by_theta])
    second = by_theta.T @ np.asarray(bent) @ by_theta
    assert np.abs(np.hstack([d.A[0], d.B[0]]) - first[:, :10]).max() < RELATIVE * np.abs(first).max()
    assert np.abs(d.curvature(z[None])[0] - second[:10, :10]).max() < RELATIVE * np.abs(second[:10, :10]).max()
    by_length = MidpointSystem(vi, run.t).curvature_by_final_time(run.x, run.u, z[None])
    assert np.abs(by_length[0] - second).max() < RELATIVE * np.abs(second).max()


def tumbling(*elements: Element) -> Mechanism:
    """A floating base with a leg, whose foot hangs on a ball joint, beside a prescribed hand."""
    base = free(
        "base", axes="quaternion", mass=2.0, com=(0.05, 0.02, -0.03), inertia=(0.1, 0.2, 0.15, 0.01, 0.02, -0.01)
    )
    leg = rz("knee", name="leg", mass=0.5, com=(0.1, 0.0, 0.02), inertia=(0.02, 0.01, 0.03))
    foot = ball("hip", axes="quaternion", name="foot", mass=0.4, com=(0.1, 0.03, 0.05), inertia=(0.02, 0.01, 0.015))
    tree: list[Any] = [base, [tx(0.3), [leg, [tx(0.3), [foot, [tx(0.2, name="toe")]]]], ty(-0.4, name="left")]]
    return Mechanism([*tree, tz("lift", kinematic=True, name="hand")], [Gravity(), *elements])


FORCES = (LinearSpring("toe", "left", 40.0, 0.3), LinearDamper("toe", "hand", 0.7))
WRENCH = BodyWrench("foot", force=(0.1, "push", 0.0), torque=("roll", 0.3, "yaw"))
ROD = Distance("toe", "hand", 0.9, name="rod")


# What acts on the turns of the joints themselves, one by one and in sums with other variables.
def turned(m: Mechanism, rng: np.random.Generator) -> Array:
    """Return a configuration with random rotations."""
    q = m.configuration()
    for rotation in m.tree.rotations:
        first = m.coordinates.index(rotation.quaternion[0])
        turn = rng.standard_normal(4)
        q[first : first + 4] = turn / np.linalg.norm(turn)
    return q


AT_JOINTS = (
    Damping({"base.wy": 0.3, "hip.wx": 0.05, "knee": 0.1}),
    NonlinearDamping({"hip.wy": 0.7, "knee": -0.4, "hip.wz": 0.2}, (0.1, 0.02)),
    CoulombFriction("hip.wz", 0.2, 1.5),
    JointForce("base.wx", "roll"),
    JointForce({"hip.wx": 0.6, "hip.wz": -0.3, "knee": 1.2}, "push"),
    JointSpring("hip.wx", 1.5, 0.3),
    JointSpring({"base.wz": 0.4, "knee": 1.0, "hip.wy": -0.8}, 0.9, -0.2),
    Servo("hip.wy", "yaw", gain=0.8, stiffness=0.8, damping=0.1),
)
PIN = PointToPoint("left", "hand", name="pin")


@pytest.mark.parametrize(
    "elements",
    [(), FORCES, (WRENCH,), (ROD,), AT_JOINTS, (PIN, *FORCES, WRENCH)],
    ids=["free", "forces", "wrench", "rod", "at joints", "all"],
)
def test_derivatives_are_those_of_differences(elements: tuple[Element, ...]) -> None:
    m = tumbling(*elements)
    rng = np.random.default_rng(3)
    v = 2.0 * rng.standard_normal(m.nv)
    q = turned(m, rng)
    if PIN in elements:
        q[:3] -= m.positions(q, ("left",))[0] - m.positions(q, ("hand",))[0]
    if ROD in elements:
        apart = float(np.linalg.norm(np.diff(m.positions(q, ("toe", "hand")), axis=0)))
        m = m.with_parameters({"rod.length": apart})
    v = project_velocity(m, q, v).v if m.nc else v
    vi = MidpointVI(m, tolerance=1e-15)
    check_step(vi, vi.start(q, v).x, np.append(0.3 * rng.standard_normal(m.n_inputs), 0.03), rng)


@pytest.mark.parametrize("size", [0.2, 0.3, 0.35])
def test_a_step_past_half_a_turn_has_derivatives(size: float) -> None:
    """By 3.0, 4.5 and 5.6 rad: its numbers change their sign where it goes past the shorter way."""
    top = ball("top", mass=1.0, com=(0.0, 0.0, -0.15), inertia=(8e-3, 8e-3, 1e-3))
    m = Mechanism([top], [Gravity(), *[JointForce(f"top.w{a}", a) for a in "xyz"]])
    vi = MidpointVI(m, tolerance=1e-15)
    x0 = vi.start(m.configuration()).x
    x0[4:] = size * np.array([0.35, 0.82, 0.33])
    x1 = vi.core.roll_out(np.array([0.0, 0.05]), x0, None, np.zeros((1, 3)), None).x[1]
    assert (x0[:4] @ x1[:4] < 0.0) == (size > 0.2)
    check_step(vi, x0, np.zeros(3), np.random.default_rng(0), step=1e-3)


def test_parameters() -> None:
    """Numbers of elements, masses and the length of a step, against differences."""
    m = tumbling(*FORCES, WRENCH, *AT_JOINTS)
    vi = MidpointVI(m, tolerance=1e-15)
    rng = np.random.default_rng(5)
    run = vi.simulate(
        vi.start(m.configuration(), rng.standard_normal(m.nv) * 3.0), [0.0, 0.06], inputs=[0.2, 0.1, -0.3]
    )
    names = ["base.mass", "foot.inertia.xy", "leg.com.x", "body_wrench(foot).ty", "damping.base.wy", "damping.knee"]
    names += ["joint_spring(hip.wx).rest", "nonlinear_damping(hip.wy, knee, hip.wz).factors.hip.wy"]
    found = vi.differentiate_by(run, names).x[0]
    for column, name in enumerate(names):
        h, ends = 1e-4, []
        for k in (1, -1, 2, -2):
            other = MidpointVI(m.with_parameters({name: m.parameters[name] + k * h}), tolerance=1e-15)
            x = other.core.roll_out(run.t, run.x[0], None, run.u, None).x[1:]
            ends.append(_core.difference(m.core, x, run.x[1:])[0])
        slope = (8.0 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12.0 * h)
        assert np.abs(found[:, column] - slope).max() < 1e-8 * max(1.0, np.abs(slope).max())


def test_mass_matrix_and_weight_are_those_of_pinocchio() -> None:
    """With its free flyer, whose linear velocity is in the axes of the body, and its spherical joint."""
    pin = pytest.importorskip("pinocchio")
    moments, hip = np.array([[0.1, 0.01, 0.02], [0.01, 0.2, -0.01], [0.02, -0.01, 0.15]]), np.array([0.3, -0.1, 0.2])
    theirs = pin.Model()
    base = theirs.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    theirs.appendBodyToJoint(base, pin.Inertia(2.0, np.array([0.05, 0.02, -0.03]), moments), pin.SE3.Identity())
    leg = theirs.addJoint(base, pin.JointModelSpherical(), pin.SE3(np.eye(3), hip), "leg")
    theirs.appendBodyToJoint(leg, pin.Inertia(0.4, np.array([0.1, 0.03, 0.05]), 0.1 * moments), pin.SE3.Identity())
    body = free("base", axes="quaternion", mass=2.0, com=(0.05, 0.02, -0.03), inertia=moments)
    foot = ball("leg", axes="quaternion", mass=0.4, com=(0.1, 0.03, 0.05), inertia=0.1 * moments)
    m = Mechanism([body, [tx(hip[0]), [ty(hip[1]), [tz(hip[2]), [foot]]]]], [Gravity(theirs.gravity.linear)])
    rng = np.random.default_rng(2)
    turns = rng.standard_normal((2, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    place = rng.standard_normal(3)
    q = np.r_[place, turns[0], turns[1]]
    their_q = np.r_[place, np.roll(turns[0], -1), np.roll(turns[1], -1)]
    T = np.eye(9)
    T[:3, :3] = m.frame_pose(q, "base")[:3, :3].T
    data = theirs.createData()
    inertia = T.T @ pin.crba(theirs, data, their_q) @ T
    weight = T.T @ pin.computeGeneralizedGravity(theirs, data, their_q)
    assert np.abs(m.mass_matrix(q) - inertia).max() < 1e-13
    assert np.abs(m.core.gradient(q, np.zeros(9))[0] + weight).max() < 1e-12
