"""Estimators and predictive control where states are no plain vectors: on a circle, and among rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from leastaction import (
    Bound,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    ball,
    optimize,
    simulate,
)
from leastaction.control import MPC, KalmanFilter, MovingHorizonEstimator, close_loop
from leastaction.costs import tracking
from leastaction.errors import ArgumentError
from optimal.spaces import Body, Circle, Pendulum


@pytest.mark.parametrize("kind", ["extended", "unscented"])
def test_an_attitude_seen_by_a_star_tracker_is_consistent(kind):
    """Readings are the four numbers of a quaternion, directions are three: the filter counts these."""
    system, rng = Body(np.full(40, 0.05)), np.random.default_rng(1)
    x = [np.array([1.0, 0, 0, 0, 0.6, -0.5, 0.8])]
    inputs = 0.5 * rng.standard_normal((40, 3))
    noise, chance = 2e-3, np.repeat([1e-9, 5e-3], 3)
    for u in inputs:
        x.append(system.plus(system.f(x[-1], u, 0), chance * rng.standard_normal(6)))
    y = np.array([state[:4] + noise * rng.standard_normal(4) for state in x])
    start = system.plus(x[0], 0.02 * rng.standard_normal(6))
    kalman = KalmanFilter(
        system, measure=["x[0]", "x[1]", "x[2]", "x[3]"], noise=noise, process=chance, x=start, spread=0.02, kind=kind
    )
    estimate = kalman.run(y, inputs)
    assert estimate.P.shape == (41, 6, 6)
    assert np.abs(np.linalg.norm(estimate.x[:, :4], axis=1) - 1.0).max() < 1e-12
    low, high = chi2.ppf([1e-3, 1.0 - 1e-3], 4 * 41) / 41
    assert low < estimate.surprise.mean() < high
    off = system.difference(estimate.x, np.array(x))
    nees = np.einsum("ki,kij,kj->k", off, np.linalg.inv(estimate.P), off)
    assert 3.0 < nees.mean() < 10.0  # 6 in the mean


def test_a_controller_that_is_given_noisy_readings_is_given_rotations():
    """Noise on the numbers of a quaternion takes their length from one, which no controller can begin from."""
    m = Mechanism([ball("hull", mass=1.0, inertia=(0.2, 0.3, 0.4))], [JointForce(f"hull.w{a}", a) for a in "xyz"])
    vi, t = MidpointVI(m, threads=1), 0.1 * np.arange(21)
    system = MidpointSystem(vi, t[:11])
    mpc = MPC(system, tracking(system, {"hull": 10.0, "hull.v": 1.0}, {"hull": [0.8, 0.6, 0.0, 0.0]}, effort=0.1))
    loop = simulate(vi, vi.start(m.configuration()), t, inputs=mpc, noise=1e-3, seed=4)
    assert loop.failure is None
    np.testing.assert_allclose(np.linalg.norm(loop.y[:, :4], axis=1), 1.0, atol=1e-15)
    assert np.abs(loop.y - loop.x).max() > 1e-3
    assert abs(loop["hull.qx"][-1] - 0.6) < 0.1
    # What sensors read is left as it is.
    read = simulate(vi, vi.start(m.configuration()), t, measure="hull.q*", noise=1e-2, seed=4).y
    assert np.abs(np.linalg.norm(read, axis=1) - 1.0).max() > 1e-3


def test_what_is_measured_is_a_word_or_a_list_of_words():
    m = Mechanism([ball("hull", mass=1.0, inertia=(0.2, 0.3, 0.4))], [JointForce("hull.wx", "a")])
    system = MidpointSystem(MidpointVI(m, threads=1), 0.1 * np.arange(3))
    x = system.integrator.start(m.configuration()).x
    kalman = [KalmanFilter(system, measure=each, noise=0.1, process=0.1, x=x) for each in ("hull.q*", ["hull.q*"])]
    assert kalman[0].readings.names == kalman[1].readings.names == m.coordinates


def test_predictive_control_on_a_circle_is_the_optimum():
    system = Pendulum(25)
    wanted = np.tile([-1.0, 0.0, 0.0], (26, 1))
    weights = {"Q": [1.0, 0.1], "R": [0.02], "Q_final": [50.0, 5.0]}
    cost = QuadraticCost(wanted, np.zeros((25, 1)), **weights, space=system)
    limits = [Bound("u[0]", -6.0, 6.0)]
    mpc = MPC(system, cost, limits, iterations=8, tolerance=1e-9)
    start = np.array([*Circle().plus(np.array([-1.0, 0.0]), np.array([0.35])), 0.0])
    mpc(start, 0.0)
    other = np.array([*Circle().plus(np.array([-1.0, 0.0]), np.array([-0.3])), 0.2])
    u = mpc(other, 0.0)
    best = optimize(system, cost, initial=(other, mpc.u), limits=limits, tolerance=1e-11)
    np.testing.assert_allclose(mpc.u, best.u, atol=1e-4)
    assert abs(u[0]) <= 6.0
    run = close_loop(system, MPC(system, cost, limits), start, np.arange(81.0), disturbance=[0.0, 0.02], seed=1)
    assert run.failure is None
    assert run.x[-1, 0] < -0.99


def test_a_moving_horizon_has_no_disturbance_of_rotations():
    with pytest.raises(ArgumentError, match="process: got a disturbance of rotations"):
        MovingHorizonEstimator(Pendulum(5), measure=np.eye(3), noise=1.0, process=1.0, x=[1.0, 0.0, 0.0], horizon=5)
