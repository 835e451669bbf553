"""Bridges to other programs, held to differences, to their own checks, and to this package."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Bound, FinalTime, MechanismSystem, MidpointSystem, MidpointVI
from leastaction.control import bridge
from leastaction.control.bridge.derivatives import BatchedSystem
from leastaction.control.bridge.optimal_motion import OptimalMotion
from leastaction.costs import tracking
from leastaction.errors import ArgumentError, MissingExtraError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.differences import central_differences

SYSTEM = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), np.linspace(0.0, 0.3, 7))
RNG = np.random.default_rng(0)
X0, U = RNG.standard_normal(4), RNG.standard_normal((6, 1))
W = RNG.standard_normal((7, 4))


def test_the_adjoint_is_the_derivative_of_the_motion():
    batched = BatchedSystem(SYSTEM)
    x = batched.states(X0, U)
    by_x0, by_u = batched.pull_back(batched.slopes(x, U), W)
    assert by_x0 == pytest.approx(central_differences(lambda y: np.sum(W * batched.states(y, U)), X0), abs=1e-7)

    def of_u(u: np.ndarray) -> np.ndarray:
        return np.sum(W * batched.states(X0, u.reshape(6, 1)))

    assert by_u.ravel() == pytest.approx(central_differences(of_u, U.ravel()), abs=1e-7)
    many = batched.states(np.stack([X0, -X0]), np.stack([U, U]))
    np.testing.assert_array_equal(many[0], x)


def test_jax_differentiates_motions_twice_and_maps_over_them():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from leastaction.control.bridge.jax import roll_out

    states, batched = roll_out(SYSTEM), BatchedSystem(SYSTEM)
    x = states(X0, U)
    np.testing.assert_array_equal(x, batched.states(X0, U))

    def loss(x0, u):
        return (W * states(x0, u)).sum() + (states(x0, u)[-1] ** 2).sum()

    by_x0, by_u = jax.jit(jax.grad(loss, argnums=(0, 1)))(X0, U)
    w = W.copy()
    w[-1] += 2.0 * np.asarray(x)[-1]
    ours = batched.pull_back(batched.slopes(np.asarray(x), U), w)
    np.testing.assert_allclose(by_x0, ours[0], atol=1e-12)
    np.testing.assert_allclose(by_u, ours[1], atol=1e-12)
    dx0, du = RNG.standard_normal(4), RNG.standard_normal((6, 1))
    _, slope = jax.jvp(loss, (X0, U), (dx0, du))
    assert float(slope) == pytest.approx(float(by_x0 @ dx0 + (by_u * du).sum()), rel=1e-12)
    gradient = jax.grad(loss, argnums=1)
    _, product = jax.jvp(lambda u: gradient(X0, u), (U,), (du,))
    h = 1e-5
    difference = (gradient(X0, U + h * du) - gradient(X0, U - h * du)) / (2 * h)
    np.testing.assert_allclose(product, difference, atol=1e-7)
    many = jax.vmap(states)(np.stack([X0, 2 * X0, -X0]), np.stack([U, U, U]))
    np.testing.assert_array_equal(many[1], states(2 * X0, U))


@pytest.fixture(scope="module")
def swing():
    """Return a cart-pendulum of 20 steps, a cost that is no quadratic form, and where it begins."""
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), np.linspace(0.0, 1.0, 21))
    cost = tracking(system, {"theta": 5.0, "x": 1.0, "*.v": 0.2}, {"theta": 1.0}, effort=0.1, final={"theta": 20.0})
    return system, cost, np.array([0.1, -0.4, 0.0, 0.3])


def test_an_optimum_follows_where_it_begins_and_parameters(swing):
    system, cost, x0 = swing
    names = ("bob.mass", "final time")  # one by exact second derivatives, the other by differences of first ones
    motion = OptimalMotion(system, cost, names, None, {})
    at = np.array([1.2, 1.1])
    x, u = motion.solve(x0, at)
    dx, du, dJ = motion.slopes(x, u, at)
    h = 1e-5
    for j in range(6):
        moved = [np.concatenate([x0, at]) + sign * h * np.eye(6)[j] for sign in (1.0, -1.0)]
        (x1, u1), (x2, u2) = (motion.solve(z[:4], z[4:]) for z in moved)
        np.testing.assert_allclose(dx[:, :, j], (x1 - x2) / (2 * h), atol=2e-5 * np.abs(dx[:, :, j]).max())
        np.testing.assert_allclose(du[:, :, j], (u1 - u2) / (2 * h), atol=2e-5 * np.abs(du[:, :, j]).max())
        by = (cost.value(x1, u1) - cost.value(x2, u2)) / (2 * h)
        assert dJ[j] == pytest.approx(by, rel=1e-5, abs=1e-6)


def test_an_optimum_within_limits_is_not_differentiated(swing):
    """An active limit changes the derivatives, which are those of an optimum without."""
    system, cost, _ = swing
    for stated in ({"limits": [Bound("x-force", -1.0, 1.0)]}, {"free_start": True}, {"unknowns": [FinalTime()]}):
        with pytest.raises(ArgumentError, match=f"^{next(iter(stated))}: got"):
            OptimalMotion(system, cost, (), None, stated)


def test_jax_differentiates_through_a_whole_optimisation(swing):
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from leastaction.control.bridge.jax import optimum

    system, cost, x0 = swing
    best = optimum(system, cost, parameters=["bob.mass"])
    mass = np.array([1.2])

    def reached(x0, mass):
        found = best(x0, mass)
        return found.cost + found.x[-1, 1] ** 2 + 0.1 * found.u.sum()

    by_x0, by_mass = jax.jit(jax.grad(reached, argnums=(0, 1)))(x0, mass)
    h = 1e-4
    for j in range(4):
        step = h * np.eye(4)[j]
        difference = (reached(x0 + step, mass) - reached(x0 - step, mass)) / (2 * h)
        assert float(by_x0[j]) == pytest.approx(float(difference), rel=1e-4, abs=1e-5)
    difference = (reached(x0, mass + h) - reached(x0, mass - h)) / (2 * h)
    assert float(by_mass[0]) == pytest.approx(float(difference), rel=1e-4)
    many = jax.vmap(best, in_axes=(0, None))(np.stack([x0, 0.5 * x0]), mass)
    np.testing.assert_array_equal(many.u[1], best(0.5 * x0, mass).u)
    assert optimum(system, cost)(x0).x.shape == (21, 4)
    with pytest.raises(ArgumentError, match=r"unknown parameter 'bob\.mas'; did you mean 'bob\.mass'"):
        optimum(system, cost, parameters=["bob.mas"])


def test_jax_differentiates_motions_by_parameters():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from leastaction.control.bridge.jax import roll_out

    states = roll_out(SYSTEM, parameters=["bob.mass", "final time"])

    def loss(x0, u, values):
        return (W * states(x0, u, values)).sum()

    at = (X0, U, np.array([1.3, 0.4]))
    gradients = jax.jit(jax.grad(loss, argnums=(0, 1, 2)))(*at)
    h = 1e-6
    for i, gradient in enumerate(gradients):
        d = np.random.default_rng(i).standard_normal(np.shape(at[i]))
        sides = [loss(*(a + sign * h * d if j == i else a for j, a in enumerate(at))) for sign in (1.0, -1.0)]
        assert float((gradient * d).sum()) == pytest.approx(float(sides[0] - sides[1]) / (2 * h), rel=1e-6)
    one, _ = jax.vmap(states, in_axes=(None, None, 0))(X0, U, np.array([[1.3, 0.4], [1.0, 0.3]]))
    np.testing.assert_array_equal(one, states(*at))


def test_torch_has_the_gradient_of_motions():
    torch = pytest.importorskip("torch")
    from leastaction.control.bridge.torch import roll_out

    states = roll_out(SYSTEM)
    x0, u = torch.tensor(X0, requires_grad=True), torch.tensor(U, requires_grad=True)
    assert torch.autograd.gradcheck(states, (x0, u), eps=1e-6, atol=1e-6)
    both = states(torch.stack([x0, -x0]), torch.stack([u, u]))
    both.sum().backward()
    assert u.grad.shape == (6, 1)


def reward(x, u):
    return -((x[..., 1] - np.pi) ** 2) - 1e-3 * u[..., 0] ** 2


SETTINGS = {
    "start": lambda rng: np.array([0.0, np.pi + 0.1 * rng.standard_normal(), 0.0, 0.0]),
    "actions": {"x-force": (-40.0, 40.0)},
}


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space", "ignore:.*probably too")
def test_an_environment_passes_the_checks_of_gymnasium():
    gym = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    from leastaction.control.bridge.gymnasium import environment

    env = environment(SYSTEM, reward=reward, ended=lambda x: abs(x[0]) > 2.0, **SETTINGS)
    check_env(env, skip_render_check=True, skip_close_check=True)
    seen, _ = env.reset(seed=4)
    for k in range(6):
        action = np.array([100.0])
        expected = SYSTEM.f(seen, np.array([40.0]), k)
        seen, _, terminated, truncated, _ = env.step(action)
        np.testing.assert_array_equal(seen, expected)
    assert truncated
    assert not terminated
    assert isinstance(env, gym.Env)


def test_many_environments_are_each_what_it_is_alone():
    pytest.importorskip("gymnasium")
    from leastaction.control.bridge.gymnasium import vector_environment

    env = vector_environment(SYSTEM, 3, reward=reward, **SETTINGS)
    seen, _ = env.reset(seed=4)
    for k in range(6):
        before, actions = seen, np.array([[1.0], [-2.0], [0.0]])
        seen, rewards, _, truncated, _ = env.step(actions)
        for i in range(3):
            np.testing.assert_allclose(seen[i], SYSTEM.f(before[i], actions[i], k), atol=1e-13)
        np.testing.assert_allclose(rewards, reward(seen, actions))
    assert truncated.all()
    seen, rewards, _, truncated, _ = env.step(actions)
    assert (seen[:, 0] == 0.0).all()
    assert not truncated.any()
    assert (rewards == 0.0).all()


def test_python_control_has_the_linearisation_with_its_names():
    pytest.importorskip("control")
    from leastaction.control.bridge.python_control import state_space

    up = np.array([0.0, np.pi, 0.0, 0.0])
    plant = state_space(MechanismSystem(cart_pendulum()), up, [0.0], measure=["x", "theta"])
    assert (plant.nstates, plant.ninputs, plant.noutputs, plant.dt) == (4, 1, 2, 0)
    assert plant.input_labels == ["x-force"]
    assert max(plant.poles().real) == pytest.approx(np.sqrt(9.8 * 1.1), rel=0.01)
    stepped = state_space(SYSTEM, up, [0.0])
    np.testing.assert_array_equal(stepped.A, SYSTEM.derivatives(up, np.zeros(1), 0)[0])
    assert stepped.dt == pytest.approx(0.05)


def test_what_is_wrong_is_said():
    from leastaction.control.bridge.gymnasium import environment
    from leastaction.control.bridge.python_control import state_space

    assert bridge.__doc__
    with pytest.raises(ArgumentError, match="system: got int"):
        state_space(3, [0.0], [0.0])
    pytest.importorskip("gymnasium")
    with pytest.raises(ArgumentError, match="unknown input 'force'"):
        environment(SYSTEM, reward=reward, **{**SETTINGS, "actions": {"force": (-1.0, 1.0)}})
    with pytest.raises(ArgumentError, match="expected the least before the largest"):
        environment(SYSTEM, reward=reward, **{**SETTINGS, "actions": {"x-force": (1.0, -1.0)}})


def test_what_is_not_installed_is_named(monkeypatch):
    import sys

    from leastaction.control.bridge.torch import roll_out

    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"bridge.torch needs torch.*leastaction\[torch\]"):
        roll_out(SYSTEM)
