"""Riccati equations in continuous time, against closed forms and a two-point boundary-value problem."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_are

from leastaction.errors import ArgumentError
from leastaction.optimal.continuous import (
    Accuracy,
    PiecewisePolynomial,
    regulate_continuous,
    solve_continuous_linear_quadratic,
    steady_state_regulator,
)

A2, B2 = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


def test_a_scalar_against_its_closed_form():
    """``P = tanh(tf - t)`` of ``x' = u`` with unit weights."""
    solution = solve_continuous_linear_quadratic([[0.0]], [[1.0]], horizon=(1, 4), Q=[1.0], R=[1.0])
    t = np.linspace(1, 4, 101)
    assert solution.definite
    assert solution.escape_time is None
    np.testing.assert_allclose(solution.P(t)[:, 0, 0], np.tanh(4 - t), atol=1e-8)
    np.testing.assert_allclose(solution.K(t)[:, 0, 0], np.tanh(4 - t), atol=1e-8)
    np.testing.assert_allclose(solution.C(t), 0.0, atol=1e-12)


def test_minimum_energy_of_a_double_integrator():
    """From rest to rest: the cubic of least control energy, in the limit of a heavy final weight."""
    heavy = 1e7
    solution = solve_continuous_linear_quadratic(
        A2, B2, horizon=(0, 2), R=[1.0], Q_final=[heavy, heavy], q_final=[-heavy, 0.0]
    )
    # From 0 to 1 in T = 2: u = 6/T^2 (1 - 2t/T), energy 12/T^3 (halved in the cost).
    np.testing.assert_allclose(solution.C(0.0), -6 / 4, rtol=1e-5)
    assert solution.constant + heavy / 2 == pytest.approx(0.5 * 12 / 8, rel=1e-4)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), nx=st.integers(1, 5), nu=st.integers(1, 3))
def test_long_horizons_against_the_algebraic_equation(seed, nx, nu):
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((nx, nx)), rng.standard_normal((nx, nu))
    root = rng.standard_normal((nx + nu, nx + nu))
    W = root @ root.T + 0.3 * np.eye(nx + nu)
    Q, S, R = W[:nx, :nx], W[:nx, nx:], W[nx:, nx:]
    P = solve_continuous_are(A, B, Q, R, s=S)
    slowest = np.linalg.eigvals(A - B @ np.linalg.solve(R, S.T + B.T @ P)).real.max()
    solution = solve_continuous_linear_quadratic(A, B, horizon=(0.0, min(-14.0 / slowest, 60.0)), Q=Q, R=R, S=S)
    assert solution.definite
    if -14.0 / slowest <= 60.0:
        K, P_steady = steady_state_regulator(A, B, Q=Q, R=R, S=S)
        np.testing.assert_allclose(solution.P(0.0), P, rtol=1e-6, atol=1e-6 * np.abs(P).max())
        np.testing.assert_allclose(P_steady, P, atol=1e-9 * np.abs(P).max())
        np.testing.assert_allclose(solution.K(0.0), K, atol=1e-6 * (1 + np.abs(K).max()))
        assert (np.linalg.eigvals(A - B @ K).real < 0).all()
    every = solution.P(np.linspace(*solution.P.breaks[[0, -1]], 20))
    np.testing.assert_array_equal(every, np.swapaxes(every, 1, 2))
    assert np.linalg.eigvalsh(every).min() > -1e-7 * np.abs(P).max()


def _varying(rng, nx, nu):
    """A time-varying affine problem with every term."""
    A0, A1 = rng.standard_normal((2, nx, nx))
    B0, B1 = rng.standard_normal((2, nx, nu))
    root = rng.standard_normal((nx + nu, nx + nu))
    W = root @ root.T + np.eye(nx + nu)
    return {
        "A": lambda t: A0 + np.sin(2 * t) * A1,
        "B": lambda t: B0 + np.cos(t) * B1,
        "Q": lambda t: W[:nx, :nx] * (1 + 0.5 * np.sin(t)),
        "S": lambda t: W[:nx, nx:] * (1 + 0.5 * np.sin(t)),
        "R": lambda t: W[nx:, nx:] * (1 + 0.5 * np.sin(t)),
        "q": lambda t: np.sin(t + np.arange(nx)),
        "r": lambda t: np.cos(t + np.arange(nu)),
        "c": lambda t: np.sin(3 * t + np.arange(nx)),
        "Q_final": np.eye(nx) + 0.1,
        "q_final": np.arange(1.0, nx + 1),
    }


