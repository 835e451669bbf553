"""The optimiser in continuous time: what it finds, how fast, and how it ends."""

from __future__ import annotations

import io
import itertools

import numpy as np
import pytest

from leastaction.errors import ArgumentError, StepError
from leastaction.optimal import (
    FunctionSystem,
    IterationTable,
    QuadraticCost,
    Status,
    check_derivatives,
    optimize,
    optimize_continuous,
)
from leastaction.optimal.continuous import (
    Accuracy,
    ContinuousQuadraticCost,
    DenseTrajectory,
    FunctionContinuousSystem,
    LinearContinuousSystem,
    PiecewisePolynomial,
    solve_continuous_linear_quadratic,
)
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.options import Options
from optimal.continuous.systems import CartPendulum

T = 3.0
REST = {"initial": (np.zeros(4), [0.0]), "horizon": (0.0, T)}
METHODS = ("auto", "newton", "quasi-newton", "steepest")


def _tracking(amplitude=0.8, R=0.01):
    """A cart-pendulum is asked for a swinging motion that it cannot quite make."""
    return ContinuousQuadraticCost(
        lambda t: [0.5 * np.sin(t), amplitude * np.sin(np.pi * t), 0.0, 0.0],
        [0.0],
        Q=[1.0, 10.0, 0.1, 0.1],
        R=[R],
    )


def _swing_up():
    wanted = PiecewisePolynomial.through([0.0, T / 2, T], [[0.0, 0.0, 0.0, 0.0], [0.0, np.pi, 0.0, 0.0]], kind="hold")
    return ContinuousQuadraticCost(wanted, [0.0], Q=[0.1, 1.0, 0.01, 0.01], R=[0.01])


@pytest.fixture
def system():
    return CartPendulum()


@pytest.mark.parametrize("method", ["auto", "newton", "quasi-newton"])
@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_a_linear_system_takes_one_iteration(method, regulator):
    rng = np.random.default_rng(2)
    A, B, c = rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), rng.standard_normal(3)
    system = LinearContinuousSystem(A, B, c=c)
    x_wanted = lambda t: np.sin(t + np.arange(3))  # noqa: E731
    Q, R, x0 = np.array([1.0, 0.5, 2.0]), np.array([1.0, 0.3]), rng.standard_normal(3)
    cost = ContinuousQuadraticCost(x_wanted, [0.3, 0.0], Q=Q, R=R, Q_final=Q)
    result = optimize_continuous(
        system, cost, initial=(x0, [1.0, -1.0]), horizon=(0, 2), method=method, regulator=regulator, collocate=False
    )
    assert result.status is Status.CONVERGED
    assert result.iterations == 1
    assert result.history.step_length[0] == 1.0
    solution = solve_continuous_linear_quadratic(
        A,
        B,
        horizon=(0, 2),
        Q=Q,
        R=R,
        q=lambda t: -Q * x_wanted(t),
        r=-R * [0.3, 0.0],
        c=c,
        Q_final=Q,
        q_final=-Q * x_wanted(2.0),
    )
    t = np.linspace(0, 2, 33)
    x, u = result.dense.sample(t)
    expected = -np.einsum("nij,nj->ni", solution.K(t), x) - solution.C(t)
    np.testing.assert_allclose(u, expected, atol=1e-7 * (1 + np.abs(u).max()))
    if regulator == "descent":
        np.testing.assert_allclose(result.feedback(t), solution.K(t), atol=1e-7)


def test_all_methods_find_the_same_trajectory(system):
    reference = optimize_continuous(system, _tracking(), **REST, method="newton", collocate=False)
    assert reference.success
    t = np.linspace(0, T, 61)
    for method in METHODS:
        for regulator in ("descent", "lqr"):
            steepest = method == "steepest"
            result = optimize_continuous(
                system,
                _tracking(),
                **REST,
                method=method,
                regulator=regulator,
                max_iterations=200,
                tolerance=1e-3 if steepest else 1e-9,
                collocate=False,
            )
            assert result.success, (method, regulator, result.message)
            assert set(result.history.method) <= {method} or method in ("auto", "newton")
            assert result.cost == pytest.approx(reference.cost, rel=5e-2 if steepest else 1e-7)
            if not steepest:
                x = result.dense.x(t)
                np.testing.assert_allclose(x, reference.dense.x(t), atol=1e-3)
            np.testing.assert_allclose(result.x[0], np.zeros(4), atol=1e-14)
            np.testing.assert_allclose(result.K, result.feedback(result.t))


