"""One `optimize` and one `check_derivatives` for systems in either kind of time, and what they are given."""

from __future__ import annotations

import numpy as np
import pytest

import leastaction
from leastaction import Gravity, JointForce, Mechanism, MidpointVI, rz, tx
from leastaction.errors import ArgumentError
from leastaction.models.chain import pendulum_chain
from leastaction.optimal import (
    Accuracy,
    ContinuousOptimizationResult,
    ContinuousQuadraticCost,
    DenseTrajectory,
    DiscreteSystem,
    FunctionContinuousSystem,
    FunctionSystem,
    LinearContinuousSystem,
    LinearSystem,
    OptimizationResult,
    ProjectionOperator,
    QuadraticCost,
    check_derivatives,
    optimize,
    optimize_continuous,
)
from leastaction.systems import MidpointSystem

A, B = np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[0.0], [1.0]])
N, H = 20, 0.1
DISCRETE = LinearSystem(np.eye(2) + H * A, H * B, N=N)
CONTINUOUS = LinearContinuousSystem(A, B)
SUM = QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 1)), Q=np.ones(2), R=np.ones(1))
INTEGRAL = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 1.0], R=[1.0])
START = {"initial": ([1.0, 0.0], [0.0]), "horizon": (0.0, 2.0)}


def test_optimize_takes_systems_in_either_kind_of_time():
    discrete = optimize(DISCRETE, SUM, initial=([1.0, 0.0], np.zeros((N, 1))))
    assert type(discrete) is OptimizationResult
    assert discrete.success
    continuous = optimize(CONTINUOUS, INTEGRAL, **START, accuracy=Accuracy(rtol=1e-8))
    assert type(continuous) is ContinuousOptimizationResult
    assert continuous.success
    older = optimize_continuous(CONTINUOUS, INTEGRAL, **START, accuracy=Accuracy(rtol=1e-8))
    assert older.cost == continuous.cost


class Unfinished(DiscreteSystem):
    """Sets no sizes."""

    def f(self, x, u, k):
        return x

    def derivatives(self, x, u, k):
        return np.eye(2), np.zeros((2, 1))


class NoInputs(Unfinished):
    nx, N = 2, 3


class NoHorizon(Unfinished):
    nx, nu = 2, 1


