"""The optimiser: what it finds, how fast, and how it ends."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
import pytest

from leastaction.errors import ArgumentError, StepError
from leastaction.optimal import (
    FunctionSystem,
    IterationRecord,
    IterationTable,
    LinearSystem,
    QuadraticCost,
    Status,
    adjoint,
    check_derivatives,
    optimize,
    regulate,
    solve_linear_quadratic,
)
from optimal.systems import CartPendulum, simulate

N, DT = 200, 0.02
METHODS = ("auto", "newton", "quasi-newton", "steepest")


def _tracking(amplitude=0.8, R=0.01):
    """A cart-pendulum is asked for a swinging motion that it cannot quite make."""
    t = DT * np.arange(N + 1)
    x_wanted = np.zeros((N + 1, 4))
    x_wanted[:, 0] = 0.5 * np.sin(t)
    x_wanted[:, 1] = amplitude * np.sin(np.pi * t)
    return QuadraticCost(x_wanted, np.zeros((N, 1)), Q=[1.0, 10.0, 0.1, 0.1], R=[R])


def _swing_up():
    x_wanted = np.zeros((N + 1, 4))
    x_wanted[N // 2 :, 1] = np.pi
    return QuadraticCost(x_wanted, np.zeros((N, 1)), Q=[0.1, 1.0, 0.01, 0.01], R=[0.01])


REST = (np.zeros(4), np.zeros((N, 1)))


@pytest.fixture
def system():
    return CartPendulum(N, DT)


@pytest.mark.parametrize("method", ["auto", "newton", "quasi-newton"])
@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_a_linear_system_takes_one_iteration(method, regulator):
    rng = np.random.default_rng(2)
    steps, nx, nu = 80, 6, 2
    A = np.eye(nx) + 0.1 * rng.standard_normal((steps, nx, nx))
    system = LinearSystem(A, 0.3 * rng.standard_normal((nx, nu)), c=0.1 * rng.standard_normal(nx))
    x_wanted, u_wanted = rng.standard_normal((steps + 1, nx)), rng.standard_normal((steps, nu))
    cost = QuadraticCost(x_wanted, u_wanted, Q=rng.uniform(0, 2, nx), R=rng.uniform(0.5, 2, nu))
    u0 = rng.standard_normal((steps, nu))
    x0 = rng.standard_normal(nx)
    result = optimize(system, cost, initial=(x0, u0), method=method, regulator=regulator)
    assert result.status is Status.CONVERGED
    assert result.iterations == 1
    assert result.history.step_length[0] == 1.0
    # The same optimum, from one affine linear-quadratic problem about the origin.
    solution = solve_linear_quadratic(
        *system.linearize(None, None),
        Q=cost.Q,
        R=cost.R,
        q=-cost.Q * x_wanted[:-1],
        r=-cost.R * u_wanted,
        c=np.tile(system.f(np.zeros(nx), np.zeros(nu), 0), (steps, 1)),
        Q_final=cost.Q,
        q_final=-cost.Q * x_wanted[-1],
    )
    x, u = [x0], []
    for k in range(steps):
        u.append(-solution.K[k] @ x[-1] - solution.C[k])
        x.append(system.f(x[-1], u[-1], k))
    scale = np.abs(x).max()
    np.testing.assert_allclose(result.x, x, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(result.u, u, rtol=0, atol=1e-12 * scale)
    assert result.expected_decrease < 1e-12 * result.cost
    np.testing.assert_allclose(
        result.K,
        regulate(*system.linearize(None, None))
        if regulator == "lqr"
        else regulate(*system.linearize(None, None), Q=cost.Q, R=cost.R),
        atol=1e-10,
    )


def test_all_methods_find_the_same_trajectory(system):
    reference = optimize(system, _tracking(), initial=REST, tolerance=1e-13)
    assert reference.success
    for method in METHODS:
        for regulator in ("descent", "lqr"):
            result = optimize(
                system,
                _tracking(),
                initial=REST,
                method=method,
                regulator=regulator,
                max_iterations=30 if method != "steepest" else 400,
                tolerance=1e-11 if method != "steepest" else 1e-7,
            )
            assert result.status is Status.CONVERGED, (method, regulator, result.message)
            assert set(result.history.method) <= {method} or method in ("auto", "newton")
            assert result.cost == pytest.approx(reference.cost, rel=1e-5)
            if method != "steepest":
                np.testing.assert_allclose(result.x, reference.x, atol=1e-5)
            np.testing.assert_array_equal(result.x[0], np.zeros(4))
            np.testing.assert_allclose(result.x, simulate(system, result.x[0], result.u), atol=1e-8)


def test_the_optimum_is_stationary_and_a_minimum(system):
    cost = _tracking()
    result = optimize(system, cost, initial=REST, method="newton", tolerance=1e-18)
    rng = np.random.default_rng(0)
    for _ in range(5):
        du = rng.standard_normal((N, 1))
        h = 1e-4
        values = [cost.value(simulate(system, np.zeros(4), result.u + s * du), result.u + s * du) for s in (h, -h)]
        assert min(values) > result.cost
        assert abs(values[0] - values[1]) < 1e-3 * (sum(values) - 2 * result.cost)


@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_newton_has_a_quadratic_tail(system, regulator):
    """The expected decrease is quadratic in the distance: its digits double with every step."""
    result = optimize(
        system,
        _tracking(1.2),
        initial=REST,
        method="newton",
        regulator=regulator,
        tolerance=1e-25,
        absolute_tolerance=0.0,
    )
    assert result.success
    gap = result.history.expected_decrease / result.cost
    full = (result.history.step_length == 1.0) & (result.history.curvature_scale == 1.0)
    pairs = zip(gap[:-1], gap[1:], full[:-1], strict=True)
    tail = [(before, after) for before, after, ok in pairs if ok and before < 0.02]
    assert len(tail) >= 3
    assert tail[-1][1] < 1e-15
    for before, after in tail:
        assert after < 20.0 * before**2, gap
    quasi = optimize(system, _tracking(1.2), initial=REST, method="quasi-newton", regulator=regulator)
    assert quasi.iterations > result.iterations


def test_a_swing_up_from_rest(system):
    result = optimize(system, _swing_up(), initial=REST, max_iterations=200)
    assert result.status is Status.CONVERGED
    assert abs(result.x[-1, 1] - np.pi) < 0.1
    assert (np.diff(result.history.cost) <= 0).all()
    # All that the automatic choice can do is seen in the history.
    assert "quasi-newton" in result.history.method
    assert "newton" in result.history.method
    assert "newton-damped" in result.history.method
    damped = np.array(result.history.method) == "newton-damped"
    scales = result.history.curvature_scale
    assert ((scales[damped] > 0) & (scales[damped] < 1)).all()
    assert result.history.method[-1] == "newton"


def test_the_gains_hold_the_trajectory(system):
    result = optimize(system, _swing_up(), initial=REST, max_iterations=200)
    pushed = result.x[0] + [0.0, 0.02, 0.0, 0.0]
    held = system.rollout(pushed, result.x, result.u, result.K, 0, N)
    loose = system.rollout(pushed, result.x, result.u, np.zeros_like(result.K), 0, N)
    assert np.abs(held.x[-1] - result.x[-1]).max() < 0.1
    assert np.abs(loose.x[-1] - result.x[-1]).max() > 1.0


def test_a_curve_is_projected_first(system):
    rng = np.random.default_rng(1)
    curve = 0.05 * rng.standard_normal((N + 1, 4)), 0.05 * rng.standard_normal((N, 1))
    first = []
    optimize(system, _tracking(), initial=curve, callback=lambda r: first.append(r))
    assert first[0].method == "start"
    # From there on nothing is left of the curve.
    again = optimize(system, _tracking(), initial=(first[0].x, first[0].u), regulator="lqr")
    result = optimize(system, _tracking(), initial=curve, regulator="lqr")
    np.testing.assert_allclose(result.history.cost, again.history.cost, rtol=1e-9)
    for k in range(N):
        np.testing.assert_allclose(first[0].x[k + 1], system.f(first[0].x[k], first[0].u[k], k), atol=1e-13)
    np.testing.assert_array_equal(result.x[0], curve[0][0])
    assert result.success


def test_a_trajectory_is_taken_as_it_is(system):
    u = np.ones((N, 1))
    x = simulate(system, np.zeros(4), u)
    counting = _Counting(N, DT)
    result = optimize(counting, _tracking(), initial=(x, u), max_iterations=0)
    assert result.x is not None
    np.testing.assert_array_equal(result.x, x)
    assert counting.linearized == 1
    assert result.status is Status.ITERATION_LIMIT
    assert result.expected_decrease > 0
    assert result.iterations == 0


def test_an_initial_state_alone_is_rolled_out_once(system):
    """What comes of it is a trajectory: it is not projected once more."""
    u = np.ones((N, 1))
    result = optimize(system, _tracking(), initial=(np.zeros(4), u), max_iterations=0)
    np.testing.assert_array_equal(result.x, simulate(system, np.zeros(4), u))
    assert result.rollouts == 1


class _Counting(CartPendulum):
    linearized = 0

    def linearize(self, x, u, out=None):
        self.linearized += 1
        return super().linearize(x, u, out)


def test_records_and_histories_agree(system):
    records = []
    result = optimize(system, _tracking(1.5), initial=REST, callback=lambda r: records.append(r))
    history = result.history
    assert [r.iteration for r in records] == list(range(result.iterations + 1))
    np.testing.assert_array_equal(history.cost, [r.cost for r in records])
    np.testing.assert_array_equal(history.step_length, [r.step_length for r in records[1:]])
    assert history.method == tuple(r.method for r in records[1:])
    assert history.rollouts.sum() + records[0].rollouts <= result.rollouts
    np.testing.assert_array_equal(records[-1].x, result.x)
    assert result.cost == records[-1].cost == pytest.approx(_tracking(1.5).value(result.x, result.u))
    parts = sum(seconds for part, seconds in result.timings.items() if part != "total")
    assert 0 < parts < result.timings["total"]
    assert (np.diff(history.seconds) > 0).all()
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.cost = 0.0


@pytest.mark.parametrize("method", ["auto", "newton", "quasi-newton"])
@pytest.mark.parametrize("regulator", ["descent", "lqr"])
@pytest.mark.parametrize("stop", [1, 4])
def test_stopped_and_resumed_is_as_never_stopped(system, method, regulator, stop):
    cost = _swing_up()
    how = {"method": method, "regulator": regulator, "max_iterations": 12}
    whole = optimize(system, cost, initial=REST, **how)
    stopped = optimize(system, cost, initial=REST, **how, callback=lambda record: record.iteration >= stop)
    assert stopped.status is Status.STOPPED_BY_CALLBACK
    assert stopped.iterations == stop
    np.testing.assert_array_equal(stopped.x[0], whole.x[0])
    resumed = optimize(system, cost, resume=stopped, **{**how, "max_iterations": whole.iterations - stop})
    np.testing.assert_array_equal(resumed.history.cost, whole.history.cost)
    assert resumed.history.method == whole.history.method
    np.testing.assert_array_equal(resumed.x, whole.x)
    np.testing.assert_array_equal(resumed.u, whole.u)
    np.testing.assert_array_equal(resumed.K, whole.K)


@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_a_snapshot_goes_on_as_the_run_that_it_was_taken_of(system, regulator):
    cost = _swing_up()
    how = {"regulator": regulator, "max_iterations": 12}
    whole = optimize(system, cost, initial=REST, **how)
    kept = []
    watched = optimize(system, cost, initial=REST, **how, callback=lambda record: kept.append(record.snapshot()))
    # Taking them changes nothing.
    np.testing.assert_array_equal(watched.x, whole.x)
    assert [snapshot.iterations for snapshot in kept] == list(range(whole.iterations + 1))
    for snapshot in kept[::3]:
        resumed = optimize(
            system,
            cost,
            resume=snapshot,
            regulator=regulator,
            max_iterations=whole.iterations - snapshot.iterations,
        )
        np.testing.assert_array_equal(resumed.history.cost, whole.history.cost)
        np.testing.assert_array_equal(resumed.x, whole.x)
        np.testing.assert_array_equal(resumed.u, whole.u)
        np.testing.assert_array_equal(resumed.K, whole.K)


def test_the_iteration_limit_and_going_on(system):
    first = optimize(system, _tracking(1.5), initial=REST, max_iterations=3)
    assert first.status is Status.ITERATION_LIMIT
    assert not first.success
    assert first.iterations == 3
    assert "resume" in first.message
    second = optimize(system, _tracking(1.5), resume=first)
    assert second.success
    assert second.history.cost[0] == first.history.cost[0]


def test_a_run_that_is_cut_off_after_a_step_of_which_nothing_was_expected_tells_how_it_stands(system):
    # Among barriers a refined direction may go uphill at first, and lower the cost all the same.
    first = optimize(system, _tracking(1.5), initial=REST, max_iterations=3)
    uphill = dataclasses.replace(first.history, expected_decrease=-np.abs(first.history.expected_decrease))
    second = optimize(system, _tracking(1.5), resume=dataclasses.replace(first, history=uphill), max_iterations=1)
    assert second.status is Status.ITERATION_LIMIT
    assert "The expected decrease is still" in second.message


def test_a_run_that_is_cut_off_before_a_goal_of_nothing_tells_how_it_stands(system):
    """Nobody knows how many more iterations an expected decrease of zero takes."""
    result = optimize(system, _tracking(1.5), initial=REST, max_iterations=3, tolerance=0.0, absolute_tolerance=0.0)
    assert result.status is Status.ITERATION_LIMIT
    assert "where 0 is asked for" in result.message
    assert result.message.endswith("of itself.")


def test_stopping_at_once(system):
    result = optimize(system, _tracking(), initial=REST, callback=lambda record: True)
    assert result.status is Status.STOPPED_BY_CALLBACK
    assert result.iterations == 0
    assert np.isfinite(result.K).all()


def test_ctrl_c_keeps_the_last_iterate(system):
    class Impatient(CartPendulum):
        calls = 0

        def linearize(self, x, u, out=None):
            self.calls += 1
            if self.calls == 3:
                raise KeyboardInterrupt
            return super().linearize(x, u, out)

    records = []
    result = optimize(Impatient(N, DT), _tracking(1.5), initial=REST, callback=lambda r: records.append(r))
    assert result.status is Status.INTERRUPTED
    assert result.iterations == records[-1].iteration >= 1
    np.testing.assert_array_equal(result.x, records[-1].x)
    resumed = optimize(system, _tracking(1.5), resume=result)
    whole = optimize(system, _tracking(1.5), initial=REST)
    np.testing.assert_array_equal(resumed.x, whole.x)


class _Walled(CartPendulum):
    """Has no next state once the cart goes too fast."""

    def __init__(self, limit):
        super().__init__(N, DT)
        self.limit = limit
        self.failed = 0

    def f(self, x, u, k):
        if abs(x[2]) > self.limit:
            self.failed += 1
            raise StepError("too fast", t=k * DT, residuals={}, iteration=0, state=x)
        return super().f(x, u, k)


def test_a_failed_rollout_is_a_shorter_step(system):
    free = optimize(system, _tracking(), initial=REST, max_iterations=1)
    assert free.history.step_length[0] == 1.0
    limit = 0.7 * np.abs(free.x[:, 2]).max()
    walled = _Walled(limit)
    result = optimize(walled, _tracking(), initial=REST, max_iterations=1)
    assert walled.failed >= 1
    assert 0.0 < result.history.step_length[0] < 1.0
    assert result.history.rollouts[0] > 1
    assert np.abs(result.x[:-1, 2]).max() <= limit


def test_no_way_down_is_said_with_the_reason():
    walled = _Walled(0.0)
    result = optimize(walled, _tracking(), initial=REST, max_backtracks=5)
    assert result.status is Status.LINE_SEARCH_FAILED
    assert "too fast" in result.message
    assert result.iterations == 0
    np.testing.assert_array_equal(result.u, 0.0)


def test_wrong_derivatives_end_in_a_failed_search(system):
    class Wrong(CartPendulum):
        def linearize(self, x, u, out=None):
            A, B = super().linearize(x, u)
            return A, -B

    wrong = Wrong(N, DT)
    result = optimize(wrong, _tracking(), initial=REST, method="quasi-newton", max_iterations=20)
    assert result.status is Status.LINE_SEARCH_FAILED
    assert "check_derivatives" in result.message
    assert not check_derivatives(wrong, result.x, result.u).ok


def test_derivatives_that_fail_end_the_run(system):
    class Failing(CartPendulum):
        calls = 0

        def linearize(self, x, u, out=None):
            A, B = super().linearize(x, u)
            self.calls += 1
            if self.calls == 3:
                A[17] = np.nan
            return A, B

    result = optimize(Failing(N, DT), _tracking(1.5), initial=REST)
    assert result.status is Status.DERIVATIVES_FAILED
    assert "stage 17" in result.message
    assert result.iterations >= 1


def test_trials_end_as_soon_as_they_cost_too_much(system):
    """Roll-outs in chunks give the same iterates with fewer steps."""
    steps = {}
    results = {}
    for chunk in (10, N):
        counted = _CountedSteps(N, DT)
        results[chunk] = optimize(counted, _swing_up(), initial=REST, chunk=chunk, max_iterations=15)
        steps[chunk] = counted.steps
    np.testing.assert_array_equal(results[10].x, results[N].x)
    assert (results[10].history.rollouts > 1).any()
    assert steps[10] < steps[N]


class _CountedSteps(CartPendulum):
    steps = 0

    def f(self, x, u, k):
        self.steps += 1
        return super().f(x, u, k)


def test_it_ends_where_double_precision_does(system):
    result = optimize(system, _tracking(1.5), initial=REST, tolerance=0.0, absolute_tolerance=0.0)
    assert result.success
    assert result.iterations < 30
    assert result.expected_decrease < 1e-9 * result.cost


def test_a_cost_that_may_be_negative(system):
    """Without its early end, and with an indefinite Hessian, of which the convex part is used."""

    class Negative(QuadraticCost):
        nonnegative = False

        def stage_values(self, x, u, start):
            return super().stage_values(x, u, start) - 100.0

        def hessian(self, x, u):
            Q, R, S, Q_final = super().hessian(x, u)
            return Q, R - 1e3, S, Q_final

    plain = _tracking()
    cost = Negative(plain.x_wanted, plain.u_wanted, Q=plain.Q, R=plain.R)
    result = optimize(system, cost, initial=REST, max_iterations=5)
    assert result.cost < 0
    assert set(result.history.method) == {"quasi-newton"}
    assert np.isfinite(result.K).all()


def test_a_system_without_curvature():
    exact = CartPendulum(N, DT)
    system = FunctionSystem(lambda x, u, k: np.array(exact._f(*x, *u)), nx=4, nu=1, N=N, derivatives=exact.derivatives)
    result = optimize(system, _tracking(), initial=REST)
    assert result.success
    assert set(result.history.method) == {"quasi-newton"}
    with pytest.raises(ArgumentError, match="no second derivative"):
        optimize(system, _tracking(), initial=REST, method="newton")


def test_the_table(system):
    file = io.StringIO()
    result = optimize(system, _tracking(1.5), initial=REST, callback=IterationTable(file=file))
    lines = file.getvalue().splitlines()
    assert len([line for line in lines if line.strip()[:1].isdigit()]) == result.iterations + 1
    assert "expected" in lines[0]
    table = IterationTable(file=file)
    record = IterationRecord(7, "steepest", 1.0, 0.5, 0.1, 3, 0.0, "why", 1.5, result.x, result.u, lambda: result)
    table(record)
    assert file.getvalue().splitlines()[-1].strip() == "why"
    assert "quasi-newton" in file.getvalue()
    assert f"{result.cost:.9e}" in lines[-1]
    assert len(lines) >= 1 + len(result.history.cost)
    stopped = optimize(
        system,
        _tracking(1.5),
        initial=REST,
        callback=IterationTable(file=io.StringIO(), then=lambda r: r.iteration == 2),
    )
    assert stopped.iterations == 2
    assert "STOPPED_BY_CALLBACK" in str(stopped)


def test_a_fallback_is_noted(system):
    """A system whose curvature is nonsense: the method is replaced, and the record says why."""

    class Nonsense(CartPendulum):
        def curvatures(self, x, u, z, out=None):
            return -1e6 * np.broadcast_to(np.eye(5), (N, 5, 5))

    records = []
    result = optimize(
        Nonsense(N, DT),
        _tracking(),
        initial=REST,
        method="newton",
        callback=lambda r: records.append(r),
    )
    assert result.success
    assert set(result.history.method) == {"quasi-newton"}
    assert all("newton" in r.note and "no minimum" in r.note for r in records[1:])


def test_newton_is_tried_less_often_while_it_fails(system):
    class Nonsense(CartPendulum):
        tried = 0

        def curvatures(self, x, u, z, out=None):
            self.tried += 1
            return -1e6 * np.broadcast_to(np.eye(5), (N, 5, 5))

    nonsense = Nonsense(N, DT)
    result = optimize(nonsense, _swing_up(), initial=REST, max_iterations=25)
    assert set(result.history.method) <= {"quasi-newton", "steepest"}
    assert 2 <= nonsense.tried <= 0.6 * result.iterations


@pytest.mark.parametrize("method", ["steepest", "quasi-newton", "newton"])
def test_the_direction_minimises_the_model_of_its_method(system, method):
    """Slope and gains at the first trajectory, from the stated model and an LQR for the projection."""
    u = np.sin(0.1 * np.arange(N))[:, None]
    x = simulate(system, np.zeros(4), u)
    cost = _tracking(0.8, R=1.0)
    result = optimize(system, cost, initial=(x, u), method=method, regulator="lqr", max_iterations=0)
    A, B = system.linearize(x, u)
    q, r, q_final = cost.gradient(x, u)
    K = regulate(A, B)
    np.testing.assert_allclose(result.K, K)
    model = {"Q": cost.Q, "R": cost.R, "Q_final": cost.Q_final}
    if method == "steepest":
        model = {"Q": np.ones(4), "R": np.ones(1), "Q_final": np.ones(4)}
    if method == "newton":
        model["H"] = system.curvatures(x, u, adjoint(A, B, K, q, r, q_final))
    solution = solve_linear_quadratic(A, B, **model, q=q, r=r, q_final=q_final)
    assert solution.definite
    assert result.expected_decrease == pytest.approx(-2.0 * solution.constant, rel=1e-12)


@pytest.mark.parametrize("regulator", ["descent", "lqr"])
def test_every_step_lowers_the_cost_as_much_as_asked(system, regulator):
    alpha = 0.4
    result = optimize(system, _swing_up(), initial=REST, alpha=alpha, regulator=regulator, max_iterations=15)
    history = result.history
    wanted = alpha * history.step_length * history.expected_decrease
    assert (-np.diff(history.cost) >= wanted * (1 - 1e-12)).all()
    assert (history.step_length < 1.0).any()


def test_nothing_is_printed(system, capsys):
    optimize(system, _tracking(), initial=REST)
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "magic"}, "method: got 'magic'"),
        ({"regulator": "pid"}, "regulator: got 'pid'"),
        ({"max_iterations": -1}, "max_iterations: got -1"),
        ({"tolerance": -1.0}, "tolerance: got -1.0"),
        ({"alpha": 0.7}, "alpha: got 0.7"),
        ({"beta": 1.0}, "beta: got 1.0"),
        ({"chunk": 0}, "chunk: got 0"),
        ({"max_backtracks": 2.5}, "max_backtracks: got 2.5"),
        ({"initial": None}, "got neither"),
        ({"initial": (np.zeros((N, 4)), np.zeros((N, 1)))}, "initial x: got shape"),
        ({"initial": (np.zeros(4), np.zeros((N + 1, 1)))}, "initial u: got shape"),
        ({"initial": (np.full(4, np.nan), np.zeros((N, 1)))}, "initial x: got nan"),
    ],
)
def test_bad_input(system, arguments, message):
    with pytest.raises(ArgumentError, match=message):
        optimize(system, _tracking(), **{"initial": REST, **arguments})


def test_a_cost_for_another_horizon():
    with pytest.raises(ArgumentError, match=r"cost.x_wanted: got shape \(201, 4\), expected \(101, 4\)"):
        optimize(CartPendulum(100), _tracking(), initial=(np.zeros(4), np.zeros((100, 1))))


def test_an_initial_curve_that_cannot_be_projected():
    walled = _Walled(0.5)
    with pytest.raises(ArgumentError, match="too fast"):
        optimize(walled, _tracking(), initial=(np.zeros(4), 10.0 * np.ones((N, 1))))