def _problem(system, regulator="descent"):
    """A problem at its first iterate, as the optimiser's loop sees it."""
    settings = Options(
        method="auto",
        regulator=regulator,
        max_iterations=1,
        tolerance=0.0,
        absolute_tolerance=0.0,
        alpha=0.1,
        beta=0.5,
        max_backtracks=1,
        chunk=1,
    )
    problem = ContinuousProblem(system, _tracking(), settings, Accuracy(rtol=1e-11, atol=1e-13), (0.0, T))
    problem.start((np.zeros(4), lambda t: [np.sin(3 * t)]))
    return problem


@pytest.mark.parametrize("regulator", ["descent", "lqr"])
@pytest.mark.parametrize("method", ["steepest", "quasi-newton", "newton"])
def test_the_slope_is_the_derivative_of_the_cost(system, method, regulator):
    """``Dg . dxi`` against differences of the projected cost along the direction."""
    problem = _problem(system, regulator)
    model = problem.models.minimise(method, 1.0)
    direction = problem.steps.direction(method, model, 1.0)
    h = 1e-4
    costs = [problem.steps.simulate(direction, s, np.inf).cost for s in (-h, 0.0, h)]
    assert costs[1] == pytest.approx(problem.here.value, rel=1e-9)
    assert direction.slope < 0.0
    assert direction.slope == pytest.approx((costs[2] - costs[0]) / (2 * h), rel=1e-6)
    if method == "newton" and regulator == "lqr":
        # With gains that do not change with the direction, the exact model foretells the second
        # derivative too: -Dg . dxi.
        h = 3e-3
        costs = [problem.steps.simulate(direction, s, np.inf).cost for s in (-h, 0.0, h)]
        second = (costs[2] - 2 * costs[1] + costs[0]) / h**2
        assert second == pytest.approx(-direction.slope, rel=1e-3)


@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_newton_has_a_quadratic_tail(system, regulator):
    result = optimize_continuous(
        system,
        _tracking(1.2),
        **REST,
        method="newton",
        regulator=regulator,
        tolerance=1e-18,
        absolute_tolerance=0.0,
        accuracy=Accuracy(rtol=1e-11, atol=1e-13),
        collocate=False,
    )
    assert result.success
    gap = np.append(result.history.expected_decrease, result.expected_decrease) / result.cost
    tail = [(before, after) for before, after in itertools.pairwise(gap) if before < 0.05]
    assert len(tail) >= 2
    assert tail[-1][1] < 1e-12
    for before, after in tail:
        assert after < max(20.0 * before**2, 1e-17), gap


def test_the_optimum_is_stationary_and_a_minimum(system):
    cost = _tracking()
    result = optimize_continuous(system, cost, **REST, method="newton")
    for phase in range(3):
        values = []
        for s in (0.05, -0.05):
            u = lambda t, s=s, phase=phase: result.dense.u(t) + s * np.sin(5 * t + phase)  # noqa: E731
            other = optimize_continuous(system, cost, initial=(np.zeros(4), u), horizon=(0, T), max_iterations=0)
            values.append(other.cost)
        assert min(values) > result.cost
        assert abs(values[0] - values[1]) < 0.3 * (sum(values) - 2 * result.cost)


def test_a_swing_up_from_rest(system):
    result = optimize_continuous(system, _swing_up(), **REST)
    assert result.status is Status.CONVERGED
    assert abs(result.x[-1, 1] - np.pi) < 0.3
    assert T / 2 in result.t
    assert (np.diff(result.history.cost) <= 1e-9 * result.cost).all()
    assert {"quasi-newton", "newton", "newton-damped"} <= set(result.history.method)
    assert result.history.method[-1] == "newton"
    # The gains hold the trajectory against a push.
    from leastaction.optimal.continuous import ContinuousProjection

    pushed = result.x[0] + [0.0, 0.02, 0.0, 0.0]
    held = ContinuousProjection(system, result.feedback)(result.dense, x0=pushed)
    none = PiecewisePolynomial.constant(np.zeros((1, 4)), 0.0, T)
    loose = ContinuousProjection(system, none)(result.dense, x0=pushed)
    assert np.abs(held.x - result.x[-1]).max() < 0.1
    assert np.abs(loose.x - result.x[-1]).max() > 0.3


