"""Estimates of rotations that are quaternions: readings of either sign, names of joints, attitudes far from none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from leastaction import JointForce, KalmanFilter, Mechanism, MidpointSystem, MidpointVI, ball
from leastaction.control import MovingHorizonEstimator
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array

HULL = Mechanism(
    [ball("hull", mass=1.0, inertia=(0.1, 0.2, 0.3))], [JointForce(f"hull.w{x}", f"torque {x}") for x in "xyz"]
)
STEPS = 30


def extended(system: MidpointSystem, **options: Any) -> KalmanFilter:
    return KalmanFilter(system, **options)


def unscented(system: MidpointSystem, **options: Any) -> KalmanFilter:
    return KalmanFilter(system, kind="unscented", **options)


def turning() -> tuple[MidpointSystem, Array]:
    """A body that turns over about once, and its states."""
    system = MidpointSystem(MidpointVI(HULL), np.linspace(0.0, 1.5, STEPS + 1))
    start = system.integrator.start({"hull": [0.6, 0.0, 0.8, 0.0]}, {"hull": [3.0, 2.0, -1.0]})
    return system, system.rollout(
        start.x, np.tile(start.x, (STEPS + 1, 1)), np.zeros((STEPS, 3)), np.zeros((STEPS, 3, 6)), 0, STEPS
    ).x


@pytest.mark.parametrize("kind", [extended, unscented, MovingHorizonEstimator])
def test_a_quaternion_is_read_with_either_sign(kind: Any) -> None:
    system, x = turning()
    assert np.ptp(np.sign(x[:, 0])) == 2.0  # so that one of both signs is left
    guess = system.plus(x[0], np.r_[0.2, -0.1, 0.1, np.zeros(3)])
    known = {"measure": ["hull"], "noise": 1e-3, "process": {"p_hull": 1e-3}, "x": guess}
    found = []
    for sign in (1.0, np.sign(x[:, :1])):  # as it goes on; as a sensor tells it, whose first number is not negative
        estimator = kind(system, spread={"hull": 0.3, "p_hull": 0.6}, **known)
        for k, y in enumerate(sign * x[:, :4]):
            if k > 0:
                estimator.predict(np.zeros(3))
            estimator.correct(y)
        found.append(estimator.x)
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)
    assert np.abs(system.difference(found[0], x[-1])).max() < 5e-3


def test_names_of_joints_are_those_of_their_turns() -> None:
    system, x = turning()
    by_joint, spelt = (
        KalmanFilter(system, measure=measure, noise=0.1, process=0.0, x=x[0], spread=spread)
        for measure, spread in (
            (["hull"], {"hull": 0.3, "p_hull": 0.2}),
            ([f"hull.q{letter}" for letter in "wxyz"], {"hull.q?": 0.3, "p_hull.w?": 0.2}),
        )
    )
    np.testing.assert_array_equal(by_joint.P, spelt.P)
    assert by_joint.readings.names == spelt.readings.names
    np.testing.assert_array_equal(np.diag(by_joint.P), np.square([0.3] * 3 + [0.2] * 3))


def test_an_estimate_is_the_same_in_a_world_that_is_turned() -> None:
    system, x = turning()
    noise = 0.01 * np.random.default_rng(3).standard_normal((STEPS + 1, 4))
    found = []
    for turn in ([1.0, 0.0, 0.0, 0.0], [0.0, 0.6, 0.0, 0.8], [0.5, 0.5, -0.5, 0.5]):
        y, guess = rotations.product(np.array(turn), x[:, :4] + noise), x[0].copy()
        guess[:4] = rotations.product(np.array(turn), guess[:4])
        kalman = KalmanFilter(system, measure="hull", noise=0.01, process=1e-4, x=guess, spread=0.1)
        run = kalman.run(y, np.zeros((STEPS, 3)))
        back = run.x.copy()
        back[:, :4] = rotations.product(rotations.inverse(np.array(turn)), run.x[:, :4])
        found.append(np.hstack([back, run.P.reshape(len(run.P), -1)]))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-12)
