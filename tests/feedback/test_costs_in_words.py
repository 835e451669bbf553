"""Costs by name are the quadratic costs that one would write by hand, and residuals their squares."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import MidpointSystem, MidpointVI, QuadraticCost, optimize, to_velocity
from leastaction.costs import CostSum, GaussNewton, tracking
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.differences import central_differences

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
