"""Limits on weighted sums: the same as functions that say so, of any quantity, in either kind of time."""

from __future__ import annotations

import numpy as np
import pytest

import leastaction as la
from leastaction.optimal import (
    Bound,
    ContinuousQuadraticCost,
    Equal,
    FunctionQuantity,
    LinearContinuousSystem,
    QuadraticCost,
    Within,
    optimize,
)
from leastaction.systems import MidpointSystem

N = 80


@pytest.fixture(scope="module")
def arm() -> MidpointSystem:
    """Three links, of which the last two are driven."""
    tree = la.world()
    frame = tree
    for k in range(3):
        frame = frame.rx(f"joint{k}").tz(-0.35, mass=0.5)
    driven = [la.JointForce(f"joint{k}", f"motor{k}") for k in (1, 2)]
    m = la.Mechanism(tree, [la.Gravity(), la.Damping(0.05), *driven])
    return MidpointSystem(la.MidpointVI(m, threads=1), np.linspace(0.0, 1.6, N + 1))


def test_a_limit_on_a_sum_is_that_of_its_function(arm: MidpointSystem) -> None:
    wanted = np.zeros((N + 1, arm.nx))
    for k in range(3):
        wanted[:, k] = 0.8 * np.sin(4.0 * arm.t - 0.6 * k)
    cost = QuadraticCost(wanted, np.zeros((N, 2)), Q=[5.0] * 3 + [1e-3] * 3, R=[1e-3] * 2)
    start = np.zeros(arm.nx), np.zeros((N, 2))
    tilt = FunctionQuantity("tilt", lambda x: x[:, 0] + x[:, 1] - 2.0 * x[:, 2])
    effort = FunctionQuantity("effort", lambda x, u: u[:, 0] - 0.5 * u[:, 1], of_state=False)
    own = optimize(arm, cost, initial=start, limits=[Within(tilt, -0.3, 0.4), Within(effort, -0.4, 0.4)])
    sums = [
        Bound({"joint0": 1.0, "joint1": 1.0, "joint2": -2.0}, -0.3, 0.4),
        Bound({"motor1": 1.0, "motor2": -0.5}, -0.4, 0.4),
    ]
    result = optimize(arm, cost, initial=start, limits=sums)
    assert result.success, result.message
    assert result.cost == pytest.approx(own.cost, rel=1e-8)
    np.testing.assert_allclose(result.x, own.x, atol=1e-5)
    labels = "joint0 + joint1 - 2 joint2 >= -0.3", "motor1 - 0.5 motor2 <= 0.4"
    for label in labels:
        assert result.limits.active(label).size > 3
    resumed = optimize(arm, cost, resume=result, limits=sums)
    assert resumed.iterations == result.iterations


def test_a_sum_of_all_that_match(arm: MidpointSystem) -> None:
    rows = Bound({"joint*": 1.0, "joint1": 0.5}, max=1.0).rows(arm, 1)
    assert rows[0].labels == ("joint0 + 1.5 joint1 + joint2 <= 1",)
    rates = Bound({"joint*": -1.0}, max=1.0, of="rate").rows(arm, 1)
    assert rates[0].labels == ("rate of -joint0 - joint1 - joint2 <= 1",)


def test_sums_in_continuous_time() -> None:
    """Of states, with a condition at the end, and of inputs: as those of a system that has them for states."""
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 1.0]])
    mass = LinearContinuousSystem(A, B)
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0, 0.0], Q=[1.0, 0.1], R=[0.1, 0.4])
    start = {"initial": ([1.0, 0.0], [0.0, 0.0]), "horizon": (0.0, 2.0)}
    sums = [Bound({"u[0]": 1.0, "u[1]": 2.0}, -0.9, 0.9), Equal({"x[0]": 2.0, "x[1]": 1.0}, 0.1)]
    own = [
        Within(FunctionQuantity("effort", lambda x, u: u[:, 0] + 2.0 * u[:, 1], of_state=False), -0.9, 0.9),
        Equal(FunctionQuantity("end", lambda x: 2.0 * x[:, 0] + x[:, 1]), 0.1),
    ]
    found, other = (optimize(mass, cost, **start, limits=limits) for limits in (sums, own))
    assert found.success, found.message
    assert found.cost == pytest.approx(other.cost, rel=1e-8)
    assert found.x[-1] @ [2.0, 1.0] == pytest.approx(0.1, abs=1e-8)
    assert found.limits.active("u[0] + 2 u[1] >= -0.9").size > 3
