"""Predictive control, held to optimisations to the end and to what it says of itself."""

from __future__ import annotations

import gc
import tracemalloc

import numpy as np
import pytest

from leastaction import Bound, MidpointSystem, MidpointVI, QuadraticCost, optimize
from leastaction.control import MPC, KalmanFilter
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.marionette import marionette, rest_pose
from leastaction.optimal import FunctionSystem, LinearSystem
from leastaction.optimal.limits.limit import FromSecond

N, DT = 40, 0.025


def linear() -> tuple[LinearSystem, QuadraticCost]:
    A, B = np.array([[1.0, 0.1], [0.05, 1.0]]), np.array([[0.0], [0.1]])
    cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[1.0, 0.1], R=[0.01], Q_final=[10.0, 1.0])
    return LinearSystem(A, B, N=20), cost


def balanced() -> tuple[MidpointSystem, QuadraticCost]:
    wanted = np.zeros((N + 1, 4))
    wanted[:, 1] = np.pi
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), DT * np.arange(N + 1))
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[1.0, 10.0, 0.1, 0.1], R=[1e-2], Q_final=[10.0, 100.0, 1.0, 1.0])
    return system, cost


LIMITS = [[], [Bound("u[0]", -1.0, 1.0)], [Bound("u[0]", -1.0, 1.0), Bound("x[1]", -0.3, 0.3)]]


@pytest.mark.parametrize("limits", LIMITS)
def test_of_a_linear_system_one_iteration_is_the_optimum(limits):
    """From a plan that was found elsewhere, one quadratic problem leads to what an optimisation finds."""
    system, cost = linear()
    mpc = MPC(system, cost, limits, tolerance=1e-9)
    mpc([-0.4, 0.0], 0.0)
    u = mpc([0.9, 0.1], 0.0)
    assert mpc.info.planned
    best = optimize(system, cost, initial=(np.array([0.9, 0.1]), np.zeros((20, 1))), limits=limits, tolerance=1e-12)
    assert np.abs(mpc.u - best.u).max() < 1e-5
    assert np.abs(mpc.x - best.x).max() < 1e-5
    assert u == pytest.approx(best.u[0], abs=1e-5)
    if limits:
        assert "u[0] >= -1" in mpc.info.active
        assert mpc.info.violation < 1e-6


def test_iterations_come_to_the_optimum():
    system, cost = balanced()
    limits = [Bound("x-force", -40.0, 40.0), Bound("x", -0.5, 0.5)]
    mpc = MPC(system, cost, limits, iterations=8, tolerance=1e-9)
    mpc([0.0, np.pi - 0.1, 0.0, 0.0], 0.0)
    x = np.array([0.1, np.pi - 0.15, 0.3, 0.1])
    mpc(x, 0.0)
    best = optimize(system, cost, initial=(x, mpc.u), limits=limits, tolerance=1e-11)
    assert np.abs(mpc.u - best.u).max() < 1e-3 * np.abs(best.u).max()


def test_it_balances_under_pushes_within_its_bounds():
    system, cost = balanced()
    mpc = MPC(system, cost, [Bound("x-force", -60.0, 60.0), Bound("x", -0.5, 0.5)])
    x, rng, pushed = np.array([0.0, np.pi - 0.05, 0.0, 0.0]), np.random.default_rng(0), []
    for k in range(200):
        u = mpc(x, DT * k)
        assert mpc.info.planned
        assert abs(u[0]) <= 60.0
        x = system.f(x, u, 0) + np.array([0.0, 0.0, 0.02, 0.005]) * rng.standard_normal(4)
        if k == 60:
            x[3] += 0.15
        pushed.append(x)
    states = np.array(pushed)
    assert np.abs(states[-20:, 1] - np.pi).max() < 0.1
    assert np.abs(states[:, 0]).max() < 0.55


def test_references_move():
    """A plan longer than the horizon is followed by its windows, and its end is held; so is a function of the time."""
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    system = LinearSystem(A, B, N=100)
    wanted = np.zeros((101, 2))
    wanted[:, 0] = np.clip((np.arange(101) - 30) / 20.0, 0.0, 1.0)
    whole = QuadraticCost(wanted, np.zeros((100, 1)), Q=[100.0, 0.1], R=[1e-3])

    def ahead(t: float) -> QuadraticCost:
        rows = np.minimum(round(t) + np.arange(16), 100)
        return QuadraticCost(wanted[rows], np.zeros((15, 1)), Q=[100.0, 0.1], R=[1e-3])

    both = []
    for cost in (whole, ahead):
        mpc, x, states = MPC(system, cost, horizon=15), np.zeros(2), []
        for k in range(130):
            x = A @ x + B @ mpc(x, float(k))
            states.append(x[0])
        both.append(states)
    assert np.abs(both[0][40:50] - wanted[41:51, 0]).max() < 0.02
    assert abs(both[0][-1] - 1.0) < 1e-3
    assert np.allclose(both[0], both[1], atol=1e-9)


