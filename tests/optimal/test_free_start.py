"""The initial state as an unknown: against the same problem with the state as an input, and on constraints."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.mechanics import Distance, Gravity, JointForce, Mechanism, MidpointVI, project_configuration, rx, tz
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import Bound, FunctionSystem, LinearSystem, QuadraticCost, Status, optimize
from leastaction.systems import MidpointSystem

N = 60


def test_a_linear_problem_is_solved_in_one_step_as_least_squares(rng: np.random.Generator) -> None:
    A, B = np.eye(3) + 0.1 * rng.normal(size=(N, 3, 3)), 0.3 * rng.normal(size=(N, 3, 1))
    system = LinearSystem(A, B)
    cost = QuadraticCost(rng.normal(size=(N + 1, 3)), np.zeros((N, 1)), Q=np.ones(3), R=np.ones(1))
    result = optimize(system, cost, initial=(np.zeros(3), np.zeros((N, 1))), free_start=True)
    # All states as linear functions of the first and of all inputs.
    rows = [np.hstack([np.eye(3), np.zeros((3, N))])]
    for k in range(N):
        row = A[k] @ rows[-1]
        row[:, 3 + k : 4 + k] += B[k]
        rows.append(row)
    whole = np.vstack([*rows, np.hstack([np.zeros((N, 3)), np.eye(N)])])
    goal = np.concatenate([cost.x_wanted.ravel(), np.zeros(N)])
    found = np.linalg.lstsq(whole, goal, rcond=None)[0]
    assert result.status is Status.CONVERGED
    assert result.iterations == 1
    np.testing.assert_allclose(result.x[0], found[:3], atol=1e-10)
    np.testing.assert_allclose(result.u[:, 0], found[3:], atol=1e-10)


@pytest.fixture(scope="module")
def cart() -> tuple[MidpointSystem, QuadraticCost]:
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), 0.03 * np.arange(N + 1))
    reference = np.zeros((N + 1, 4))
    reference[:, 1] = 1.0 + 0.5 * np.sin(4.0 * system.t)
    return system, QuadraticCost(reference, np.zeros((N, 1)), Q=np.array([0.1, 10.0, 0.01, 0.01]), R=np.array([0.01]))


REST = np.zeros(4), np.zeros((N, 1))


def test_it_is_the_problem_with_the_initial_state_as_a_first_input(cart) -> None:
    system, cost = cart
    result = optimize(system, cost, initial=REST, free_start=True)

    def f(x, u, k):
        return u[1:].copy() if k == 0 else system.f(x, np.ascontiguousarray(u[:1]), k - 1)

    def derivatives(x, u, k):
        if k == 0:
            return np.zeros((4, 4)), np.hstack([np.zeros((4, 1)), np.eye(4)])
        A, B = system.derivatives(x, np.ascontiguousarray(u[:1]), k - 1)
        return A, np.hstack([B, np.zeros((4, 4))])

    longer = FunctionSystem(f, nx=4, nu=5, N=N + 1, derivatives=derivatives)
    Q = np.tile(cost.Q, (N + 1, 1))
    Q[0] = 0.0
    R = np.zeros((N + 1, 5))
    R[:, 0], R[1:, 1:], R[0, 1:] = cost.R[0], 1.0, 0.0
    R[0, 0] = 1.0
    R[0, 1:] = 1e-14  # what is free costs nothing, but the weight has to be positive
    peer = QuadraticCost(
        np.vstack([np.zeros(4), cost.x_wanted]), np.zeros((N + 1, 5)), Q=Q[:, :, None], R=R[:, :, None], Q_final=cost.Q
    )
    found = optimize(longer, peer, initial=(np.zeros(4), np.zeros((N + 1, 5))), method="quasi-newton", tolerance=1e-13)
    assert result.cost == pytest.approx(found.cost, rel=1e-8)
    np.testing.assert_allclose(result.x[0], found.x[1], atol=1e-4)
    fixed = optimize(system, cost, initial=REST)
    assert result.cost < 0.95 * fixed.cost


def test_some_entries_may_be_free_and_limits_hold_at_the_start_too(cart) -> None:
    system, cost = cart
    some = optimize(system, cost, initial=REST, free_start=["theta"])
    assert some.success
    np.testing.assert_array_equal(some.x[0, [0, 2, 3]], 0.0)
    assert abs(some.x[0, 1]) > 0.1
    bounded = optimize(system, cost, initial=REST, free_start=True, limits=[Bound("theta", max=1.1)])
    assert bounded.success
    assert bounded.x[0, 1] < 1.1
    assert bounded.limits.sides[0].k[0] == 0


def test_a_start_on_constraints_stays_there() -> None:
    """A four-bar linkage that swings: the best first pose and momentum for a given angle over time."""
    m = Mechanism(
        [rx("a"), [tz(-1.0, name="A", mass=1.0), [rx("b"), [tz(-1.0, name="B", mass=1.0)]]]],
        [Gravity((0.0, 0.0, -9.81)), Distance("B", "world", 1.5), JointForce("a", input="torque")],
    )
    q = project_configuration(m, [0.3, 1.0]).q
    vi = MidpointVI(m, threads=1)
    t = 0.02 * np.arange(N + 1)
    run = vi.simulate(vi.start(q), t)
    system = MidpointSystem(vi, t)
    reference = run.x.copy()
    reference[:, 0] += 0.2
    cost = QuadraticCost(reference, np.zeros((N, 1)), Q=np.array([10.0, 0.1, 0.1, 0.1]), R=np.array([0.1]))
    Z = system.start_directions(run.x[0], None)
    assert Z.shape == (4, 2)
    np.testing.assert_allclose(m.constraint_jacobian(q) @ Z[:2], 0.0, atol=1e-12)
    result = optimize(system, cost, initial=(run.x, run.u), free_start=True, tolerance=1e-11)
    assert result.success, result.message
    np.testing.assert_allclose(m.constraint_values(result.x[0, :2]), 0.0, atol=1e-12)
    assert result.x[0, 0] - q[0] > 0.02
    # No motion from a start near it on the constraints costs less.
    Z = system.start_directions(result.x[0], None)
    for direction in (*Z.T, *-Z.T):
        for size in (1e-3, 1e-2):
            start = system.moved_start(result.x[0], size * direction)
            beside = system.rollout(start, result.x, result.u, result.K, 0, N)
            assert cost.value(beside.x, beside.u) > result.cost
    fixed = optimize(system, cost, initial=(run.x, run.u))
    assert result.cost < 0.9 * fixed.cost


def test_wrong_names_are_named(cart) -> None:
    system, cost = cart
    with pytest.raises(ArgumentError, match=r"free_start.*theta"):
        optimize(system, cost, initial=REST, free_start=["thet"])