def _steps(system, count):
    """The system by a Runge-Kutta step of fourth order under a held input."""
    h = T / count

    def step(x, u, k):
        f = lambda y: system.f(y, u, 0.0)  # noqa: E731
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        k4 = f(x + h * k3)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    return FunctionSystem(step, nx=4, nu=1, N=count, derivatives="finite-differences")


def test_small_steps_in_discrete_time_find_the_same(system):
    """The discrete optimum under the trapezoidal rule is off by O(dt^2)."""
    cost = _tracking()
    exact = optimize_continuous(system, cost, **REST, method="newton")
    errors = []
    for count in (60, 120):
        dt = T / count
        t = dt * np.arange(count + 1)
        x_wanted = np.stack([cost.x_wanted.at(s) for s in t])
        Q = np.tile(dt * cost.Q.at(0.0), (count, 1))[:, :, None]
        Q[0] *= 0.5
        discrete = QuadraticCost(
            x_wanted,
            np.zeros((count, 1)),
            Q=Q,
            R=dt * cost.R.at(0.0),
            Q_final=0.5 * dt * cost.Q.at(0.0),
        )
        result = optimize(
            _steps(system, count),
            discrete,
            initial=(np.zeros(4), np.zeros((count, 1))),
            method="quasi-newton",
            tolerance=1e-14,
        )
        assert result.success
        middle = t[:-1] + dt / 2
        errors.append(
            [
                np.abs(result.x - exact.dense.x(t)).max(),
                np.abs(result.u - exact.dense.u(middle)).max(),
                abs(result.cost - exact.cost),
            ]
        )
    coarse, fine = np.array(errors)
    assert (fine < [2e-3, 5e-2, 3e-3]).all(), errors
    np.testing.assert_array_less(coarse / fine, 4.8)
    np.testing.assert_array_less(3.2, coarse / fine)


@pytest.mark.parametrize("method", ["auto", "newton", "quasi-newton"])
@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_stopped_and_resumed_is_as_never_stopped(system, method, regulator):
    cost = _swing_up()
    how = {"method": method, "regulator": regulator, "max_iterations": 5}
    whole = optimize_continuous(system, cost, **REST, **how)
    stopped = optimize_continuous(system, cost, **REST, **how, callback=lambda record: record.iteration >= 2)
    assert stopped.status is Status.STOPPED_BY_CALLBACK
    assert stopped.iterations == 2
    resumed = optimize_continuous(system, cost, resume=stopped, **{**how, "max_iterations": whole.iterations - 2})
    np.testing.assert_array_equal(resumed.history.cost, whole.history.cost)
    np.testing.assert_array_equal(resumed.x, whole.x)
    np.testing.assert_array_equal(resumed.K, whole.K)
    assert resumed.history.method == whole.history.method


def test_resuming_knows_the_cost(system):
    first = optimize_continuous(system, _tracking(), **REST, max_iterations=2)
    again = optimize_continuous(system, _tracking(), resume=first, max_iterations=0)
    assert again.cost == first.cost
    assert again.expected_decrease == first.expected_decrease


def test_a_trial_is_given_up_once_it_is_past_its_bound(system):
    problem = _problem(system)
    direction = problem.steps.direction("newton", problem.models.minimise("newton", 1.0), 1.0)
    whole = problem.steps.simulate(direction, 1.0, np.inf)
    refused = problem.steps.simulate(direction, 1.0, 0.5 * whole.cost)
    assert "past its bound" in refused.reason
    time = float(refused.reason.split("t = ")[1].split(" s")[0])
    assert 0.0 < time < 0.9 * T
    problem.cost.nonnegative = False
    refused = problem.steps.simulate(direction, 1.0, 0.5 * whole.cost)
    assert "where at most" in refused.reason


def test_the_size_of_the_cost_does_not_matter(system):
    large = optimize_continuous(system, _tracking(), **REST, absolute_tolerance=0.0)
    small = ContinuousQuadraticCost(_tracking().x_wanted.at, [0.0], Q=1e-7 * np.array([1.0, 10.0, 0.1, 0.1]), R=[1e-9])
    result = optimize_continuous(system, small, **REST, absolute_tolerance=0.0)
    assert result.status is Status.CONVERGED
    assert result.history.method == large.history.method
    np.testing.assert_allclose(1e7 * result.history.cost, large.history.cost, rtol=1e-8)