def _simulate(problem, law, x0, tf, accuracy):
    """State and cost under ``u = law(x, t)``, by SciPy."""
    from scipy.integrate import solve_ivp

    p = problem

    def fun(t, y):
        x = y[:-1]
        u = law(x, t)
        rate = p["A"](t) @ x + p["B"](t) @ u + p["c"](t)
        cost = 0.5 * x @ p["Q"](t) @ x + x @ p["S"](t) @ u + 0.5 * u @ p["R"](t) @ u
        return np.append(rate, cost + p["q"](t) @ x + p["r"](t) @ u)

    run = solve_ivp(fun, (0, tf), np.append(x0, 0.0), method="DOP853", rtol=accuracy, atol=accuracy)
    x = run.y[:-1, -1]
    return x, run.y[-1, -1] + 0.5 * x @ p["Q_final"] @ x + p["q_final"] @ x


def test_an_affine_time_varying_problem_is_minimised():
    rng = np.random.default_rng(3)
    problem = _varying(rng, 3, 2)
    solution = solve_continuous_linear_quadratic(
        problem["A"],
        problem["B"],
        horizon=(0, 2),
        **{name: problem[name] for name in ("Q", "R", "S", "q", "r", "c", "Q_final", "q_final")},
        accuracy=Accuracy(rtol=1e-11),
    )
    K, C = solution.K, solution.C
    x0 = rng.standard_normal(3)
    _, best = _simulate(problem, lambda x, t: -K(t) @ x - C(t), x0, 2.0, 1e-11)
    expected = 0.5 * x0 @ solution.P(0.0) @ x0 + solution.b(0.0) @ x0 + solution.constant
    assert best == pytest.approx(expected, rel=1e-8)
    from_zero = _simulate(problem, lambda x, t: -K(t) @ x - C(t), np.zeros(3), 2.0, 1e-11)[1]
    assert from_zero == pytest.approx(solution.constant, rel=1e-8)
    for phase in range(3):
        costs = [
            _simulate(
                problem,
                lambda x, t, s=s, phase=phase: -K(t) @ x - C(t) + s * np.array([np.sin(4 * t + phase), np.cos(3 * t)]),
                x0,
                2.0,
                1e-11,
            )[1]
            for s in (1e-3, -1e-3)
        ]
        assert min(costs) > best
        # The first variation is zero.
        assert abs(costs[0] - costs[1]) < 1e-4 * (sum(costs) - 2 * best)


def test_against_the_hamiltonian_system():
    """Constant coefficients: state and costate by one matrix exponential."""
    rng = np.random.default_rng(5)
    nx, nu, tf = 3, 2, 1.5
    A, B = rng.standard_normal((nx, nx)), rng.standard_normal((nx, nu))
    Q, R = np.diag([1.0, 2.0, 0.5]), np.diag([1.0, 0.3])
    q, r, c = rng.standard_normal(nx), rng.standard_normal(nu), rng.standard_normal(nx)
    F, f = np.diag([1.0, 0.0, 2.0]), rng.standard_normal(nx)
    solution = solve_continuous_linear_quadratic(A, B, horizon=(0, tf), Q=Q, R=R, q=q, r=r, c=c, Q_final=F, q_final=f)
    W = B @ np.linalg.solve(R, B.T)
    M = np.block([[A, -W], [-Q, -A.T]])
    drift = np.concatenate([c - B @ np.linalg.solve(R, r), -q])
    step = expm(np.block([[M, drift[:, None]], [np.zeros((1, 2 * nx + 1))]]) * tf)
    x0 = rng.standard_normal(nx)
    # lam(tf) = F x(tf) + f fixes lam(0).
    up, low = step[:nx], step[nx : 2 * nx]
    rows = low - F @ up
    lam0 = np.linalg.solve(rows[:, nx : 2 * nx], f - rows[:, :nx] @ x0 - rows[:, -1])
    np.testing.assert_allclose(solution.P(0.0) @ x0 + solution.b(0.0), lam0, rtol=1e-7)