def test_what_changes_with_time_changes_with_the_time_of_the_call():
    """A system that is another at each step, and a limit that moves: each call solves the window that it begins."""
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])

    def f(x, u, k):
        return A @ x + B @ u + [0.0, 0.1 * np.sin(0.4 * k)]

    system = FunctionSystem(f, nx=2, nu=1, N=60, derivatives=lambda x, u, k: (A, B))
    cost = QuadraticCost(np.tile([1.0, 0.0], (16, 1)), np.zeros((15, 1)), Q=[20.0, 0.1], R=[0.01])
    limit = Bound("x[0]", max=lambda t: 0.3 + 0.02 * t)
    mpc, x = MPC(system, lambda t: cost, [limit], horizon=15, tolerance=1e-9), np.zeros(2)
    active = []
    for k in range(45):
        u, window = mpc(x, float(k)), system.window(k, k + 15)
        assert mpc.info.planned
        settings = {"limits": [FromSecond(limit)], "initial": (x, np.zeros((15, 1))), "tolerance": 1e-11}
        np.testing.assert_allclose(u, optimize(window, cost, **settings).u[0], atol=5e-4)
        active.append(mpc.info.active != ())
        x = f(x, u, k)
    assert 5 < sum(active) < 40
    mpc(x, 70.0)  # after its end the last window stays
    assert mpc.info.planned


def test_a_plan_that_is_known_is_gone_on_from():
    system, cost = balanced()
    limits, x = [Bound("x-force", -40.0, 40.0)], np.array([0.1, np.pi - 0.1, 0.0, 0.0])
    plan = optimize(system, cost, initial=(x, np.zeros((N, 1))), limits=limits, tolerance=1e-9)
    mpc = MPC(system, cost, limits, tolerance=1e-9)
    mpc.begin(plan.x, plan.u, plan.K)
    np.testing.assert_allclose(mpc(x, 0.0), plan.u[0], atol=1e-5)
    assert mpc.info.planned
    assert mpc.info.iterations == 1
    with pytest.raises(ArgumentError, match=r"x: got shape \(2, 4\), expected"):
        mpc.begin(plan.x[:2], plan.u, plan.K)


def test_where_it_cannot_plan_the_last_plan_is_followed_and_it_says_so():
    system, cost = balanced()
    mpc = MPC(system, cost, [Bound("x-force", -40.0, 40.0)])
    x = np.array([0.0, np.pi - 0.05, 0.0, 0.0])
    mpc(x, 0.0)
    mpc.budget = 1e-12
    plan, gain, state = mpc.u[1].copy(), mpc.K[1].copy(), mpc.x[1].copy()
    u = mpc(x, DT)
    assert not mpc.info.planned
    assert "no time was left" in mpc.info.message
    assert u == pytest.approx(np.clip(plan - gain @ (x - state), -40.0, 40.0))
    mpc.budget = None
    lost = mpc([0.0, 0.0, 0.0, 1e8], 2 * DT)
    assert not mpc.info.planned
    assert "leads nowhere from here" in mpc.info.message
    assert abs(lost[0]) <= 40.0
    mpc(x, 3 * DT)
    assert mpc.info.planned


def test_the_same_calls_give_the_same_inputs():
    runs = []
    for _ in range(2):
        system, cost = balanced()
        mpc, x = MPC(system, cost, [Bound("x-force", -40.0, 40.0)]), np.array([0.0, np.pi - 0.1, 0.0, 0.0])
        inputs = []
        for k in range(30):
            inputs.append(mpc(x, DT * k))
            x = system.f(x, inputs[-1], 0)
        runs.append(np.array(inputs))
    np.testing.assert_array_equal(*runs)


def test_as_a_law_of_a_simulation():
    system, cost = balanced()
    mpc = MPC(system, cost, [Bound("x-force", -40.0, 40.0)])
    vi = system.integrator
    run = vi.simulate(vi.start([0.0, np.pi - 0.1]), DT * np.arange(81), inputs=mpc)
    assert abs(run.q[-1, 1] - np.pi) < 2e-2