def test_what_is_wanted_last_is_what_was_wanted_until_then():
    cost = ContinuousQuadraticCost(lambda t: [1.0 if t < T else 5.0], [0.0], Q=[1.0], R=[1.0], Q_final=[2.0])
    assert cost.final_value(np.array([1.0]), T) == 0.0
    assert cost.final_value(np.array([2.0]), T) == 1.0
    told = ContinuousQuadraticCost([1.0], [0.0], Q=[1.0], R=[1.0], Q_final=[2.0], x_final=[4.0])
    assert told.final_gradient(np.array([1.0]), T) == -6.0


def test_another_cost_can_be_asked_for_on_resuming(system):
    first = optimize_continuous(system, _tracking(0.5), **REST)
    resumed = optimize_continuous(system, _tracking(0.8), resume=first)
    fresh = optimize_continuous(system, _tracking(0.8), **REST)
    assert resumed.cost == pytest.approx(fresh.cost, rel=1e-7)


def test_ctrl_c_gives_the_last_iterate():
    class Interrupted(CartPendulum):
        calls = 0

        def linearize(self, x, u, t):
            self.calls += 1
            if self.calls == 3:
                raise KeyboardInterrupt
            return super().linearize(x, u, t)

    records = []
    result = optimize_continuous(
        Interrupted(), _tracking(1.5), **REST, callback=lambda r: records.append(r), collocate=False
    )
    assert result.status is Status.INTERRUPTED
    assert result.iterations == records[-1].iteration >= 1
    np.testing.assert_array_equal(result.x, records[-1].x)
    assert np.isfinite(result.K).all()
    resumed = optimize_continuous(CartPendulum(), _tracking(1.5), resume=result, collocate=False)
    whole = optimize_continuous(CartPendulum(), _tracking(1.5), **REST, collocate=False)
    np.testing.assert_array_equal(resumed.x, whole.x)


class _Walled(CartPendulum):
    """Has no rate once the cart goes too fast."""

    def __init__(self, limit):
        super().__init__()
        self.limit = limit

    def f(self, x, u, t):
        if abs(x[2]) > self.limit:
            raise StepError("too fast", t=t, residuals={}, iteration=0, state=x)
        return super().f(x, u, t)


def test_a_failed_rollout_is_a_shorter_step(system):
    free = optimize_continuous(system, _tracking(), **REST, max_iterations=1)
    assert free.history.step_length[0] == 1.0
    limit = 0.7 * np.abs(free.x[:, 2]).max()
    result = optimize_continuous(_Walled(limit), _tracking(), **REST, max_iterations=1)
    assert 0.0 < result.history.step_length[0] < 1.0
    assert result.history.rollouts[0] > 1
    assert np.abs(result.x[:, 2]).max() <= limit
    stuck = optimize_continuous(_Walled(0.0), _tracking(), **REST, max_backtracks=4)
    assert stuck.status is Status.LINE_SEARCH_FAILED
    assert "too fast" in stuck.message
    assert stuck.iterations == 0


def test_wrong_derivatives_end_in_a_failed_search():
    class Wrong(CartPendulum):
        def linearize(self, x, u, t):
            A, B = super().linearize(x, u, t)
            return A, -B

    result = optimize_continuous(
        Wrong(), _tracking(), **REST, method="quasi-newton", max_iterations=20, max_backtracks=8, collocate=False
    )
    assert result.status is Status.LINE_SEARCH_FAILED
    report = check_derivatives(Wrong(), result.dense, cost=_tracking())
    assert not report.ok
    assert [name for name, error in report.errors.items() if error > 1e-6] == ["linearize"]
    assert check_derivatives(CartPendulum(), result.dense, cost=_tracking()).ok


def test_derivatives_that_fail_end_the_run():
    class Failing(CartPendulum):
        calls = 0

        def linearize(self, x, u, t):
            A, B = super().linearize(x, u, t)
            self.calls += 1
            if self.calls == 3:
                A[5, 2, 1] = np.nan
            return A, B

    result = optimize_continuous(Failing(), _tracking(1.5), **REST, collocate=False)
    assert result.status is Status.DERIVATIVES_FAILED
    assert "nan" in result.message
    assert result.iterations >= 1


