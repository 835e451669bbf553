"""The projection operator, and the derivatives of the projected cost g = h o P."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.optimal import ProjectionOperator, QuadraticCost, adjoint, regulate
from optimal.systems import CartPendulum, simulate

N = 60


@pytest.fixture
def setting():
    """A trajectory far from any optimum, gains about it, a cost, and a direction of curves."""
    rng = np.random.default_rng(7)
    system = CartPendulum(N, 0.03)
    u = 2.0 * np.sin(0.2 * np.arange(N))[:, None]
    x = simulate(system, [0.1, 0.5, 0.0, 0.0], u)
    linearization = system.linearize(x, u)
    projection = ProjectionOperator(system, regulate(*linearization))
    cost = QuadraticCost(rng.standard_normal(x.shape), rng.standard_normal(u.shape), Q=[3.0, 2.0, 1.0, 1.0], R=[0.5])
    direction = rng.standard_normal(x.shape), rng.standard_normal(u.shape)
    return system, projection, linearization, cost, x, u, direction


def test_projects_onto_trajectories_and_leaves_them_alone(setting):
    system, projection, _, _, x, u, (dx, du) = setting
    assert np.array_equal(projection(x, u).x, x)
    curve = projection(x + 0.1 * dx, u + 0.1 * du)
    assert curve.complete
    for k in range(N):
        np.testing.assert_allclose(curve.x[k + 1], system.f(curve.x[k], curve.u[k], k))
    assert np.abs(curve.x - x).max() > 0.01
    again = projection(curve.x, curve.u)
    np.testing.assert_array_equal(again.x, curve.x)
    np.testing.assert_array_equal(again.u, curve.u)


def test_derivative_of_the_projection(setting):
    _, projection, linearization, _, x, u, (dx, du) = setting
    h = 1e-5
    up, down = (projection(x + s * dx, u + s * du) for s in (h, -h))
    tangent = projection.derivative(linearization, dx, du)
    for got, high, low in zip(tangent, (up.x, up.u), (down.x, down.u), strict=True):
        np.testing.assert_allclose(got, (high - low) / (2 * h), atol=1e-6 * np.abs(got).max())
    # It is a projection too (6.2).
    twice = projection.derivative(linearization, *tangent)
    np.testing.assert_allclose(twice[0], tangent[0], atol=1e-10)


def _expansion(setting):
    """Dg and D2g along the direction, from the adjoint and the contracted curvature."""
    system, projection, linearization, cost, x, u, direction = setting
    dx, du = projection.derivative(linearization, *direction)
    q, r, q_final = cost.gradient(x, u)
    slope = np.sum(q * dx[:-1]) + np.sum(r * du) + q_final @ dx[-1]
    z = adjoint(*linearization, projection.K, q, r, q_final)
    y = np.hstack([dx[:-1], du])
    dynamics = np.einsum("ki,kij,kj->", y, system.curvatures(x, u, z), y)
    Q, R, _, Q_final = cost.hessian(x, u)
    own = np.sum(dx[:-1] ** 2 * Q) + np.sum(du**2 * R) + np.sum(dx[-1] ** 2 * Q_final)
    return slope, own, dynamics


def test_first_derivative_of_the_projected_cost(setting):
    _, projection, _, cost, x, u, (dx, du) = setting
    slope, _, _ = _expansion(setting)

    def g(s):
        curve = projection(x + s * dx, u + s * du)
        return cost.value(curve.x, curve.u)

    h = 1e-4
    differences = (8 * (g(h) - g(-h)) - (g(2 * h) - g(-2 * h))) / (12 * h)
    assert slope == pytest.approx(differences, rel=1e-9)
    assert abs(slope) > 1.0


def test_second_derivative_of_the_projected_cost(setting):
    """Newton's model is exact far from an optimum too, where it depends on the gains."""
    _, projection, _, cost, x, u, (dx, du) = setting
    _, own, dynamics = _expansion(setting)

    def g(s):
        curve = projection(x + s * dx, u + s * du)
        return cost.value(curve.x, curve.u)

    h = 2e-3
    differences = (16 * (g(h) + g(-h)) - (g(2 * h) + g(-2 * h)) - 30 * g(0.0)) / (12 * h**2)
    assert own + dynamics == pytest.approx(differences, rel=1e-6)
    assert abs(dynamics) > 0.01 * abs(own)


def test_wrong_gains(setting):
    with pytest.raises(ArgumentError, match=r"K: got shape \(3, 1, 4\)"):
        ProjectionOperator(setting[0], np.zeros((3, 1, 4)))
