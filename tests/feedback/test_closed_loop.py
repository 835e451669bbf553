"""Closed loops in both kinds of time, with readings that are noisy and late, and many of them."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Bound, ContinuousDynamics, MechanismSystem, MidpointSystem, MidpointVI, QuadraticCost
from leastaction.control import MPC, KalmanFilter, close_loop, lqr, monte_carlo
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import LinearSystem

N, DT = 40, 0.025
T = DT * np.arange(121)
UP = np.array([0.0, np.pi, 0.0, 0.0])


def model(mass: float = 1.0) -> MidpointSystem:
    return MidpointSystem(MidpointVI(cart_pendulum(bob_mass=mass), threads=1), DT * np.arange(N + 1))


def controller(system: MidpointSystem) -> MPC:
    wanted = np.tile(UP, (N + 1, 1))
    weights = {"Q": [1.0, 10.0, 0.1, 0.1], "R": [1e-2], "Q_final": [10.0, 100.0, 1.0, 1.0]}
    return MPC(system, QuadraticCost(wanted, np.zeros((N, 1)), **weights), [Bound("x-force", -60.0, 60.0)])


def kalman(system: MidpointSystem, start: np.ndarray) -> KalmanFilter:
    return KalmanFilter(
        system, measure=["x", "theta"], noise=2e-3, process={"p_*": 0.02}, x=start, spread={"x": 0.01, "*": 0.05}
    )


def test_a_law_is_what_simulate_does_with_it():
    system = model()
    vi = system.integrator

    def law(t: float, x: np.ndarray) -> np.ndarray:
        return np.array([np.sin(t) - 2.0 * x[0] - 3.0 * x[2]])

    run = close_loop(vi, law, [0.1, 0.2, 0.0, 0.0], T)
    simulated = vi.simulate(vi.start([0.1, 0.2]), T, inputs=law)
    np.testing.assert_allclose(run.x[:, :2], simulated.q, atol=1e-12)
    np.testing.assert_array_equal(run["theta"], run.x[:, 1])


def test_predictive_control_on_estimates_of_late_readings_of_another_plant():
    """The plant's bob is a fifth heavier than the model's, readings are noisy and two steps late, chance pushes."""
    system = model()
    start = UP - np.array([0.0, 0.05, 0.0, 0.0])
    run = close_loop(
        MidpointVI(cart_pendulum(bob_mass=1.2)), controller(system), start, T, measure=["x", "theta"], noise=2e-3,
        delay=2 * DT, estimator=kalman(system, UP), disturbance={"p_*": 0.02}, substeps=5, seed=3,
    )  # fmt: skip
    assert run.failure is None
    assert np.abs(run["theta"][60:] - np.pi).max() < 0.15
    assert len(run.infos) == len(run.u) == 120
    assert all(info.planned for info in run.infos)
    assert run.y.shape == (121, 2)
    assert np.abs(run.estimates[40:, :2] - run.x[40:-1, :2]).max() < 0.03
    again = close_loop(
        MidpointVI(cart_pendulum(bob_mass=1.2)), controller(model()), start, T, measure=["x", "theta"], noise=2e-3,
        delay=2 * DT, estimator=kalman(model(), UP), disturbance={"p_*": 0.02}, substeps=5, seed=3,
    )  # fmt: skip
    np.testing.assert_array_equal(run.x, again.x)


def test_in_continuous_time_the_model_is_given_momenta():
    system = model()
    start = UP - np.array([0.0, 0.05, 0.0, 0.0])
    short = T[:61]
    run = close_loop(MechanismSystem(ContinuousDynamics(cart_pendulum())), controller(system), start, short)
    discrete = close_loop(system, controller(model()), start, short)
    assert np.abs(run["theta"] - discrete["theta"]).max() < 5e-3
    assert abs(run["theta"][-1] - np.pi) < 0.03


def test_an_observed_linear_loop_is_the_one_of_its_matrices():
    A, B = np.array([[1.0, 0.1], [0.1, 1.0]]), np.array([[0.0], [0.1]])
    plant = LinearSystem(A, B, N=5)
    K = lqr(A, B, np.eye(2), [1.0], dt=0.1).gain
    run = close_loop(plant, lambda t, x: -K @ x, [1.0, 0.0], 0.1 * np.arange(31))
    expected = [np.array([1.0, 0.0])]
    for _ in range(30):
        expected.append((A - B @ K) @ expected[-1])
    np.testing.assert_allclose(run.x, expected, atol=1e-12)
    late = close_loop(plant, lambda t, x: -K @ x, [1.0, 0.0], 0.1 * np.arange(31), delay=0.1)
    x = [np.array([1.0, 0.0])]
    for k in range(30):
        x.append(A @ x[-1] - B @ K @ x[max(0, k - 1)])
    np.testing.assert_allclose(late.x, x, atol=1e-12)


def test_a_plant_that_leaves_the_model_ends_the_loop_and_what_is_done_is_kept():
    run = close_loop(model(), controller(model()), UP, T, disturbance=lambda t, x: [0, 0, 0, 1e9 if t > 0.5 else 0.0])
    assert run.failure is not None
    assert "the loop ended at t = " in run.failure
    assert 20 <= len(run.u) < 120
    assert np.isfinite(run.x).all()


def test_many_runs_and_their_bands():
    system = model()

    def run(rng: np.random.Generator):
        plant = MidpointVI(cart_pendulum(bob_mass=rng.uniform(0.8, 1.2)), threads=1)
        start = UP + np.array([0.0, 0.05 * rng.normal(), 0.0, 0.0])
        return close_loop(plant, controller(system), start, T[:61], disturbance={"p_*": 0.02}, seed=rng.integers(1000))

    bands, fewer = monte_carlo(run, 8, seed=1), monte_carlo(run, 3, seed=1)
    assert bands["theta"].shape == (8, 61)
    assert not bands.failures
    np.testing.assert_array_equal(bands.x[:3], fewer.x)
    low, middle, high = bands.quantiles("theta")
    assert (low <= middle).all()
    assert (middle <= high).all()
    assert np.abs(bands["theta"][:, -10:] - np.pi).max() < 0.1
    pytest.importorskip("matplotlib").use("Agg")
    figure = bands.plot(["theta", "x-force"])
    assert [axis.get_ylabel() for axis in figure.axes] == ["theta (°)", "x-force (N)"]


def test_noise_of_the_whole_state_goes_by_its_names():
    run = close_loop(
        MidpointVI(cart_pendulum(), threads=1),
        lambda t, x: [0.0],
        np.zeros(4),
        0.02 * np.arange(51),
        noise={"theta": 0.1},
    )
    off = run.y - run.x
    assert off[:, 1].std() == pytest.approx(0.1, rel=0.3)
    assert not off[:, [0, 2, 3]].any()


def test_what_is_wrong_is_said():
    system = model()
    law = lambda t, x: np.zeros(1)  # noqa: E731
    with pytest.raises(ArgumentError, match=r"delay: got 0.03 s, which is no multiple of the step of 0.025 s"):
        close_loop(system, law, UP, T, delay=0.03)
    with pytest.raises(ArgumentError, match="controller: got ndarray"):
        close_loop(system, np.zeros(3), UP, T)
    with pytest.raises(ArgumentError, match="plant: got int"):
        close_loop(3, law, UP, T)
    with pytest.raises(ArgumentError, match="unknown name 'tehta'"):
        close_loop(system, law, UP, T, measure=["tehta"])
    with pytest.raises(ArgumentError, match="estimator: got int"):
        close_loop(system, law, UP, T, estimator=3)
    with pytest.raises(ArgumentError, match="disturbance: unknown name 'q_"):
        close_loop(system, law, UP, T, disturbance={"q_*": 1.0})
    with pytest.raises(ArgumentError, match=r"inputs\(0, x\): got shape \(2,\), expected \(1,\); .* x-force"):
        close_loop(system, lambda t, x: np.zeros(2), UP, T)
    late = close_loop(system, lambda t, x: np.zeros(1 if t < 0.05 else 2), UP, T)
    assert "the loop ended at t = 0.05 s: inputs(0.05, x): got shape (2,)" in late.failure
    assert len(late.u) == 2
    with pytest.raises(ArgumentError, match=r"delay: got 0.04 s, .*; expected 0.025 s or 0.05 s"):
        close_loop(system, law, UP, T, delay=0.04)
    with pytest.raises(ArgumentError, match="measure: got none, and the estimator reads states of 4 numbers"):
        close_loop(LinearSystem(np.eye(2), np.ones((2, 1)), N=5), law, np.zeros(2), T, estimator=kalman(system, UP))


def test_print_says_what_became_of_a_loop():
    system = model()
    run = close_loop(system, controller(system), [0.1, np.pi, 0.0, 0.0], T[:5])
    said = str(run)
    assert "4 steps, t = 0 to 0.1 s" in said
    assert f"ends at x {run['x'][-1]:.4g}, theta {run['theta'][-1]:.4g}, " in said
    assert f"largest inputs x-force {np.abs(run['x-force']).max():.4g}" in said
    assert "4 plans, 0 of them not found" in said

    def once(rng: np.random.Generator):
        return close_loop(
            system, lambda t, x: [np.nan] if x[0] > 0.0 else [0.0], [rng.uniform(-1.0, 1.0), 0, 0, 0], T[:3]
        )

    bands = monte_carlo(once, 8)
    assert f"8 runs to t = 0.05 s, {len(bands.failures)} of them ended early" in str(bands)
    assert str(bands).count("\nrun ") == len(bands.failures) > 0
    with pytest.raises(ArgumentError, match="unknown name 'tehta'; did you mean 'theta'"):
        run["tehta"]
    with pytest.raises(ArgumentError, match="unknown name 'tehta'; did you mean 'theta'"):
        bands["tehta"]