def test_plain_functions_are_systems(system):
    """Complex step and differences give the optimum of the exact derivatives."""

    def f(x, u, t):
        sin, cos = np.sin(x[1]), np.cos(x[1])
        mass = 1.0 + 0.3 * sin**2
        a = (u[0] + 0.3 * sin * (x[3] ** 2 + 9.81 * cos)) / mass
        al = (-u[0] * cos - 0.3 * x[3] ** 2 * cos * sin - 1.3 * 9.81 * sin) / mass
        return np.array([x[2], x[3], a, al])

    plain = FunctionContinuousSystem(f, nx=4, nu=1, derivatives="complex-step", curvature="differences")
    exact = optimize_continuous(system, _tracking(1.2), **REST, method="newton")
    result = optimize_continuous(plain, _tracking(1.2), **REST, method="newton")
    assert result.history.method == exact.history.method
    assert result.cost == pytest.approx(exact.cost, rel=1e-8)
    assert check_derivatives(plain, result.dense, tolerance=1e-5).ok
    first_order = FunctionContinuousSystem(f, nx=4, nu=1, derivatives=system.derivatives)
    result = optimize_continuous(first_order, _tracking(), **REST)
    assert result.success
    assert set(result.history.method) == {"quasi-newton"}
    with pytest.raises(ArgumentError, match="no second derivative"):
        optimize_continuous(first_order, _tracking(), **REST, method="newton")


def test_a_curve_is_projected_first(system):
    records = []
    curve = {
        "initial": (lambda t: [0.1 * np.sin(t), 0.0, 0.1, 0.0], lambda t: [0.2 * np.cos(t)]),
        "horizon": (0.0, T),
    }
    result = optimize_continuous(system, _tracking(), **curve, callback=lambda r: records.append(r))
    assert records[0].method == "start"
    assert result.success
    np.testing.assert_allclose(result.x[0], [0.0, 0.0, 0.1, 0.0], atol=1e-9)
    t = np.linspace(0, T, 101)
    x, u = result.dense.sample(t)
    rates = np.stack([system.f(*at) for at in zip(x, u, t.tolist(), strict=True)])
    np.testing.assert_allclose(result.dense.x.derivative()(t), rates, atol=1e-4)


def test_a_fallback_is_noted():
    class Nonsense(CartPendulum):
        def curvatures(self, x, u, t, z):
            return np.broadcast_to(-1e6 * np.eye(5), (len(t), 5, 5))

    records = []
    result = optimize_continuous(Nonsense(), _tracking(), **REST, method="newton", callback=lambda r: records.append(r))
    assert result.success
    assert set(result.history.method) == {"quasi-newton"}
    assert all("newton" in r.note and "no minimum" in r.note for r in records[1:])


def test_the_table_and_the_records(system, capsys):
    file = io.StringIO()
    records = []
    result = optimize_continuous(
        system,
        _tracking(1.5),
        **REST,
        callback=IterationTable(file=file, then=lambda r: records.append(r)),
        collocate=False,
    )
    lines = file.getvalue().splitlines()
    assert len([line for line in lines if line.strip()[:1].isdigit()]) == result.iterations + 1
    assert f"{result.cost:.9e}" in lines[-1]
    np.testing.assert_array_equal(result.history.cost, [r.cost for r in records])
    np.testing.assert_array_equal(records[-1].x, result.x)
    parts = sum(seconds for part, seconds in result.timings.items() if part != "total")
    assert 0 < parts < result.timings["total"]
    assert "CONVERGED" in str(result)
    assert capsys.readouterr().out == ""


