"""The projection in the user's hands: own gains or weights, and its second derivative, in both kinds of time."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.optimal import (
    Bound,
    ContinuousQuadraticCost,
    Equal,
    LinearSystem,
    Options,
    ProjectionOperator,
    QuadraticCost,
    Status,
    check_derivatives,
    optimize,
    regulate,
)
from leastaction.optimal.continuous import (
    Accuracy,
    ContinuousProjection,
    DenseTrajectory,
    LinearContinuousSystem,
    PiecewisePolynomial,
    regulate_continuous,
)
from leastaction.optimal.discrete.system import linearized
from optimal.continuous.systems import CartPendulum as ContinuousCartPendulum
from optimal.systems import CartPendulum, simulate

N = 60
WEIGHTS = {"Q": [3.0, 2.0, 1.0, 0.5], "R": [0.7], "Q_final": [9.0, 9.0, 1.0, 1.0]}


@pytest.fixture
def swing():
    system = CartPendulum(N, 0.03)
    wanted = np.tile([0.5, np.pi, 0.0, 0.0], (N + 1, 1))
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[0.1, 0.1, 0.01, 0.01], R=[0.05], Q_final=[50.0, 50.0, 5.0, 5.0])
    u = 0.5 * np.sin(0.2 * np.arange(N))[:, None]
    return system, cost, (simulate(system, [0.1, 2.5, 0.0, 0.0], u), u)


def along(system, result):
    return system.linearize(result.x, result.u)


@pytest.mark.parametrize("limits", [(), (Bound("u[0]", -9.0, 9.0),)])
def test_weights_of_a_projection_are_those_of_its_regulator(swing, limits):
    system, cost, initial = swing
    plain = optimize(system, cost, initial=initial, limits=limits)
    found = optimize(system, cost, initial=initial, limits=limits, options=Options(projection=WEIGHTS))
    assert found.status is Status.CONVERGED
    assert found.cost == pytest.approx(plain.cost, rel=1e-9)
    # About the iterate before the last step, which is close.
    expected = regulate(*along(system, found), **WEIGHTS)
    np.testing.assert_allclose(found.projection_gain, expected, rtol=0.02, atol=0.02 * np.abs(expected).max())
    assert not np.allclose(plain.projection_gain, expected, rtol=0.1)


def test_gains_of_a_projection_are_taken_as_they_are(swing):
    system, cost, initial = swing
    gains = regulate(*system.linearize(*initial), **WEIGHTS)
    found = optimize(system, cost, initial=initial, projection=gains, tolerance=1e-13)
    assert found.cost == pytest.approx(optimize(system, cost, initial=initial).cost, rel=1e-9)
    assert np.array_equal(found.projection_gain, gains)
    # Iterates are projections by them: a trial of the first iteration, done by hand.
    first = optimize(system, cost, initial=initial, projection=gains, max_iterations=1, method="quasi-newton")
    assert first.history.step_length[0] == 1.0
    again = optimize(system, cost, resume=optimize(system, cost, initial=initial, projection=gains, max_iterations=3),
                     projection=gains, tolerance=1e-13)  # fmt: skip
    assert np.array_equal(again.x, found.x)


def test_a_curve_is_projected_by_the_given_gains(swing):
    system, cost, (x, u) = swing
    gains = regulate(*system.linearize(x, u), **WEIGHTS)
    rng = np.random.default_rng(0)
    curve = x + 0.02 * rng.standard_normal(x.shape), u + 0.02 * rng.standard_normal(u.shape)
    found = optimize(system, cost, initial=curve, projection=gains, max_iterations=0, shooting="single")
    expected = ProjectionOperator(system, gains)(*curve)
    np.testing.assert_array_equal(found.x, expected.x)


def test_a_projection_beside_unknowns_acts_on_the_systems_own_states():
    from leastaction import FinalTime, JointForce, JointSpring, Mechanism, MidpointSystem, MidpointVI, tx

    slide = Mechanism([tx("x", mass=1.0)], [JointSpring("x", 1.0, name="spring"), JointForce("x", input="push")])
    system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 1.0, 21))
    cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[0.0, 0.0], R=[1e-3])
    start = np.zeros((21, 2)), np.zeros((20, 1))
    unknowns = [FinalTime(0, 5, price=1.0)]
    limits = [Bound("push", -2.0, 2.0), Equal("x", 1.0), Equal("p_x", 0.0)]
    plain = optimize(system, cost, initial=start, unknowns=unknowns, limits=limits)
    for given in ({"Q": [1.0, 2.0], "R": [1.0]}, np.full((20, 1, 2), 0.3)):
        found = optimize(system, cost, initial=start, unknowns=unknowns, limits=limits, projection=given)
        assert found.cost == pytest.approx(plain.cost, rel=1e-7)


def test_the_second_derivative_of_the_projection_is_that_of_differences(swing):
    system, _, (x, u) = swing
    rng = np.random.default_rng(7)
    linearization = linearized(system, x, u)
    projection = ProjectionOperator(system, regulate(*linearization))
    one, other = ((rng.standard_normal(x.shape), rng.standard_normal(u.shape)) for _ in range(2))
    ddx, ddu = projection.second_derivative(linearization, one, other)

    def projected(s, r):
        run = projection(x + s * one[0] + r * other[0], u + s * one[1] + r * other[1])
        return np.hstack([run.x[1:], run.u])

    h = 2e-4
    mixed = (projected(h, h) - projected(h, -h) - projected(-h, h) + projected(-h, -h)) / (4 * h * h)
    got = np.hstack([ddx[1:], ddu])
    assert np.abs(got).max() > 1.0
    np.testing.assert_allclose(got, mixed, atol=1e-5 * np.abs(got).max())
    swapped = projection.second_derivative(linearization, other, one)
    np.testing.assert_allclose(swapped[0], ddx, atol=1e-12 * np.abs(ddx).max())


CONTINUOUS = ContinuousCartPendulum()


def _curve(size=0.3, nu=3):
    return DenseTrajectory.from_functions(
        lambda t: [size * np.sin(t), size * np.sin(2 * t), size * np.cos(t), 2 * size * np.cos(t)],
        lambda t: [np.sin(nu * t)],
        horizon=(0, 2),
        nx=4,
        nu=1,
    )


def test_the_second_derivative_in_continuous_time_is_that_of_differences():
    accuracy = Accuracy(rtol=1e-11, atol=1e-13)
    A, B = CONTINUOUS.derivatives(np.zeros(4), np.zeros(1), 0.0)
    projection = ContinuousProjection(
        CONTINUOUS, regulate_continuous(A, B, horizon=(0, 2), accuracy=accuracy), accuracy=accuracy
    )
    trajectory = projection(_curve()).trajectory
    one, other = _curve(0.5, 2), _curve(-0.4, 5)
    bent = projection.second_derivative(trajectory, one, other)
    t = np.linspace(0.0, 2.0, 21)

    def projected(s, r):
        moved = DenseTrajectory.from_functions(
            lambda t: trajectory.x(t) + s * one.x(t) + r * other.x(t),
            lambda t: trajectory.u(t) + s * one.u(t) + r * other.u(t),
            horizon=(0, 2), nx=4, nu=1,
        )  # fmt: skip
        return np.hstack(projection(moved).trajectory.sample(t))

    h = 3e-3
    mixed = (projected(h, h) - projected(h, -h) - projected(-h, h) + projected(-h, -h)) / (4 * h * h)
    got = np.hstack(bent.sample(t))
    assert np.abs(got).max() > 0.1
    np.testing.assert_allclose(got, mixed, atol=1e-3 * np.abs(got).max())


@pytest.mark.parametrize("collocate", [True, False])
def test_own_weights_and_gains_in_continuous_time_lead_to_the_same_minimum(collocate):
    system = LinearContinuousSystem([[0.0, 1.0], [1.0, 0.0]], [[0.0], [1.0]])
    cost = ContinuousQuadraticCost(np.zeros(2), np.zeros(1), Q=[1.0, 0.1], R=[0.5], Q_final=[2.0, 1.0])
    given = {"initial": (np.array([1.0, -0.2]), np.zeros(1)), "horizon": (0.0, 2.0), "collocate": collocate}
    plain = optimize(system, cost, **given)
    A, B = system.derivatives(np.zeros(2), np.zeros(1), 0.0)
    gains = regulate_continuous(A, B, horizon=(0.0, 2.0), Q=[4.0, 1.0])
    for projection in ({"Q": [5.0, 1.0], "R": [0.3]}, gains):
        found = optimize(system, cost, projection=projection, **given)
        assert found.success, found.message
        assert found.cost == pytest.approx(plain.cost, rel=1e-7)
    if not collocate:
        np.testing.assert_allclose(found.projection(1.0)[:2], gains(1.0).ravel(), rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros((3, 1, 2)), r"projection: got shape \(3, 1, 2\), expected \(4, 1, 2\)"),
        (np.zeros(3), r"projection: got shape \(3,\), expected .* gains"),
        ({"S": 1.0}, "projection: 'S' is no weight; the weights are 'Q', 'R', 'Q_final'"),
        ({"Q": [1.0]}, r"projection: Q: got shape \(1,\)"),
        ({"R": [-1.0]}, "projection: R: got a smallest eigenvalue of -1"),
        (PiecewisePolynomial(np.array([0.0, 1.0]), np.zeros((1, 1, 2)), (1, 2)), "projection: got functions of time"),
    ],
)
def test_what_is_no_projection_is_told(given, message):
    system = LinearSystem(np.eye(2), [[0.0], [1.0]], N=4)
    cost = QuadraticCost(np.zeros((5, 2)), np.zeros((4, 1)), Q=[1.0, 1.0], R=[1.0])
    with pytest.raises(ArgumentError, match=message):
        optimize(system, cost, initial=(np.ones(2), np.zeros((4, 1))), projection=given)


def test_a_cost_alone_is_held_to_its_derivatives():
    rng = np.random.default_rng(1)
    cost = QuadraticCost(rng.standard_normal((6, 2)), np.zeros((5, 1)), Q=[1.0, 2.0], R=[0.5])
    x, u = rng.standard_normal((6, 2)), rng.standard_normal((5, 1))
    report = check_derivatives(cost, x, u)
    assert report.ok
    assert set(report.errors) == {"cost gradient", "cost hessian", "cost model_hessian"}

    class Wrong(QuadraticCost):
        def gradient(self, x, u):
            q, r, last = super().gradient(x, u)
            return type(super().gradient(x, u))(2.0 * q, r, last)

    wrong = Wrong(cost.x_wanted, cost.u_wanted, Q=[1.0, 2.0], R=[0.5])
    assert check_derivatives(wrong, x, u).errors["cost gradient"] > 1e-3
    with pytest.raises(ArgumentError, match="got 5 states and 5 inputs, expected one state more"):
        check_derivatives(cost, x[:5], u)
    curve = DenseTrajectory.from_functions(lambda t: [np.sin(t)], lambda t: [np.cos(t)], horizon=(0.0, 1.0), nx=1, nu=1)
    smooth = ContinuousQuadraticCost([0.3], [0.0], Q=[2.0], R=[1.0], Q_final=[3.0])
    report = check_derivatives(smooth, curve)
    assert report.ok
    assert set(report.errors) == {"cost gradient", "cost hessian", "final gradient", "final hessian"}
