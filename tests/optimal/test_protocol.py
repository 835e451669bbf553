"""Discrete systems: roll-outs, linearisations, and the checker that users hold theirs to."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError, StepError
from leastaction.optimal import (
    DiscreteSystem,
    FunctionSystem,
    HessianPart,
    LinearSystem,
    QuadraticCost,
    check_derivatives,
)
from optimal.systems import CartPendulum, simulate


@pytest.fixture
def curve():
    rng = np.random.default_rng(1)
    return rng.standard_normal((31, 4)), rng.standard_normal((30, 1))


def _as_functions(system, **how):
    """The same system, given by plain functions."""

    def f(x, u, k):
        return np.array(system._f(*x, *u))

    return FunctionSystem(f, nx=4, nu=1, N=system.N, **how)


def test_rollout_applies_the_feedback():
    rng = np.random.default_rng(0)
    N = 6
    system = CartPendulum(N, 0.05)
    xbar, ubar = rng.standard_normal((N + 1, 4)), rng.standard_normal((N, 1))
    K = rng.standard_normal((N, 1, 4))
    whole = system.rollout(xbar[0], xbar, ubar, K, 0, N)
    assert whole.complete
    assert whole.steps_done == N
    for k in range(N):
        np.testing.assert_allclose(whole.u[k], ubar[k] - K[k] @ (whole.x[k] - xbar[k]))
        np.testing.assert_allclose(whole.x[k + 1], system.f(whole.x[k], whole.u[k], k))
    part = system.rollout(whole.x[2], xbar, ubar, K, 2, 5)
    np.testing.assert_array_equal(part.x, whole.x[2:6])
    np.testing.assert_array_equal(part.u, whole.u[2:5])


class _Wrong(LinearSystem):
    """Returns what its methods are told to."""

    def __init__(self, **returned):
        super().__init__(np.eye(2), np.ones((2, 1)), N=3)
        self.returned = returned

    def f(self, x, u, k):
        return self.returned.get("f", x)

    def derivatives(self, x, u, k):
        return self.returned["derivatives"]

    rollout, linearize, step_each = DiscreteSystem.rollout, DiscreteSystem.linearize, DiscreteSystem.step_each


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        ({"f": np.zeros(3)}, r"_Wrong\.f: got shape \(3,\) for step 0, expected the next state, \(2,\)"),
        ({"f": None}, r"_Wrong\.f: got NoneType for step 0, expected the next state"),
        ({"derivatives": np.eye(2)}, r"_Wrong\.derivatives: got shape \(2, 2\) for step 0, expected a pair \(A, B\)"),
        (
            {"derivatives": (np.eye(3), np.ones((2, 1)))},
            r"derivatives: got shape \(3, 3\) and shape \(2, 1\) for .* of shapes \(2, 2\) and \(2, 1\)",
        ),
        ({"derivatives": np.eye(3)}, r"_Wrong\.derivatives: got shape \(3, 3\) for step 0"),
        ({"derivatives": None}, r"_Wrong\.derivatives: got NoneType for step 0"),
    ],
)
def test_what_methods_of_users_return_is_named_where_it_is_wrong(returned, message):
    system = _Wrong(**returned)
    x, u = np.zeros((4, 2)), np.zeros((3, 1))
    ways = [lambda: system.linearize(x, u)]
    if "f" in returned:
        ways = [lambda: system.rollout(x[0], x, u, np.zeros((3, 1, 2)), 0, 3), lambda: system.step_each(x, u)]
    for way in ways:
        with pytest.raises(ArgumentError, match=message):
            way()


class _Fragile(LinearSystem):
    """Has no next state beyond a wall."""

    def __init__(self, outcome, N=8):
        super().__init__(np.eye(2) * 2.0, np.ones((2, 1)), N=N)
        self.outcome = outcome

    def f(self, x, u, k):
        if x[0] < 6.0:
            return super().f(x, u, k)
        if self.outcome == "nan":
            return np.array([np.nan, 0.0])
        raise StepError("hit the wall", t=0.1 * k, residuals={}, iteration=3, state=x)


@pytest.mark.parametrize(("outcome", "reason"), [("nan", "not finite"), ("error", "hit the wall")])
def test_a_failed_step_is_a_partial_rollout(outcome, reason):
    system = _Fragile(outcome)
    x = np.zeros((9, 2))
    rollout = system.rollout(np.ones(2), x, np.zeros((8, 1)), np.zeros((8, 1, 2)), 0, 8)
    assert not rollout.complete
    assert rollout.steps_done == 3
    assert "step 3" in rollout.failure
    assert reason in rollout.failure
    np.testing.assert_array_equal(rollout.x[:, 0], [1, 2, 4, 8])
    assert rollout.u.shape == (3, 1)


@pytest.mark.parametrize(
    "how",
    [
        {"derivatives": "complex-step", "curvature": "differences"},
        {"derivatives": "finite-differences", "curvature": None},
    ],
)
def test_function_system_agrees_with_exact_derivatives(curve, how):
    x, u = curve
    exact = CartPendulum(30)
    system = _as_functions(exact, **how)
    A, B = exact.linearize(x, u)
    A_got, B_got = system.linearize(x, u)
    accuracy = 1e-13 if how["derivatives"] == "complex-step" else 1e-8
    np.testing.assert_allclose(A_got, A, atol=accuracy * np.abs(A).max())
    np.testing.assert_allclose(B_got, B, atol=accuracy * np.abs(B).max())
    assert system.has_curvature == (how["curvature"] is not None)
    z = np.random.default_rng(2).standard_normal((31, 4))
    if system.has_curvature:
        H = exact.curvatures(x, u, z)
        np.testing.assert_allclose(system.curvatures(x, u, z), H, atol=1e-8 * np.abs(H).max())
    else:
        with pytest.raises(NotImplementedError, match="implement `curvature`"):
            system.curvatures(x, u, z)


def test_function_system_with_functions(curve):
    x, u = curve
    exact = CartPendulum(30)
    system = _as_functions(exact, derivatives=exact.derivatives, curvature=exact.curvature)
    assert check_derivatives(system, x, u).ok
    wrong = _as_functions(exact, derivatives=lambda x, u, k: (np.eye(3), np.ones((3, 1))))
    with pytest.raises(ArgumentError, match="returned shape"):
        wrong.linearize(x, u)


def test_a_complex_step_needs_a_complex_function():
    def real(x, u, k):
        return x.real + u.real

    system = FunctionSystem(real, nx=1, nu=1, N=2, derivatives="complex-step")
    with pytest.raises(ArgumentError, match="real result"):
        system.linearize(np.zeros((3, 1)), np.zeros((2, 1)))


@pytest.mark.parametrize(
    "arguments",
    [
        {"nx": 0},
        {"nu": 1.5},
        {"N": -3},
        {"N": True},
        {"derivatives": "guess"},
        {"curvature": "guess"},
    ],
)
def test_function_system_complains(arguments):
    given = {"nx": 2, "nu": 1, "N": 5, "derivatives": "complex-step", **arguments}
    with pytest.raises(ArgumentError, match=rf"{next(iter(arguments))}: got"):
        FunctionSystem(lambda x, u, k: x, **given)


def test_linear_system():
    rng = np.random.default_rng(0)
    A, B, c = rng.standard_normal((4, 3, 3)), rng.standard_normal((3, 2)), rng.standard_normal(3)
    system = LinearSystem(A, B, c=c)
    assert (system.N, system.nx, system.nu) == (4, 3, 2)
    x, u = rng.standard_normal((5, 3)), rng.standard_normal((4, 2))
    np.testing.assert_allclose(system.f(x[2], u[2], 2), A[2] @ x[2] + B @ u[2] + c)
    assert check_derivatives(system, x, u).ok


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({}, "horizons"),
        ({"N": 0}, "N: got 0"),
        ({"A": np.ones((4, 2, 2)), "N": 5}, "horizons"),
        ({"A": np.ones((2, 3)), "N": 5}, "A: got shape"),
        ({"B": np.ones((3, 1)), "N": 5}, "B: got shape"),
        ({"c": np.ones(3), "N": 5}, "c: got shape"),
        ({"A": np.full((2, 2), np.nan), "N": 5}, "A: got nan"),
    ],
)
def test_linear_system_complains(arguments, name):
    given = {"A": np.eye(2), "B": np.ones((2, 1)), **arguments}
    with pytest.raises(ArgumentError, match=name):
        LinearSystem(given.pop("A"), given.pop("B"), **given)


def test_the_checker_accepts_what_is_right(curve):
    x, u = curve
    cost = QuadraticCost(x * 0.5, u * 0.5, Q=np.ones(4), R=np.eye(1), Q_final=2.0 * np.eye(4))
    report = check_derivatives(CartPendulum(30), x, u, cost=cost)
    assert report.ok, str(report)
    assert max(report.errors.values()) < 1e-7
    assert {"A", "B", "curvature", "rollout", "linearize", "curvatures"} <= set(report.errors)
    assert {"cost gradient", "cost hessian"} <= set(report.errors)


def _broken(name):
    class Broken(CartPendulum):
        def derivatives(self, x, u, k):
            A, B = super().derivatives(x, u, k)
            return (A * (1.01 if name == "A" else 1.0), B * (1.01 if name == "B" else 1.0))

        def curvature(self, x, u, k, z):
            H = super().curvature(x, u, k, z)
            if name == "curvature symmetry":
                H[0, 1] += 0.1
            return H * (1.01 if name == "curvature" else 1.0)

        def linearize(self, x, u, out=None):
            A, B = super().linearize(x, u)
            return DiscreteSystem.linearize(self, x, u) if name != "linearize" else (A, B * 1.01)

        def curvatures(self, x, u, z, out=None):
            if name != "curvatures":
                return DiscreteSystem.curvatures(self, x, u, z)
            return super().curvatures(x, u, z) * 1.01

        def rollout(self, x0, xbar, ubar, K, start, stop):
            return super().rollout(x0, xbar, ubar, K * (1.1 if name == "rollout" else 1), start, stop)

    return Broken(30)


@pytest.mark.parametrize(
    "name",
    ["A", "B", "curvature", "curvature symmetry", "linearize", "curvatures", "rollout"],
)
def test_the_checker_finds_what_is_wrong(curve, name):
    report = check_derivatives(_broken(name), *curve)
    assert not report.ok
    assert report.errors[name] > report.tolerance
    assert "WRONG" in str(report)


@pytest.mark.parametrize("name", ["cost gradient", "cost hessian", "cost model_hessian"])
def test_the_checker_finds_a_wrong_cost(curve, name):
    class Broken(QuadraticCost):
        def gradient(self, x, u):
            q, r, q_final = super().gradient(x, u)
            return q, r * (1.1 if name == "cost gradient" else 1.0), q_final

        def hessian(self, x, u):
            Q, R, S, Q_final = super().hessian(x, u)
            return Q, R * (1.1 if name == "cost hessian" else 1.0), S, Q_final

        def model_hessian(self, x, u, *, convex):
            plain = super().model_hessian(x, u, convex=convex)
            if name != "cost model_hessian":
                return plain
            return plain.plus(HessianPart(np.array([1, 4]), 0.1 * np.ones((len(u), 2, 2))))

    x, u = curve
    cost = Broken(0.1 * x, 0.1 * u, Q=np.ones(4), R=10.0 * np.eye(1))
    report = check_derivatives(CartPendulum(30), x, u, cost=cost)
    assert not report.ok
    assert report.errors[name] > report.tolerance


def test_simulate_is_deterministic():
    system = CartPendulum(20)
    u = np.ones((20, 1))
    np.testing.assert_array_equal(simulate(system, np.zeros(4), u), simulate(system, np.zeros(4), u))