def test_what_jumps_is_integrated_piece_by_piece():
    drift = PiecewisePolynomial.through([0.0, 1.0, 2.0], [[0.0, 1.0], [0.0, -1.0]], kind="hold")
    how = {"horizon": (0, 2), "Q": [1.0, 0.1], "R": [1.0], "accuracy": Accuracy(rtol=1e-10)}
    known = solve_continuous_linear_quadratic(A2, B2, c=drift, **how)
    told = solve_continuous_linear_quadratic(A2, B2, c=lambda t: [0.0, 1.0 if t < 1.0 else -1.0], jumps=[1.0], **how)
    assert 1.0 in known.value.breaks
    t = np.linspace(0, 2, 41)
    np.testing.assert_allclose(known.b(t), told.b(t), atol=1e-9)
    untold = solve_continuous_linear_quadratic(A2, B2, c=lambda t: [0.0, 1.0 if t < 1.0 else -1.0], **how)
    assert untold.steps > known.steps
    np.testing.assert_allclose(untold.constant, known.constant, rtol=1e-5)


@pytest.mark.parametrize("weight", [-1.0, -4.0])
def test_finite_escape_is_found_where_it_is(weight):
    """``P = -w tan(w (tf - t))`` of ``x' = u`` with ``Q = -w^2``."""
    w = np.sqrt(-weight)
    far = solve_continuous_linear_quadratic([[0.0]], [[1.0]], horizon=(0, 5), Q=[weight], R=[1.0])
    assert not far.definite
    assert far.escape_time == pytest.approx(5 - np.pi / 2 / w, abs=1e-6)
    assert "no minimum" in far.message
    assert f"{far.escape_time:.6g}" in far.message
    assert np.isnan(far.K(1.0)).all()
    assert np.isnan(far.P(1.0)).all()
    near = solve_continuous_linear_quadratic([[0.0]], [[1.0]], horizon=(0, 1.5 / w), Q=[weight], R=[1.0])
    assert near.definite
    assert near.P(0.0)[0, 0] == pytest.approx(-w * np.tan(1.5), rel=1e-6)


def test_a_weight_that_loses_its_definiteness():
    solution = solve_continuous_linear_quadratic(A2, B2, horizon=(0, 2), Q=[1.0, 1.0], R=lambda t: [t - 0.5])
    assert not solution.definite
    assert solution.escape_time == pytest.approx(0.5, abs=0.1)
    assert "R is not positive definite" in solution.message


def test_stiff_weights_by_an_implicit_integrator():
    how = {"horizon": (0, 3), "Q": [1e6, 1.0], "R": [1e-6]}
    explicit = solve_continuous_linear_quadratic(A2, B2, **how, accuracy=Accuracy(rtol=1e-7))
    implicit = solve_continuous_linear_quadratic(A2, B2, **how, accuracy=Accuracy(solver="Radau", rtol=1e-7))
    assert implicit.steps < 0.5 * explicit.steps
    steady = steady_state_regulator(A2, B2, Q=how["Q"], R=how["R"])[0]
    for solution in (explicit, implicit):
        np.testing.assert_allclose(solution.K(0.0), steady, rtol=1e-4)


