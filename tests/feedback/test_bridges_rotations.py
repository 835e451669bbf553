"""Bridges of systems with rotations, held to JAX's own differentiation of the same steps, and to differences."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import leastaction as la
from leastaction import Damping, Gravity, Mechanism, MidpointSystem, MidpointVI, ball
from leastaction.control.bridge.derivatives import BatchedSystem
from leastaction.control.bridge.optimal_motion import OptimalMotion
from leastaction.elements import JointForce
from leastaction.numerics.differences import central_differences
from optimal.spaces import INERTIA, Body

N = 5
STEPS = np.array([0.1, 0.15, 0.1, 0.2, 0.1])
RNG = np.random.default_rng(3)
TOP = Mechanism(
    [ball("top", mass=0.5, com=(0.0, 0.02, 0.1), inertia=(2e-2, 1e-2, 3e-2))],
    [Gravity(), Damping({"top.wx": 0.01}), JointForce("top.wx", "pull"), JointForce("top.wz", "turn")],
)
SYSTEM = MidpointSystem(MidpointVI(TOP, threads=1), np.linspace(0.0, 0.3, 6))
U = RNG.standard_normal((N, 2))
X0 = np.array([0.8, -0.5, 0.7, 0.4, 0.03, -0.05, 0.02])  # its quaternion has another length than one
W, V = RNG.standard_normal((N + 1, 7)), RNG.standard_normal((N + 1, 7))


def of_all(states, x0, u):
    """Return a function of a motion that has a second order of its own."""
    x = states(x0, u)
    return (W * x).sum() + ((V * x).sum()) ** 2


def test_the_derivative_by_four_numbers_is_that_of_the_rotation():
    batched = BatchedSystem(SYSTEM)
    x = batched.states(X0, U)
    np.testing.assert_array_equal(x[0], X0)
    np.testing.assert_allclose(np.linalg.norm(x[1:, :4], axis=1), 1.0, atol=1e-14)
    later = W.copy()
    later[0] = 0.0
    by_x0, by_u = batched.pull_back(batched.slopes(x, U), later)
    assert by_x0 == pytest.approx(central_differences(lambda y: np.sum(later * batched.states(y, U)), X0), abs=1e-7)
    assert by_x0[:4] @ X0[:4] == pytest.approx(0.0, abs=1e-13)
    assert np.abs(by_x0[:4]).max() > 0.1

    def of_u(u: np.ndarray) -> np.ndarray:
        return np.sum(later * batched.states(X0, u.reshape(N, 2)))

    assert by_u.ravel() == pytest.approx(central_differences(of_u, U.ravel()), abs=1e-7)


def test_second_derivatives_of_steps_are_those_of_the_first():
    batched = BatchedSystem(SYSTEM)
    x = batched.states(X0, U)
    bends, h = batched.bends(x, U), 1e-6
    for j in range(9):
        sides = []
        for sign in (1.0, -1.0):
            moved = np.concatenate([x[:-1], U], axis=1)
            moved[:, j] += sign * h
            ends = [batched.states(z[:7], np.tile(z[7:], (N, 1)))[1] for z in moved]
            each = [
                batched.slopes(np.stack([z[:7]] + [end] * N), np.tile(z[7:], (N, 1)))[0]
                for z, end in zip(moved, ends, strict=True)
            ]
            sides.append(np.array(each))
        np.testing.assert_allclose(bends[:, :, :, j], (sides[0] - sides[1]) / (2 * h), atol=1e-7)


def by_hand(jax):
    """Return the roll-outs of a body that turns freely under torques, written in JAX."""
    jnp = jax.numpy

    def times(p, q):
        return jnp.concatenate([(p[:1] * q[:1] - p[1:] @ q[1:]), p[0] * q[1:] + q[0] * p[1:] + jnp.cross(p[1:], q[1:])])

    def step(x, row):
        u, dt = row
        q, w = x[:4] / jnp.linalg.norm(x[:4]), x[4:]
        w = w + dt * (u - jnp.cross(w, INERTIA * w)) / INERTIA
        a = jnp.linalg.norm(dt * w)
        turn = jnp.concatenate([jnp.cos(a / 2)[None], jnp.sin(a / 2) / a * dt * w])
        after = jnp.concatenate([times(q, turn), w])
        return after, after

    return lambda x0, u: jnp.concatenate([x0[None], jax.lax.scan(step, x0, (u, STEPS))[1]])


def test_jax_has_the_derivatives_that_it_finds_by_itself():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from leastaction.control.bridge.jax import roll_out

    x0, u = np.array([0.7, -0.5, 0.8, 0.4, 0.3, -0.9, 1.1]), RNG.standard_normal((N, 3))
    ours, theirs = roll_out(Body(STEPS)), by_hand(jax)
    np.testing.assert_allclose(ours(x0, u), theirs(x0, u), atol=1e-14)
    d = (np.cos(np.arange(7.0)), np.sin(np.arange(3.0 * N)).reshape(N, 3))
    both = []
    for states in (ours, theirs):
        gradient = jax.grad(partial(of_all, states), argnums=(0, 1))
        by_x0 = jax.hessian(partial(of_all, states))
        moments = jax.jit(lambda x0, u, g=gradient, h=by_x0: (*jax.jvp(g, (x0, u), d), h(x0, u)))
        both.append(jax.tree.leaves(moments(x0, u)))
    assert len(both[0]) == 5
    for one, other in zip(*both, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8)
    starts = np.stack([x0, -2.0 * x0, x0[::-1]])
    many, alone = (jax.vmap(jax.grad(partial(of_all, states)), (0, None))(starts, u) for states in (ours, theirs))
    np.testing.assert_allclose(many, alone, rtol=1e-9, atol=1e-9)


def test_jax_differentiates_a_mechanism_that_turns():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from leastaction.control.bridge.jax import roll_out

    states = roll_out(SYSTEM)
    gradient = jax.jit(jax.grad(lambda x0, u: of_all(states, x0, u), argnums=(0, 1)))
    dx0, du, h = RNG.standard_normal(7), RNG.standard_normal((N, 2)), 1e-6
    _, product = jax.jvp(gradient, (X0, U), (dx0, du))
    sides = [gradient(X0 + sign * h * dx0, U + sign * h * du) for sign in (1.0, -1.0)]
    for one, plus, minus in zip(product, *sides, strict=True):
        difference = (plus - minus) / (2 * h)
        np.testing.assert_allclose(one, difference, atol=1e-7 * np.abs(difference).max())
    many = jax.vmap(states)(np.stack([X0, X0 + dx0]), np.stack([U, du]))
    np.testing.assert_array_equal(many[1], states(X0 + dx0, du))
    of_mass = roll_out(SYSTEM, parameters=["top.mass"])
    mass, dm = np.array([0.5]), np.ones(1)
    _, slope = jax.jvp(lambda *at: of_all(lambda x0, u: of_mass(x0, u, at[2]), *at[:2]), (X0, U, mass), (dx0, du, dm))
    sides = [
        of_all(lambda x0, u, by=sign * h: of_mass(x0, u, mass + by), X0 + sign * h * dx0, U + sign * h * du)
        for sign in (1.0, -1.0)
    ]
    assert float(slope) == pytest.approx(float(sides[0] - sides[1]) / (2 * h), rel=1e-6)


@pytest.mark.parametrize("names", [(), ("top.mass", "damping.top.wx", "final time")], ids=["start", "parameters"])
def test_an_optimum_follows_where_it_begins_and_parameters(names):
    wanted, final = np.array([0.5, -0.5, 0.5, 0.5, 0.0, 0.0, 0.0]), [5.0, 4.0, 6.0, 1.0, 1.0, 1.0]
    Q, R = [0.1, 0.2, 0.1, 1.0, 2.0, 1.0], [0.1, 0.2]
    cost = la.QuadraticCost(wanted, np.zeros(2), Q=Q, R=R, Q_final=final, space=SYSTEM)
    motion = OptimalMotion(SYSTEM, cost, names, None, {"tolerance": 1e-12})
    at = np.array([0.6, 0.02, 0.4])[: len(names)]
    x, u = motion.solve(X0, at)
    np.testing.assert_array_equal(x[0], X0)
    dx, du, dJ = motion.slopes(x, u, at)
    assert dx.shape == (N + 1, 7, 7 + len(names))
    z, h = np.concatenate([X0, at]), 1e-5
    for j in range(len(z)):
        step = h * np.eye(len(z))[j]
        (x1, u1), (x2, u2) = (motion.solve(each[:7], each[7:]) for each in (z + step, z - step))
        np.testing.assert_allclose(dx[:, :, j], (x1 - x2) / (2 * h), atol=1e-4 * np.abs(dx).max())
        np.testing.assert_allclose(du[:, :, j], (u1 - u2) / (2 * h), atol=1e-4 * np.abs(du).max())
        assert dJ[j] == pytest.approx(
            (motion.value(x1, u1) - motion.value(x2, u2)) / (2 * h), abs=1e-4 * np.abs(dJ).max()
        )
    np.testing.assert_allclose(dx[1:, :, :4] @ X0[:4], 0.0, atol=1e-12)


def test_torch_has_the_gradient_of_turns():
    torch = pytest.importorskip("torch")
    from leastaction.control.bridge.torch import roll_out

    x0, u = torch.tensor(X0, requires_grad=True), torch.tensor(U, requires_grad=True)
    assert torch.autograd.gradcheck(roll_out(SYSTEM), (x0, u), eps=1e-6, atol=1e-6)


def test_python_control_has_what_rotations_turn_by() -> None:
    pytest.importorskip("control")
    from leastaction.control.bridge.python_control import state_space

    base = la.free("base", mass=1.0, inertia=(1.0, 2.0, 3.0))
    m = la.Mechanism([base, [la.rx("hip", mass=1.0, com=(0, 0, -1))]], [la.JointForce("hip", "motor")])
    inverse = np.linalg.inv(m.mass_matrix(m.configuration()))
    flow = state_space(la.MechanismSystem(m), np.r_[m.configuration(), m.velocity()], [0.0])
    assert flow.A.shape == (14, 14)
    assert flow.C.shape == (15, 14)
    np.testing.assert_allclose(flow.A, np.eye(14, k=7), atol=1e-14)
    np.testing.assert_allclose(flow.B[7:, 0], inverse[:, 6], atol=1e-14)
    vi = la.MidpointVI(m)
    steps = state_space(la.MidpointSystem(vi, [0.0, 1e-3, 2e-3]), vi.start({}).x, [0.0])
    np.testing.assert_allclose(steps.A[:7, 7:] / 1e-3, inverse, atol=1e-9)
    assert steps.state_labels[:8] == ["base_x", "base_y", "base_z", "dx_3", "dx_4", "dx_5", "hip", "p_base_x"]
