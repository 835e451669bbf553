"""Estimation over a moving horizon is the Kalman filter's where nothing is limited, and keeps to limits."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Bound,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    free,
    project_configuration,
    rx,
    ty,
    tz,
)
from leastaction.control import KalmanFilter, MovingHorizonEstimator, close_loop
from leastaction.elements import BodyWrench
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import LinearSystem

A, B, C = np.array([[1.0, 0.1], [-0.1, 0.95]]), np.array([[0.0], [0.1]]), np.array([[1.0, 0.0]])
SYSTEM = LinearSystem(A, B, N=10)
GIVEN = {"measure": C, "noise": 0.1, "process": np.diag([1e-4, 4e-4]), "x": [0.0, 0.0], "spread": 0.5}


def record(steps: int = 15):
    rng, x, y, u = np.random.default_rng(0), np.array([0.3, -0.1]), [], []
    for _ in range(steps):
        y.append(C @ x + 0.1 * rng.standard_normal(1))
        u.append(rng.standard_normal(1))
        x = A @ x + B @ u[-1] + [0.01, 0.02] * rng.standard_normal(2)
    return y, u


@pytest.mark.parametrize("horizon", [1, 4, 10])
def test_without_limits_it_is_the_kalman_filter(horizon):
    kalman, moving = KalmanFilter(SYSTEM, **GIVEN), MovingHorizonEstimator(SYSTEM, **GIVEN, horizon=horizon)
    for y, u in zip(*record(), strict=True):
        np.testing.assert_allclose(moving.correct(y), kalman.correct(y), atol=1e-6)
        np.testing.assert_allclose(moving.predict(u), kalman.predict(u), atol=1e-6)


def test_limits_are_kept_and_help():
    """A mass that rests at a wall, seen through noise: never behind the wall."""
    limits = [Bound("x[0]", min=0.0)]
    moving = MovingHorizonEstimator(SYSTEM, **GIVEN, horizon=6, limits=limits)
    free = MovingHorizonEstimator(SYSTEM, **GIVEN, horizon=6)
    rng, off = np.random.default_rng(1), []
    for _ in range(12):
        y = 0.1 * rng.standard_normal(1) - 0.05
        off.append((moving.correct(y)[0], free.correct(y)[0]))
        if moving.result is not None:
            assert moving.result.x[:, 0].min() > -1e-5
        moving.predict([0.0])
        free.predict([0.0])
    assert min(one for _, one in off) < -0.01


def test_it_closes_a_loop_as_a_filter_does():
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), 0.02 * np.arange(21))
    given = {"measure": ["x", "theta"], "noise": 2e-3, "process": {"p_*": 0.02}, "spread": 0.05}
    start = np.array([0.0, 0.1, 0.0, 0.0])
    errors = []
    for make in (KalmanFilter, MovingHorizonEstimator):
        more = {"horizon": 8} if make is MovingHorizonEstimator else {}
        run = close_loop(
            system, lambda t, x: np.array([np.sin(t)]), start, 0.02 * np.arange(31), measure=["x", "theta"],
            noise=2e-3, estimator=make(system, **given, **more, x=np.zeros(4)), disturbance={"p_*": 0.02}, seed=2,
        )  # fmt: skip
        assert run.failure is None
        errors.append(np.abs(run.estimates - run.x[:-1])[10:].mean())
    assert errors[1] < 1.2 * errors[0]


def two_pendulums():
    """Return two pendulums whose ends a rod joins, and where they stand."""
    tree = [rx("a"), [tz(-1.0, name="one", mass=1.0)], ty(1.0), [rx("b"), [tz(-1.2, name="other", mass=1.0)]]]
    acting = [Gravity(), Damping(0.1), Distance("one", "other", 1.0, name="rod"), JointForce("a", input="torque")]
    m = Mechanism(tree, acting)
    system = MidpointSystem(MidpointVI(m, threads=1), 0.02 * np.arange(11))
    x = system.integrator.start(project_configuration(m, [0.2, 0.1]).q).x
    return system, x, {"measure": ["a"], "noise": 1e-3, "process": {"p_*": 1e-2}, "spread": 0.05}


def drone():
    system = MidpointSystem(MidpointVI(Mechanism([free("drone", mass=1.0, inertia=(0.01, 0.02, 0.03))], [
        Gravity(), BodyWrench("drone", force=(0, 0, "thrust"), torque=("roll", "pitch", "yaw")),
    ])), 0.02 * np.arange(11))  # fmt: skip
    x = system.integrator.start(system.mechanism.configuration()).x
    return system, x, {"measure": ["drone.*"], "noise": 1e-2, "process": {"p_*": 1e-3}, "spread": 0.1}


@pytest.mark.parametrize("made", [two_pendulums, drone])
def test_constraints_and_rotations_are_kept_as_a_filter_keeps_them(made):
    system, start, given = made()
    found = []
    for make, more in ((KalmanFilter, {}), (MovingHorizonEstimator, {"horizon": 8})):
        run = close_loop(
            system, lambda t, x: np.full(system.nu, 0.1 * np.sin(3.0 * t)), start, 0.02 * np.arange(41),
            measure=given["measure"], noise=given["noise"], disturbance=given["process"], seed=1,
            estimator=make(system, **given, **more, x=start),
        )  # fmt: skip
        assert run.failure is None
        found.append(np.array([system.difference(a, b) for a, b in zip(run.estimates, run.x, strict=False)]))
        nq = system.mechanism.nq
        if system.mechanism.nc:
            assert np.abs(system.mechanism.constraint_values(np.ascontiguousarray(run.estimates[:, :nq]))).max() < 1e-9
    # As good as a filter that sees nothing of curvature, and all but the same.
    spread = np.sqrt(np.mean(found[0] ** 2, axis=0))
    assert (np.sqrt(np.mean(found[1] ** 2, axis=0)) < 1.2 * spread + 1e-9).all()
    assert (np.abs(found[1] - found[0]).max(axis=0) < 1.0 * spread.max()).all()


def test_what_is_wrong_is_said():
    with pytest.raises(ArgumentError, match="horizon: got 11, expected at most the 10 steps"):
        MovingHorizonEstimator(SYSTEM, **GIVEN, horizon=11)
    with pytest.raises(ArgumentError, match="process: got no disturbance at all"):
        MovingHorizonEstimator(SYSTEM, **{**GIVEN, "process": 0.0}, horizon=5)
    system, start, given = drone()
    with pytest.raises(ArgumentError, match="process: got a disturbance of rotations, expected one of plain entries"):
        MovingHorizonEstimator(system, **{**given, "process": 1e-3}, x=start, horizon=5)
    with pytest.raises(ArgumentError, match="y: got shape"):
        MovingHorizonEstimator(SYSTEM, **GIVEN, horizon=5).correct([0.0, 1.0])