def test_the_regulator_holds_a_time_varying_system():
    A = lambda t: np.array([[0.0, 1.0], [4.0 + np.sin(3 * t), 0.0]])  # noqa: E731
    K = regulate_continuous(A, B2, horizon=(0, 8))
    from scipy.integrate import solve_ivp

    held = solve_ivp(lambda t, x: (A(t) - B2 @ K(t)) @ x, (0, 8), [1.0, 0.0], rtol=1e-8)
    loose = solve_ivp(lambda t, x: A(t) @ x, (0, 8), [1.0, 0.0], rtol=1e-8)
    assert np.abs(held.y[:, -1]).max() < 1e-3
    assert np.abs(loose.y[:, -1]).max() > 1e3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": np.zeros((2, 3))}, "A: got shape"),
        ({"A": np.zeros(3)}, "A: got shape"),
        ({"A": [[np.nan, 0], [0, 0]]}, "A: got nan"),
        ({"A": "abc"}, "A: got 'abc'"),
        ({"B": np.zeros((3, 1))}, "B: got shape"),
        ({"Q": [1.0, 1.0, 1.0]}, "Q: got shape"),
        ({"S": [[1.0, 1.0]]}, "S: got shape"),
        ({"q": lambda t: [t]}, "q at t = 0 s: got shape"),
        ({"q": lambda t: [1.0, 1.0 / t if t else np.inf]}, "q at t = 0 s: got inf"),
        ({"q": lambda t: [1.0, np.nan if 0.4 < t < 0.45 else 0.0]}, "not finite at t = 0.4"),
        ({"Q_final": np.zeros(3)}, "Q_final: got shape"),
        ({"horizon": (1.0, 1.0)}, "horizon: got"),
        ({"horizon": (0.0, np.inf)}, "horizon: got inf"),
    ],
)
def test_bad_input(change, message):
    problem = {"A": A2, "B": B2, "horizon": (0.0, 1.0), "Q": [1.0, 1.0], "R": [1.0], **change}
    with pytest.raises(ArgumentError, match=message):
        solve_continuous_linear_quadratic(problem.pop("A"), problem.pop("B"), **problem)


def test_there_is_not_always_a_regulator():
    with pytest.raises(ArgumentError, match="no regulator"):
        regulate_continuous(A2, B2, horizon=(0, 20), Q=[-1.0, -1.0])
    with pytest.raises(ArgumentError, match="no steady-state regulator"):
        steady_state_regulator([[1.0, 0.0], [0.0, -1.0]], [[0.0], [1.0]])
    with pytest.raises(ArgumentError, match="A: got shape"):
        steady_state_regulator(np.zeros((2, 3)), B2)
    with pytest.raises(ArgumentError, match="B: got shape"):
        steady_state_regulator(A2, np.zeros((3, 1)))


def test_a_steady_regulator_of_steps_is_the_limit_of_a_long_horizon() -> None:
    rng = np.random.default_rng(3)
    A, B = np.eye(4) + 0.1 * rng.standard_normal((4, 4)), 0.1 * rng.standard_normal((4, 2))
    Q, R, S = np.diag([1.0, 2.0, 0.5, 1.0]), np.diag([0.3, 0.7]), 0.05 * rng.standard_normal((4, 2))
    K, P = steady_state_regulator(A, B, Q=Q, R=R, S=S, dt=0.1)
    # It stands still under Riccati's recursion, and a long one ends there.
    backward = np.zeros((4, 4))
    for _ in range(3000):
        gain = np.linalg.solve(R + B.T @ backward @ B, S.T + B.T @ backward @ A)
        backward = Q + A.T @ backward @ A - (S + A.T @ backward @ B) @ gain
    np.testing.assert_allclose(P, backward, rtol=1e-9)
    np.testing.assert_allclose(K, gain, rtol=1e-9, atol=1e-12)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() < 1.0


def test_a_steady_regulator_says_that_steps_have_a_length() -> None:
    with pytest.raises(ArgumentError, match="dt"):
        steady_state_regulator(np.eye(2), np.eye(2), dt=0.0)


def test_what_is_out_of_reach_is_said() -> None:
    A, B = np.diag([1.0, 0.5, 0.9]), np.array([[0.0], [1.0], [0.0]])
    with pytest.raises(ArgumentError, match=r"Out of reach: the eigenvalue 1 \(of the states 0, counted from 0\)\.$"):
        steady_state_regulator(A, B, dt=0.1)
    with pytest.raises(ArgumentError, match=r"eigenvalue 0[+-]1j .*; 0[+-]1j"):
        steady_state_regulator(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.zeros((2, 1)))