@pytest.mark.parametrize(
    ("system", "cost", "options", "message"),
    [
        (MidpointVI(pendulum_chain(1)), SUM, {}, r"got MidpointVI, expected a DiscreteSystem or.*MidpointSystem\("),
        (Unfinished(), SUM, {}, r"system: Unfinished.nx is not set.*self.nx"),
        (NoInputs(), SUM, {}, r"system: NoInputs.nu is not set"),
        (NoHorizon(), SUM, {}, r"system: NoHorizon.N is not set"),
        (DISCRETE, INTEGRAL, {}, "cost: got ContinuousQuadraticCost, expected a Cost to go with LinearSystem"),
        (CONTINUOUS, SUM, START, "cost: got QuadraticCost, expected a ContinuousCost"),
        (DISCRETE, SUM, {"horizon": (0.0, 1.0)}, "horizon: .*expected None: LinearSystem is a discrete"),
        (DISCRETE, SUM, {"accuracy": Accuracy()}, "accuracy: .*expected None"),
        (DISCRETE, SUM, {"initial": np.zeros(3)}, r"initial: got ndarray, expected a pair \(x, u\)"),
        (CONTINUOUS, INTEGRAL, {"resume": 3.0}, "resume: got float, expected a ContinuousOptimizationResult"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_told_by_name(system, cost, options, message):
    given = {"initial": (np.zeros(2), np.zeros((N, 1))), **options}
    if "resume" in given:
        del given["initial"]
    with pytest.raises(ArgumentError, match=message):
        optimize(system, cost, **given)


def test_one_name_checks_functions_and_systems():
    rng = np.random.default_rng(0)
    x, u = rng.standard_normal((N + 1, 2)), rng.standard_normal((N, 1))
    assert (
        leastaction.check_derivatives(DISCRETE, x, u, cost=SUM).errors
        == check_derivatives(DISCRETE, x, u, cost=SUM).errors
    )
    curve = DenseTrajectory.from_functions([0.0, 0.0], [0.0], horizon=(0.0, 1.0), nx=2, nu=1)
    assert leastaction.check_derivatives(CONTINUOUS, curve, cost=INTEGRAL).ok
    assert leastaction.check_derivatives(SUM, x, u).ok
    with pytest.raises(ArgumentError, match=r"got ndarray, expected a PythonFunction"):
        leastaction.check_derivatives(x, x, u)  # type: ignore[call-overload]


def test_checks_say_what_does_not_fit():
    with pytest.raises(ArgumentError, match=r"Unfinished\.nx is not set"):
        check_derivatives(Unfinished(), np.zeros((2, 2)), np.zeros((1, 1)))
    with pytest.raises(ArgumentError, match="curve: got list, expected a DenseTrajectory"):
        check_derivatives(CONTINUOUS, [0.0])
    curve = DenseTrajectory.from_functions([0.0, 0.0], [0.0], horizon=(0.0, 1.0), nx=2, nu=1)
    with pytest.raises(ArgumentError, match=r"u: .*expected None"):
        check_derivatives(CONTINUOUS, curve, [0.0])
    assert check_derivatives(CONTINUOUS, curve, cost=INTEGRAL).ok


def _meddling(x, u, when):
    x[0] = 0.0
    return x


def test_users_functions_are_given_arrays_to_read():
    discrete = FunctionSystem(_meddling, nx=2, nu=1, N=3, derivatives="finite-differences")
    cost = QuadraticCost(np.zeros((4, 2)), np.zeros((3, 1)), Q=np.ones(2), R=np.ones(1))
    with pytest.raises(ValueError, match="read-only"):
        optimize(discrete, cost, initial=(np.ones(2), np.zeros((3, 1))))
    continuous = FunctionContinuousSystem(_meddling, nx=2, nu=1, derivatives="finite-differences")
    with pytest.raises(ValueError, match="read-only"):
        optimize(continuous, INTEGRAL, **START)


class OnACircle(LinearSystem):
    """A system whose first state is an angle: it compares states the short way around."""

    def difference(self, x, xbar):
        d = x - xbar
        turned = np.array(d)
        turned[..., 0] = np.remainder(d[..., 0] + np.pi, 2.0 * np.pi) - np.pi
        return turned


def test_feedback_goes_through_the_systems_own_difference():
    plain, circle = (kind(np.eye(2), np.eye(2), N=4) for kind in (LinearSystem, OnACircle))
    K = np.tile(0.5 * np.eye(2), (4, 1, 1))
    xbar, ubar = np.zeros((5, 2)), np.zeros((4, 2))
    x0 = np.array([2.0 * np.pi + 0.1, 1.0])
    around = circle.rollout(x0, xbar, ubar, K, 0, 4)
    near = plain.rollout(np.array([0.1, 1.0]), xbar, ubar, K, 0, 4)
    np.testing.assert_allclose(around.u, near.u, atol=1e-14)
    assert np.abs(plain.rollout(x0, xbar, ubar, K, 0, 4).u - near.u).max() > 1.0
    projected = ProjectionOperator(circle, K)(np.vstack([x0, xbar[1:]]), ubar)
    assert np.isfinite(projected.x).all()
    assert check_derivatives(circle, xbar, ubar).ok


@pytest.mark.parametrize("size", [0.1, 1.0])
def test_a_right_system_is_right_along_a_curve_that_is_no_trajectory(size):
    m = Mechanism(
        [rz("a"), [tx(1.0, mass=1.0), [rz("b"), [tx(1.0, mass=1.0)]]]],
        [Gravity((0.0, -9.81, 0.0)), JointForce("a", input="ta"), JointForce("b", input="tb")],
    )
    system = MidpointSystem(MidpointVI(m), 0.02 * np.arange(21))
    rng = np.random.default_rng(1)
    for scale in dict.fromkeys((0.1, size)):
        x = scale * rng.standard_normal((21, 4))
        report = check_derivatives(system, x, rng.standard_normal((20, 2)))
        assert report.ok, str(report)