def test_stiff_weights_need_an_implicit_integrator(system):
    """A ratio of weights of 1e7; the dissertation's had to stay below 100 (6.7.1)."""
    cost = ContinuousQuadraticCost(
        lambda t: [0.0, 0.3 * np.sin(2 * t), 0.0, 0.0], [0.0], Q=[1.0, 1e4, 1e-2, 1e-2], R=[1e-3]
    )
    how = {"initial": (np.zeros(4), [0.0]), "horizon": (0.0, 1.0), "method": "newton"}
    explicit = optimize_continuous(system, cost, **how)
    implicit = optimize_continuous(system, cost, **how, accuracy=Accuracy(solver="Radau", rtol=1e-7, atol=1e-9))
    assert explicit.success
    assert implicit.success
    assert implicit.cost == pytest.approx(explicit.cost, rel=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "magic"}, "method: got 'magic'"),
        ({"regulator": "pid"}, "regulator: got 'pid'"),
        ({"max_iterations": -1}, "max_iterations: got -1"),
        ({"alpha": 0.7}, "alpha: got 0.7"),
        ({"initial": None}, "got neither"),
        ({"horizon": None}, "horizon: got None"),
        ({"horizon": (1.0, 0.0)}, r"horizon: got \(1.0, 0.0\)"),
        ({"initial": (np.zeros(3), [0.0])}, "initial x: got shape"),
        ({"initial": (np.zeros(4), [0.0, 1.0])}, "u: got shape"),
        ({"initial": (np.full(4, np.nan), [0.0])}, "initial x: got nan"),
        ({"initial": (np.zeros(4), lambda t: [np.inf])}, "u at t = 0 s: got inf"),
        (
            {"initial": DenseTrajectory.from_samples([0, T], np.zeros((2, 3)), np.zeros((2, 1)))},
            "initial: got a trajectory of 3 states",
        ),
        (
            {"initial": DenseTrajectory.from_samples([0, 1], np.zeros((2, 4)), np.zeros((2, 1)))},
            "horizon: got",
        ),
    ],
)
def test_bad_input(system, arguments, message):
    with pytest.raises(ArgumentError, match=message):
        optimize_continuous(system, _tracking(), **{**REST, **arguments})


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        (lambda: ContinuousQuadraticCost([0.0], [0.0], Q=[1.0], R=[1.0]), "x_wanted: got shape"),
        (
            lambda: ContinuousQuadraticCost(np.zeros(4), [0.0], Q=np.ones(4), R=lambda t: [t - 1]),
            "R: got a smallest eigenvalue",
        ),
        (
            lambda: ContinuousQuadraticCost(np.zeros(4), lambda t: "x", Q=np.ones(4), R=[1.0]),
            "u_wanted: at t = 0 s",
        ),
        (lambda: ContinuousQuadraticCost(np.zeros(4), [0.0], Q=np.ones(4), R=[0.0]), "R: got a"),
        (lambda: ContinuousQuadraticCost(np.zeros(4), [0.0], Q=-np.ones(4), R=[1.0]), "Q: got a"),
        (
            lambda: ContinuousQuadraticCost(np.zeros(4), [0.0], Q=np.triu(np.ones((4, 4))), R=[1.0]),
            "differs from its transpose",
        ),
    ],
)
def test_bad_costs(system, cost, message):
    with pytest.raises(ArgumentError, match=message):
        optimize_continuous(system, cost(), **REST)


def test_a_start_that_cannot_be_simulated():
    with pytest.raises(ArgumentError, match="too fast"):
        optimize_continuous(_Walled(0.5), _tracking(), initial=(np.zeros(4), [10.0]), horizon=(0, T))
    system = FunctionContinuousSystem(
        lambda x, u, t: np.array([x[0] ** 2 + u[0]]), nx=1, nu=1, derivatives="complex-step"
    )
    cost = ContinuousQuadraticCost([0.0], [0.0], Q=[1.0], R=[1.0])
    with pytest.raises(ArgumentError, match=r"failed at t = 1 s: the solver gave up"):
        optimize_continuous(system, cost, initial=([1.0], [0.0]), horizon=(0, 2))


# Saddles


def _parabola() -> FunctionContinuousSystem:
    """Return a system that rises whichever way its input moves it: a rest is a saddle where it is to rise."""
    return FunctionContinuousSystem(
        lambda x, u, t: np.array([u[0], x[0] ** 2]),
        nx=2,
        nu=1,
        derivatives=lambda x, u, t: (np.array([[0.0, 0.0], [2.0 * x[0], 0.0]]), np.array([[1.0], [0.0]])),
        curvature=lambda x, u, t, z: np.diag([2.0 * z[1], 0.0, 0.0]),
    )


_RISE = ContinuousQuadraticCost([0.0, 1.0], [0.0], Q=[0.0, 1.0], R=[1e-2])


@pytest.mark.parametrize(("method", "regulator"), [("auto", "descent"), ("newton", "lqr")])
def test_a_saddle_is_left(method, regulator):
    result = optimize_continuous(
        _parabola(),
        _RISE,
        initial=(np.zeros(2), np.zeros(1)),
        horizon=(0.0, 2.0),
        method=method,
        regulator=regulator,
        accuracy=Accuracy(rtol=1e-6, atol=1e-8),
        tolerance=1e-4,
        collocate=False,
    )
    assert result.status is Status.CONVERGED
    assert result.history.method[0] == "negative-curvature"
    assert (np.diff(result.history.cost) < 0).all()
    assert result.cost < 0.5 * result.history.cost[0]


def test_a_saddle_is_not_said_to_be_a_minimum():
    result = optimize_continuous(
        _parabola(), _RISE, initial=(np.zeros(2), np.zeros(1)), horizon=(0.0, 2.0), method="quasi-newton"
    )
    assert result.status is Status.SADDLE
    assert not result.success
    assert "negative curvature" in result.message