def test_what_is_wrong_is_said():
    system, cost = balanced()
    with pytest.raises(ArgumentError, match="horizon: got 60, expected at most the 40 steps"):
        MPC(system, cost, horizon=60)
    with pytest.raises(ArgumentError, match=r"cost\.x_wanted"):
        MPC(system, linear()[1])
    with pytest.raises(ArgumentError, match="unknown name 'force'"):
        MPC(system, cost, [Bound("force", -1.0, 1.0)])
    with pytest.raises(ArgumentError, match="cost: got int"):
        MPC(system, 3)  # type: ignore[arg-type]
    mpc = MPC(system, cost)
    with pytest.raises(ArgumentError, match="x: got shape"):
        mpc(np.zeros(3), 0.0)
    with pytest.raises(ArgumentError, match="x: got nan"):
        mpc([0.0, np.nan, 0.0, 0.0], 0.0)


def test_a_marionette_is_held_by_strings_that_pull():
    """States with multipliers, prescribed strings and limits on tensions; what a call is given may lack multipliers."""
    m = marionette()
    vi = MidpointVI(m, threads=1)
    system = MidpointSystem(vi, 0.01 * np.arange(9), multipliers=True)
    start = vi.start(rest_pose(m))
    x = np.concatenate([start.q, start.p, start.v_rho, np.zeros(m.nc)])
    weights = np.repeat([100.0, 0.01, 0.01, 0.01, 0.0], [m.nd, m.nrho, m.nd, m.nrho, m.nc])
    held = np.concatenate([np.zeros(m.n_inputs), start.q[m.nd :]])
    cost = QuadraticCost(np.tile(x, (9, 1)), np.tile(held, (8, 1)), Q=weights, R=np.full(system.nu, 1.0))
    mpc = MPC(system, cost, [Bound("*", min=0.0, of="tension")])
    rng, begin = np.random.default_rng(0), x
    for k in range(6):
        u = mpc(x[: m.nx], 0.01 * k)
        assert mpc.info.planned, mpc.info.message
        assert mpc.info.violation < 1e-3
        x = system.f(x, u, 0)
        x[m.nq : m.nq + m.nd] += 1e-5 * rng.standard_normal(m.nd)
    assert np.abs(x[: m.nd] - begin[: m.nd]).max() < 0.05


def called(mpc: MPC, x: np.ndarray, first: int, count: int) -> np.ndarray:
    """Call a controller so many times from an instant on, with chance; return where that leads to."""
    rng = np.random.default_rng(first)
    for k in range(first, first + count):
        x = mpc.whole.f(x, mpc(x, k * DT), 0) + 0.01 * rng.standard_normal(4)
    return x


@pytest.mark.parametrize("bounded", [True, False])
def test_nothing_that_a_call_makes_stays(bounded):
    """After the first calls, the memory that Python knows of is the same after hundreds more, whatever the horizon."""
    grown, most = [], []
    system, cost = balanced()
    held = QuadraticCost(cost.x_wanted[-1], cost.u_wanted[-1], Q=cost.Q, R=cost.R)
    limits = [Bound("x-force", -40.0, 40.0), Bound("x", -0.5, 0.5)] if bounded else []
    for horizon in (10, N):
        mpc = MPC(system.window(0, horizon), held, limits)
        x = called(mpc, np.array([0.0, np.pi - 0.1, 0.0, 0.0]), 0, 30)
        gc.collect()
        tracemalloc.start()
        x = called(mpc, x, 30, 10)
        gc.collect()
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        x = called(mpc, x, 40, 200)
        most.append(tracemalloc.get_traced_memory()[1] - before)
        gc.collect()
        grown.append(tracemalloc.get_traced_memory()[0] - before)
        tracemalloc.stop()
    assert max(grown) < 2000  # bytes, of 200 calls: small objects come and go
    # What is on the way grows with the horizon as motions do, of which it is some: there are no matrices in it.
    motion = 8 * (N - 10) * (4 + 1)
    assert most[1] - most[0] < 20 * motion


def test_a_state_is_taken_by_name_and_as_it_is_of_a_mechanism():
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), 0.02 * np.arange(21))
    cost = QuadraticCost([0.0, np.pi, 0.0, 0.0], [0.0], Q=[1.0, 10.0, 0.1, 0.1], R=[1e-2])
    start = system.integrator.start([0.0, np.pi - 0.1])
    wanted = MPC(system, cost)(start.x, 0.0)
    for state in (start, {"theta": np.pi - 0.1}):
        np.testing.assert_array_equal(MPC(system, cost)(state, 0.0), wanted)
        np.testing.assert_array_equal(MPC(system, cost)(0.0, state), wanted)
        np.testing.assert_array_equal(MPC(system, cost).prepare(state).u[0], wanted)
        kalman = KalmanFilter(system, measure=["x"], noise=1.0, process=1.0, x=state)
        np.testing.assert_array_equal(kalman.x, start.x)
    with pytest.raises(ArgumentError, match="'tehta'; did you mean 'theta'"):
        MPC(system, cost)({"tehta": 0.1}, 0.0)
