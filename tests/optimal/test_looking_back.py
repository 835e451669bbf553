"""Limits on how fast inputs change and on accelerations: against SciPy's solution of the same problem."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, minimize

from leastaction import (
    FinalTime,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    rx,
    tx,
    ty,
    tz,
)
from leastaction.errors import ArgumentError
from leastaction.limits import Bound, Equal, FunctionQuantity, Within
from leastaction.optimal import LinearSystem, Status, check_derivatives
from leastaction.optimal.remembered.system import RememberingSystem

N = 20


@pytest.fixture
def linear():
    system = LinearSystem([[1.0, 0.1], [0.0, 1.0]], [[0.005, 0.0], [0.1, 0.05]], N=N)
    cost = QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 2)), Q=[5.0, 0.1], R=[0.1, 0.3])
    return system, cost, (np.array([1.0, 0.5]), np.zeros((N, 2)))


def by_scipy(system, cost, x0, rows, low, high):
    """The least cost over inputs whose combinations stay within bounds."""

    def value(u):
        run = system.rollout(x0, np.zeros((N + 1, 2)), u.reshape(N, 2), np.zeros((N, 2, 2)), 0, N)
        return cost.value(run.x, run.u)

    # Quadratic, so its derivatives are exact from a few values.
    n = 2 * N
    base, eye = value(np.zeros(n)), np.eye(n)
    ahead = np.array([value(e) for e in eye])
    behind = np.array([value(-e) for e in eye])
    g = 0.5 * (ahead - behind)
    H = np.array([[value(a + b) - value(a) - value(b) + base for b in eye] for a in eye])
    found = minimize(
        lambda u: base + g @ u + 0.5 * u @ H @ u, np.zeros(n), jac=lambda u: g + H @ u, hess=lambda u: H,
        method="trust-constr", constraints=[LinearConstraint(rows, low, high)],
        options={"gtol": 1e-10, "xtol": 1e-12, "maxiter": 3000},
    )  # fmt: skip
    return found.fun, found.x.reshape(N, 2)


def test_rates_of_inputs_are_limited_as_scipy_says(linear):
    system, cost, initial = linear
    limit = Bound("u[0]", -2.0, 2.0, of="input rate")  # in units a step: this system knows no time
    free = optimize(system, cost, initial=initial)
    found = optimize(system, cost, initial=initial, limits=[limit])
    assert found.status is Status.CONVERGED
    assert np.abs(np.diff(free.u[:, 0])).max() > 2.5
    assert np.abs(np.diff(found.u[:, 0])).max() == pytest.approx(2.0, abs=1e-6)
    rows = np.zeros((N - 1, 2 * N))
    rows[np.arange(N - 1), 2 * np.arange(N - 1)], rows[np.arange(N - 1), 2 * np.arange(1, N)] = -1.0, 1.0
    least, u = by_scipy(system, cost, initial[0], rows, -2.0, 2.0)
    assert found.cost == pytest.approx(least, rel=1e-6)
    np.testing.assert_allclose(found.u, u, atol=2e-3)
    assert found.x.shape == (N + 1, 2)
    assert found.K.shape == (N, 2, 2)
    assert "rate of u[0] <= 2" in found.limits.labels
    assert found.limits.dual("rate of u[0] <= 2").max() > 0.0 or found.limits.dual("rate of u[0] >= -2").max() > 0.0


def test_it_is_resumed_bit_for_bit_and_goes_with_other_limits(linear, tmp_path):
    system, cost, initial = linear
    limits = [
        Bound({"u[0]": 1.0, "u[1]": -1.0}, -1.0, 1.0, of="input rate"),
        Bound("u[1]", -1.5, 1.5),
        Within(FunctionQuantity("sum", lambda x: x[:, 0] + x[:, 1] ** 2), max=2.0),
    ]
    whole = optimize(system, cost, initial=initial, limits=limits)
    assert whole.status is Status.CONVERGED
    assert np.abs(np.diff(whole.u[:, 0] - whole.u[:, 1])).max() < 1.0 + 1e-6
    for stop in (2, 5):
        part = optimize(system, cost, initial=initial, limits=limits, max_iterations=stop)
        again = optimize(system, cost, resume=part, limits=limits)
        assert np.array_equal(again.x, whole.x)
    seen = []
    optimize(system, cost, initial=initial, limits=limits, callback=lambda record: seen.append(record.x.shape))
    assert set(seen) == {(N + 1, 2)}
    warm = optimize(system, cost, initial=whole, limits=limits)
    assert warm.cost == pytest.approx(whole.cost, rel=1e-8)


@pytest.fixture
def pendulum():
    m = Mechanism(
        [ty("cart", mass=1.0), [rx("pole"), [tz(-0.5, mass=0.3)]]], [Gravity(), JointForce("cart", input="push")]
    )
    t = np.concatenate([np.linspace(0.0, 0.5, 26), np.linspace(0.53, 1.0, 17)])
    system = MidpointSystem(MidpointVI(m), t)
    n = system.N
    cost = QuadraticCost(np.zeros((n + 1, 4)), np.zeros((n, 1)), Q=np.full(4, 1e-3), R=[1e-2])
    return system, cost, (np.array([0.0, 0.2, 0.0, 0.0]), np.zeros((n, 1)))


def test_a_system_that_remembers_keeps_to_its_derivatives(pendulum):
    system, _, (x0, _) = pendulum
    remembering = RememberingSystem(system, [("input", 0), ("state", 1)])
    rng = np.random.default_rng(0)
    u = rng.standard_normal((system.N, 1))
    run = system.rollout(x0, np.tile(x0, (system.N + 1, 1)), u, np.zeros((system.N, 1, 4)), 0, system.N)
    x = remembering.extended(run.x, run.u)
    report = check_derivatives(remembering, x, u, tolerance=1e-5)
    assert report.ok, str(report)
    assert np.array_equal(x[1:, 4], u[:, 0])
    assert np.array_equal(x[1:, 5], run.x[:-1, 1])


def test_accelerations_of_any_variable_and_rates_of_inputs_are_limited(pendulum):
    system, cost, initial = pendulum
    goal = [Equal("cart", 0.3), Equal("cart", 0.0, of="momentum")]
    free = optimize(system, cost, initial=initial, limits=goal)
    assert free.status is Status.CONVERGED

    def of(result):
        dt = np.diff(system.t)
        rates = np.diff(result.x[:, :2], axis=0) / dt[:, None]
        return np.diff(rates, axis=0) / (0.5 * (dt[1:] + dt[:-1]))[:, None]

    for j, name in enumerate(("cart", "pole")):
        most = 0.9 * np.abs(of(free)[:, j]).max()
        found = optimize(system, cost, initial=initial, limits=[*goal, Bound(name, -most, most, of="acceleration")])
        assert found.status is Status.CONVERGED, found.message
        assert np.abs(of(found)[:, j]).max() == pytest.approx(most, rel=1e-5)
        assert found.cost > free.cost
        assert found.state_names == ("cart", "pole", "p_cart", "p_pole")
        assert found.t[-1] == 1.0

    slow = 0.9 * np.abs(np.diff(free.u[:, 0]) / (0.5 * (system.t[2:] - system.t[:-2]))).max()
    found = optimize(system, cost, initial=initial, limits=[*goal, Bound("push", -slow, slow, of="input rate")])
    assert found.status is Status.CONVERGED, found.message
    rates = np.diff(found.u[:, 0]) / (0.5 * (system.t[2:] - system.t[:-2]))
    assert np.abs(rates).max() == pytest.approx(slow, rel=1e-5)


def test_rates_are_limited_where_the_final_time_is_found_too():
    slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 2.5, 41))
    cost = QuadraticCost(np.zeros((41, 2)), np.zeros((40, 1)), Q=[0.0, 0.0], R=[1e-7])
    limits = [Bound("push", -1.0, 1.0), Equal("x", 1.0), Equal("p_x", 0.0)]
    start = np.zeros(2), np.zeros((40, 1))
    fast = optimize(system, cost, initial=start, unknowns=[FinalTime(0, 10, price=1.0)], limits=limits)
    found = optimize(
        system, cost, initial=start, unknowns=[FinalTime(0, 10, price=1.0)],
        limits=[*limits, Bound("push", -2.0, 2.0, of="input rate"), Bound("final time", max=9.0)],
    )  # fmt: skip
    assert fast.unknowns["final time"] == pytest.approx(2.0, abs=1e-5)
    assert found.status is Status.CONVERGED, found.message
    T = found.unknowns["final time"]
    assert np.abs(np.diff(found.u[:, 0])).max() * 40 / T == pytest.approx(2.0, rel=1e-4)
    # From full ahead to full astern takes a second: the mass goes where such a force takes it.
    t = np.linspace(0.0, T, 20001)
    v = np.cumsum(np.clip((T / 2 - t) * 2.0, -1.0, 1.0)) * (t[1] - t[0])
    assert np.sum(v) * (t[1] - t[0]) == pytest.approx(1.0, abs=5e-3)


def test_what_cannot_look_back_is_told(linear):
    system, cost, initial = linear
    with pytest.raises(ArgumentError, match=r"which is index 0, expected one of 1 \.\. 19"):
        optimize(system, cost, initial=initial, limits=[Bound("u[0]", max=1.0, of="input rate", at=0)])
    quantity = system.quantity("input rate")
    with pytest.raises(ArgumentError, match="the step before, which is no part of the state"):
        quantity.columns(2, 2)
