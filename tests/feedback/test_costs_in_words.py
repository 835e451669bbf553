"""Costs by name are the quadratic costs that one would write by hand, and residuals their squares."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Gravity,
    JointForce,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    ball,
    optimize,
    rx,
    ry,
    to_velocity,
    tz,
)
from leastaction.costs import (
    ContinuousCost,
    ContinuousCostSum,
    ContinuousFunctionCost,
    ContinuousGaussNewton,
    ContinuousQuadraticCost,
    CostSum,
    GaussNewton,
    tracking,
)
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.differences import central_differences
from leastaction.optimal import LinearContinuousSystem

N = 20
SYSTEM = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), np.linspace(0.0, 1.0, N + 1))
RNG = np.random.default_rng(0)
X, U = RNG.standard_normal((N + 1, 4)), RNG.standard_normal((N, 1))


def test_by_name_it_is_what_one_would_write_by_hand():
    cost = tracking(
        SYSTEM, {"*": 0.5, "theta": 100.0}, {"theta": lambda t: np.pi * t, "x": 0.2}, effort={"x-force": 0.1},
        final={"theta": 7.0},
    )  # fmt: skip
    wanted = np.zeros((N + 1, 4))
    wanted[:, 0], wanted[:, 1] = 0.2, np.pi * SYSTEM.t
    plain = QuadraticCost(wanted, np.zeros((N, 1)), Q=[0.5, 100.0, 0.5, 0.5], R=[0.1], Q_final=[0.0, 7.0, 0.0, 0.0])
    assert cost.value(X, U) == pytest.approx(plain.value(X, U), rel=1e-13)


def test_velocities_cost_what_they_are_at_the_wanted_configuration():
    m = SYSTEM.mechanism
    x = np.tile([0.1, 0.7, 0.3, -0.4], (N + 1, 1))
    wanted = x.copy()
    wanted[:, 2:] = 0.0
    cost = tracking(SYSTEM, {"theta.v": 3.0, "x.v": 0.5}, wanted)
    v = to_velocity(m, x[0, :2], x[0, 2:])
    assert cost.value(x, np.zeros((N, 1))) == pytest.approx(0.5 * (N + 1) * (3.0 * v[1] ** 2 + 0.5 * v[0] ** 2))
    everywhere = tracking(SYSTEM, {"*.v": 1.0}, wanted).value(x, np.zeros((N, 1)))
    assert everywhere == pytest.approx(0.5 * (N + 1) * (v @ v))


def test_it_counts_while_it_is_asked_for():
    cost = tracking(SYSTEM, {"theta": 2.0}, during=(0.2, 0.5), final={"x": 1.0})
    values = cost.stage_values(X[:-1], np.zeros((N, 1)), 0)
    counts = (SYSTEM.t[:-1] > 0.199) & (SYSTEM.t[:-1] < 0.501)
    np.testing.assert_allclose(values, np.where(counts, X[:-1, 1] ** 2, 0.0), atol=1e-15)


def test_sums_and_residuals_have_their_derivatives():
    squares = GaussNewton(lambda x, u, k: np.array([2.0 * x[1] - k, np.sin(x[0]) * u[0]]), lambda x: 3.0 * x[:2] - 1.0)
    both = CostSum([tracking(SYSTEM, {"theta": 1.0, "*.v": 0.1}), squares])

    def of(z: np.ndarray) -> float:
        return both.value(z[: 4 * (N + 1)].reshape(N + 1, 4), z[4 * (N + 1) :].reshape(N, 1))

    slope = central_differences(of, np.concatenate([X.ravel(), U.ravel()]))
    q, r, last = both.gradient(X, U)
    np.testing.assert_allclose(np.concatenate([q.ravel(), last, r.ravel()]), slope, atol=1e-6)
    differences = GaussNewton(squares.residual, squares.final, derivatives="finite-differences")
    for one, other in zip(squares.hessian(X, U), differences.hessian(X, U), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)


def test_the_optimum_of_residuals_is_that_of_their_squares():
    up = np.array([0.0, 0.5, 0.0, 0.0])
    plain = tracking(SYSTEM, {"x": 1.0, "theta": 100.0, "p_*": 0.01}, up, effort=0.1)
    roots = np.sqrt([1.0, 100.0, 0.01, 0.01])
    squares = GaussNewton(
        lambda x, u, k: np.concatenate([roots * (x - up), np.sqrt(0.1) * u]), lambda x: roots * (x - up)
    )
    start = np.zeros(4), np.zeros((N, 1))
    one, other = (optimize(SYSTEM, cost, initial=start, tolerance=1e-12) for cost in (plain, squares))
    np.testing.assert_allclose(one.u, other.u, atol=1e-6)


def test_what_is_wrong_is_said():
    for change, words in (
        ({"weights": {"tetha": 1.0}}, "weights: unknown name 'tetha'; did you mean 'theta'"),
        ({"weights": {"tetha.v": 1.0}}, "weights: unknown name 'tetha.v'; did you mean 'theta.v'"),
        ({"weights": {"theta": -1.0}}, r"weights\['theta'\]: got -1"),
        ({"weights": [1.0]}, "weights: got"),
        ({"wanted": {"theta": np.zeros(3)}}, r"wanted\['theta'\]: got shape"),
        ({"effort": {"push": 1.0}}, "effort: unknown input 'push'"),
        ({"effort": 0.0}, "effort"),
        ({"during": (2.0, 3.0)}, "during: got 2 to 3 s"),
    ):
        with pytest.raises(ArgumentError, match=words):
            tracking(SYSTEM, **{"weights": {"theta": 1.0}, **change})
    with pytest.raises(ArgumentError, match="costs: got none"):
        CostSum([])
    with pytest.raises(ArgumentError, match=r"residual: got 3 .*expected a function"):
        GaussNewton(3)


def flowing_costs() -> dict[str, ContinuousCost]:
    """Return the same cost by a quadratic form, by a function and by residuals."""
    roots, end = np.sqrt([4.0, 0.5]), np.sqrt([20.0, 3.0])
    quadratic = ContinuousQuadraticCost(
        lambda t: np.array([np.sin(t), 0.0]), [0.0], Q=roots**2, R=[0.1], Q_final=end**2, x_final=[1.0, 0.2]
    )

    def residual(x: np.ndarray, u: np.ndarray, t: float) -> np.ndarray:
        return np.concatenate([roots * (x - np.array([np.sin(t), 0.0])), np.sqrt(0.1) * u])

    def last(x: np.ndarray) -> np.ndarray:
        return end * (x - np.array([1.0, 0.2]))

    def rate(x: np.ndarray, u: np.ndarray, t: float) -> float:
        return 0.5 * (4.0 * (x[0] - np.sin(t)) ** 2 + 0.5 * x[1] ** 2 + 0.1 * u[0] ** 2)

    def final(x: np.ndarray) -> float:
        return 0.5 * (20.0 * (x[0] - 1.0) ** 2 + 3.0 * (x[1] - 0.2) ** 2)

    return {
        "quadratic": quadratic, "residuals": ContinuousGaussNewton(residual, last),
        "by differences": ContinuousGaussNewton(residual, last, derivatives="finite-differences"),
        "function": ContinuousFunctionCost(rate, final, derivatives="complex-step", nonnegative=True),
        "given": ContinuousFunctionCost(
            rate, final,
            derivatives=lambda x, u, t: (
                np.array([4.0 * (x[0] - np.sin(t)), 0.5 * x[1], 0.1 * u[0]]), np.diag([4.0, 0.5, 0.1])
            ),
            final_derivatives=lambda x: (end * last(x), np.diag(end**2)),
        ),
    }  # fmt: skip


def test_in_continuous_time_functions_and_residuals_cost_what_the_same_form_does():
    """Values, derivatives and the optimum, which a sum of halves has too."""
    costs = flowing_costs()
    rng = np.random.default_rng(0)
    x, u, t = rng.standard_normal((7, 2)), rng.standard_normal((7, 1)), np.linspace(0.0, 2.0, 7)
    system = LinearContinuousSystem([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]])
    wanted = costs.pop("quadratic")
    best = optimize(system, wanted, initial=([0.0, 0.0], [0.0]), horizon=(0.0, 2.0))
    costs["sum"] = ContinuousCostSum([costs["residuals"], costs["function"]])
    for name, cost in costs.items():
        scale = 0.5 if name == "sum" else 1.0
        np.testing.assert_allclose(scale * cost.rates(x, u, t), wanted.rates(x, u, t), rtol=1e-12)
        for one, other in zip(cost.gradient(x, u, t), wanted.gradient(x, u, t), strict=True):
            np.testing.assert_allclose(scale * one, other, atol=1e-7)
        for one, other in zip(cost.hessian(x, u, t)[:2], wanted.hessian(x, u, t)[:2], strict=True):
            np.testing.assert_allclose(scale * one, np.broadcast_to(other, one.shape), atol=1e-6)
        assert scale * cost.final_value(x[0], 2.0) == pytest.approx(wanted.final_value(x[0], 2.0), rel=1e-12)
        np.testing.assert_allclose(scale * cost.final_gradient(x[0], 2.0), wanted.final_gradient(x[0], 2.0), atol=1e-7)
        np.testing.assert_allclose(scale * cost.convex_final_hessian(x[0], 2.0), np.diag([20.0, 3.0]), atol=1e-6)
        found = optimize(system, cost, initial=([0.0, 0.0], [0.0]), horizon=(0.0, 2.0))
        assert scale * found.cost == pytest.approx(best.cost, rel=1e-7)
        assert found.success


def test_in_continuous_time_a_function_that_is_not_convex_swings_up():
    pendulum = Mechanism([ry("theta"), [tz(-1.0, name="bob", mass=1.0)]], [Gravity(), JointForce("theta", input="u")])
    system = MechanismSystem(pendulum)
    energy = lambda x, u, t: 9.81 * (1.0 + np.cos(x[0])) + 0.1 * x[1] ** 2 + 0.01 * u[0] ** 2  # noqa: E731
    last = lambda x: 100.0 * (1.0 + np.cos(x[0])) + 5.0 * x[1] ** 2  # noqa: E731
    cost = ContinuousFunctionCost(energy, last, derivatives="complex-step", nonnegative=True)
    found = optimize(system, cost, initial=([0.3, 0.0], [1.0]), horizon=(0.0, 3.0))
    assert found.success
    assert np.cos(found.x[-1, 0]) < -0.99
    traced = pytest.importorskip("jax").numpy
    by_jax = ContinuousFunctionCost(
        lambda x, u, t: 9.81 * (1.0 + traced.cos(x[0])) + 0.1 * x[1] ** 2 + 0.01 * u[0] ** 2, derivatives="jax"
    )
    x, u, t = np.array([[0.3, 0.1], [2.0, -1.0]]), np.array([[0.5], [1.0]]), np.array([0.0, 0.5])
    for one, other in zip(by_jax.hessian(x, u, t), cost.hessian(x, u, t), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)


def test_in_continuous_time_what_is_wrong_is_said():
    with pytest.raises(ArgumentError, match="derivatives: got 'by hand', expected a function, 'jax' or 'complex-step'"):
        ContinuousFunctionCost(lambda x, u, t: 0.0, derivatives="by hand")
    with pytest.raises(ArgumentError, match="rate: got a real result for complex arguments"):
        ContinuousFunctionCost(lambda x, u, t: float(x[0].real), derivatives="complex-step").gradient(
            np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1)
        )
    with pytest.raises(ArgumentError, match=r"residual\(x, u, 0.5\)"):
        ContinuousGaussNewton(lambda x, u, t: np.eye(2)).rate(np.zeros(1), np.zeros(1), 0.5)


@pytest.mark.parametrize("kind", ["steps", "continuous"])
def test_a_rotation_by_its_name_is_all_its_axes(kind: str) -> None:
    shank = rx("knee", mass=1.0, com=(0.0, 0.0, -0.2), inertia=(0.1, 0.1, 0.05))
    thigh = tz(-0.5, mass=2.0, inertia=(0.1, 0.1, 0.05))
    m = Mechanism([ball("hip"), [thigh, [shank]]], [JointForce("knee", input="u")])
    system = MechanismSystem(m) if kind == "continuous" else MidpointSystem(MidpointVI(m), 0.1 * np.arange(4))
    short = tracking(system, {"hip": 2.0, "hip.v": 0.5, "knee": 1.0}, {"hip": np.eye(3)}, final={"hip": 3.0})
    long = tracking(system, {"hip.w*": 2.0, "hip.w*.v": 0.5, "knee": 1.0}, {"hip": np.eye(3)}, final={"hip.w*": 3.0})
    x = np.array([[0.8, 0.6, 0.0, 0.0, 0.3, 1.0, 2.0, 3.0, 4.0]])
    last = short.final_value(x[0], *([0.0] if kind == "continuous" else []))
    assert (
        last
        == long.final_value(x[0], *([0.0] if kind == "continuous" else []))
        == pytest.approx(1.5 * (2.0 * np.arcsin(0.6)) ** 2)
    )
    if kind == "steps":
        np.testing.assert_array_equal(short.Q, long.Q)
    else:
        u, t = np.zeros((1, 1)), np.zeros(1)
        np.testing.assert_array_equal(short.rates(x, u, t), long.rates(x, u, t))
    with pytest.raises(ArgumentError, match="unknown name 'hipp'; did you mean"):
        tracking(system, {"hipp": 1.0})


def test_weights_of_velocities_where_there_is_no_inertia_are_refused() -> None:
    m = Mechanism([ball("hip"), [rx("knee"), [tz(-0.5, mass=1.0)]]], [JointForce("knee", input="u")])
    with pytest.raises(ArgumentError, match="weights: got some of velocities, and the mass matrix is singular"):
        tracking(MidpointSystem(MidpointVI(m), 0.1 * np.arange(4)), {"knee.v": 1.0})
