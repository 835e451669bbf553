"""The projection operator in continuous time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from leastaction.errors import ArgumentError, StepError
from leastaction.optimal.continuous import (
    Accuracy,
    ContinuousProjection,
    ContinuousQuadraticCost,
    DenseTrajectory,
    PiecewisePolynomial,
    regulate_continuous,
)
from optimal.continuous.systems import CartPendulum

SYSTEM = CartPendulum()
TIGHT = Accuracy(rtol=1e-11, atol=1e-13)


def _curve(size=0.3):
    return DenseTrajectory.from_functions(
        lambda t: [size * np.sin(t), size * np.sin(2 * t), size * np.cos(t), 2 * size * np.cos(t)],
        lambda t: [np.sin(3 * t)],
        horizon=(0, 3),
        nx=4,
        nu=1,
    )


def _projection(accuracy=TIGHT):
    rest = np.zeros(4), np.zeros(1)
    A, B = SYSTEM.derivatives(*rest, 0.0)
    K = regulate_continuous(A, B, horizon=(0, 3), accuracy=accuracy)
    return ContinuousProjection(SYSTEM, K, accuracy=accuracy)


def test_a_projection_is_a_trajectory_under_feedback():
    curve, projection = _curve(), _projection()
    rollout = projection(curve)
    assert rollout.failure is None
    x, u = rollout.trajectory.x, rollout.trajectory.u
    t = np.linspace(0, 3, 201)
    rates = np.stack([SYSTEM.f(x(s), u(s), s) for s in t])
    np.testing.assert_allclose(x.derivative()(t), rates, atol=1e-6)
    np.testing.assert_allclose(x(0.0), curve.x(0.0), atol=1e-15)
    xbar, ubar = curve.sample(t)
    wanted = ubar - np.einsum("nij,nj->ni", projection.K(t), x(t) - xbar)
    np.testing.assert_allclose(u(t), wanted, atol=1e-8)

    def loop(s, y):
        return SYSTEM.f(y, curve.u(s) - projection.K(s) @ (y - curve.x(s)), s)

    run = solve_ivp(loop, (0, 3), curve.x(0.0), method="DOP853", rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(x(3.0), run.y[:, -1], atol=1e-8)


def test_a_trajectory_is_its_own_projection():
    projection = _projection()
    once = projection(_curve())
    twice = projection(once.trajectory)
    t = np.linspace(0, 3, 101)
    np.testing.assert_allclose(twice.trajectory.xu(t), once.trajectory.xu(t), atol=1e-8)
    elsewhere = projection(once.trajectory, x0=np.array([0.1, 0.0, 0.0, 0.0]))
    assert abs(elsewhere.trajectory.x(0.0)[0] - 0.1) < 1e-12


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_the_cost_is_as_accurate_as_the_trajectory(rtol):
    wanted = PiecewisePolynomial.through([0.0, 1.0, 3.0], [[0.0, 0, 0, 0], [0.0, 1, 0, 0]], kind="hold")
    cost = ContinuousQuadraticCost(
        wanted,
        lambda t: [np.cos(t)],
        Q=lambda t: [1.0, 2.0 + t, 0.1, 0.1],
        R=[0.1],
        Q_final=[1.0] * 4,
    )
    cost.check(0.0, 3.0, 4, 1)
    projection = _projection()
    rollout = ContinuousProjection(SYSTEM, projection.K, accuracy=Accuracy(rtol=rtol, atol=rtol / 100))(_curve(), cost)
    assert 1.0 in rollout.trajectory.t

    def loop(s, y):
        x, s_in = y[:4], min(s, 3.0)
        u = _CURVE.u(s_in) - projection.K(s_in) @ (x - _CURVE.x(s_in))
        return np.append(SYSTEM.f(x, u, s), cost.rate(x, u, s))

    y = np.append(_CURVE.x(0.0), 0.0)
    for begin, end in ((0.0, 1.0 - 1e-13), (1.0, 3.0)):
        y = solve_ivp(loop, (begin, end), y, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    exact = y[-1] + cost.final_value(y[:4], 3.0)
    assert rollout.cost == pytest.approx(exact, rel=30 * rtol)


_CURVE = _curve()


def test_the_derivative_of_the_projection():
    projection = _projection()
    at = projection(_curve()).trajectory
    direction = _curve(0.7)
    tangent = projection.derivative(at, direction)
    t = np.linspace(0, 3, 101)
    h = 1e-4
    ends = []
    for s in (h, -h):
        moved = DenseTrajectory.from_functions(
            lambda t, s=s: at.x(t) + s * direction.x(t),
            lambda t, s=s: at.u(t) + s * direction.u(t),
            horizon=(0, 3),
            nx=4,
            nu=1,
            tolerance=1e-11,
        )
        ends.append(projection(moved).trajectory.xu(t))
    np.testing.assert_allclose(tangent.xu(t), (ends[0] - ends[1]) / (2 * h), atol=1e-5)


def test_a_failure_says_when():
    class Walled(CartPendulum):
        def f(self, x, u, t):
            if x[0] > 0.2:
                raise StepError("too far", t=t, residuals={}, iteration=0)
            return super().f(x, u, t)

    projection = ContinuousProjection(Walled(), _projection().K)
    rollout = projection(_curve())
    assert rollout.trajectory is None
    assert np.isnan(rollout.cost)
    assert "too far" in rollout.failure
    assert rollout.x[0] == pytest.approx(0.2, abs=1e-3)
    free = _projection()(_curve()).trajectory
    assert free.x(rollout.t)[0] == pytest.approx(0.2, abs=1e-3)


def test_bad_gains():
    with pytest.raises(ArgumentError, match=r"K: got gains of shape \(4,\)"):
        ContinuousProjection(SYSTEM, PiecewisePolynomial.constant(np.zeros(4), 0.0, 1.0))
