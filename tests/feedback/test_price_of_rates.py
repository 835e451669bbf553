"""A price on rates of inputs: that of a system whose state is made by hand to hold the inputs of the step before."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Bound, MidpointSystem, MidpointVI, QuadraticCost, optimize
from leastaction.control import MPC
from leastaction.costs import CostSum, GaussNewton, RateCost, tracking
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.differences import central_differences
from leastaction.optimal import LinearSystem, Status, check_derivatives
from leastaction.optimal.remembered.system import RememberingSystem
from leastaction.systems import MechanismSystem

N = 20
A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005, 0.0], [0.1, 0.05]])
LINEAR = LinearSystem(A, B, N=N)  # whose times are numbers of steps
PLAIN = QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 2)), Q=[5.0, 0.1], R=[0.1, 0.3])
X0, BEFORE, PRICES = np.array([1.0, 0.5]), np.array([2.0, -1.0]), np.array([0.7, 0.2])


def by_hand(before=None, x0=X0):
    """Return the optimum of the system with state [x; u before], of residuals."""
    whole, inputs = np.zeros((4, 4)), np.vstack([B, np.eye(2)])
    whole[:2, :2] = A

    def residual(x, u, k):
        change = np.sqrt(PRICES) * (u - x[2:]) * (k > 0 or before is not None)
        return np.concatenate([np.sqrt([5.0, 0.1]) * x[:2], np.sqrt([0.1, 0.3]) * u, change])

    cost = GaussNewton(residual, lambda x: np.sqrt([5.0, 0.1]) * x[:2])
    start = np.concatenate([x0, np.zeros(2) if before is None else before])
    return optimize(LinearSystem(whole, inputs, N=N), cost, initial=(start, np.zeros((N, 2))), tolerance=1e-12)


@pytest.mark.parametrize("before", [None, BEFORE])
def test_it_is_what_one_would_make_by_hand(before):
    cost = RateCost(PLAIN, LINEAR, {"u[0]": 0.7, "u[1]": 0.2}, before=before)
    found, hand = optimize(LINEAR, cost, initial=(X0, np.zeros((N, 2))), tolerance=1e-12), by_hand(before)
    assert found.status is Status.CONVERGED
    assert found.iterations <= 3  # a quadratic problem: its second derivatives are exact
    assert found.cost == pytest.approx(hand.cost, rel=1e-9)
    np.testing.assert_allclose(found.u, hand.u, atol=1e-6)
    assert found.x.shape == (N + 1, 2)
    assert cost.value(found.x, found.u) == pytest.approx(found.cost, rel=1e-12)
    plain = optimize(LINEAR, PLAIN, initial=(X0, np.zeros((N, 2))))
    assert np.abs(np.diff(found.u, axis=0)).max() < 0.7 * np.abs(np.diff(plain.u, axis=0)).max()


def test_within_other_costs_and_beside_limits_it_is_the_same():
    by_name = {"u[0]": 0.7, "u[1]": 0.2}
    half = QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 2)), Q=[2.5, 0.05], R=[0.05, 0.15])
    settings = {"initial": (X0, np.zeros((N, 2))), "tolerance": 1e-12}
    one = optimize(LINEAR, RateCost(PLAIN, LINEAR, by_name), **settings)
    parts = CostSum([RateCost(half, LINEAR, {"u[0]": 0.7}), RateCost(half, LINEAR, {"u[1]": 0.2})])
    np.testing.assert_allclose(optimize(LINEAR, parts, **settings).u, one.u, atol=1e-8)
    twice = RateCost(RateCost(PLAIN, LINEAR, {"u[0]": 0.7}), LINEAR, {"u[1]": 0.2})
    np.testing.assert_allclose(optimize(LINEAR, twice, **settings).u, one.u, atol=1e-8)
    limit = Bound("u[0]", -0.5, 0.5, of="input rate")
    found = optimize(LINEAR, RateCost(PLAIN, LINEAR, by_name, before=BEFORE), limits=[limit], **settings)
    changes = np.diff(np.vstack([BEFORE, found.u])[:, 0])
    assert np.abs(changes).max() <= 0.5 + 1e-6  # the first one too, as what was before is known
    assert abs(changes[0]) > 0.4


def test_of_a_mechanism_in_seconds_with_exact_second_derivatives():
    t = np.concatenate([np.linspace(0.0, 0.5, 11), np.linspace(0.6, 1.0, 5)])  # steps of two lengths
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), t)
    plain = tracking(system, {"theta": 20.0, "*.v": 0.1}, {"theta": 1.0}, effort=1e-3)
    cost = RateCost(plain, system, {"x-*": 1e-4}, before=[3.0])
    start = np.zeros(4), np.zeros((system.N, 1))
    found = optimize(system, cost, initial=start, tolerance=1e-10)
    assert found.success
    rates = np.diff(np.append(3.0, found.u[:, 0])) / np.append(0.05, (t[2:] - t[:-2]) / 2.0)
    assert found.cost == pytest.approx(plain.value(found.x, found.u) + 0.5e-4 * (rates @ rates), rel=1e-12)

    def moved(u):
        return system.rollout(start[0], np.zeros_like(found.x), u, np.zeros((system.N, 1, 4)), 0, system.N).x

    def value(flat):
        u = flat.reshape(-1, 1)
        return cost.value(moved(u), u)

    np.testing.assert_allclose(central_differences(value, found.u.ravel()), 0.0, atol=1e-6)
    remembering = RememberingSystem(system, cost.needs, before=cost.before)
    rng = np.random.default_rng(0)
    u = rng.standard_normal((system.N, 1))
    x = remembering.extended(moved(u), u)
    report = check_derivatives(remembering, x, u, cost=remembering.cost_of(cost))
    assert report.ok, report


@pytest.mark.parametrize("limits", [[], [Bound("u[0]", -0.4, 0.4, of="input rate")]])
def test_predictive_control_reckons_with_what_it_gave(limits):
    cost = RateCost(PLAIN, LINEAR, {"u[0]": 0.7, "u[1]": 0.2})
    mpc, x, given = MPC(LINEAR, cost, limits, tolerance=1e-9), X0, np.zeros(2)
    for k in range(8):
        u = mpc(x, float(k))
        if not limits:
            np.testing.assert_allclose(u, by_hand(given, x).u[0], atol=1e-5)
        else:
            known = RateCost(PLAIN, LINEAR, {"u[0]": 0.7, "u[1]": 0.2}, before=given)
            best = optimize(LINEAR, known, limits=limits, initial=(x, np.zeros((N, 2))), tolerance=1e-10)
            np.testing.assert_allclose(u, best.u[0], atol=2e-4)
            assert abs(u[0] - given[0]) <= 0.4 + 1e-5
        assert (mpc.x.shape, mpc.K.shape) == ((N + 1, 2), (N, 2, 2))
        x, given = A @ x + B @ u + [0.0, 0.05 * (-1) ** k], u


def test_a_cart_is_pushed_gently_by_predictive_control():
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), 0.02 * np.arange(51))
    plain = tracking(system, {"x": 5.0, "theta": 30.0, "*.v": 1.0}, {"theta": np.pi}, effort=1e-3)
    worst = {}
    for name, cost in {"plain": plain, "gentle": RateCost(plain, system, {"x-force": 1e-5})}.items():
        mpc = MPC(system, cost, [Bound("x-force", -40.0, 40.0)])
        x, pushes = np.array([0.0, np.pi + 0.1, 0.0, 0.0]), [0.0]
        for k in range(100):
            u = mpc(x, 0.02 * k)
            assert mpc.info.planned
            x = system.f(x, u, 0)
            pushes.append(float(u[0]))
        assert abs(x[1] - np.pi) < 0.02
        worst[name] = np.abs(np.diff(pushes)).max()
    assert worst["gentle"] < 0.6 * worst["plain"]


def test_what_is_wrong_is_said():
    for settings, words in (
        ({"rates": {"push": 1.0}}, "rates: unknown input 'push'"),
        ({"rates": {"u[0]": -1.0}}, r"rates\['u\[0\]'\]: got -1"),
        ({"rates": 3.0}, "rates: got"),
        ({"before": [1.0]}, "before: got shape"),
        ({"cost": 1.0}, "cost: got float"),
        ({"system": MechanismSystem(cart_pendulum())}, "system: got MechanismSystem"),
    ):
        given = {"cost": PLAIN, "system": LINEAR, "rates": {"u[0]": 1.0}, **settings}
        with pytest.raises(ArgumentError, match=words):
            RateCost(given.pop("cost"), given.pop("system"), given.pop("rates"), **given)
    with pytest.raises(ArgumentError, match="give it to `optimize` or `MPC`"):
        RateCost(PLAIN, LINEAR, {"u[0]": 1.0}).hessian(np.zeros((N + 1, 2)), np.zeros((N, 2)))
