"""Costs by name in continuous time are those that one would write by hand, on a mesh and rolled out; and their sums."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    BodyWrench,
    ContinuousQuadraticCost,
    JointForce,
    Mechanism,
    MechanismSystem,
    ball,
    check_derivatives,
    optimize,
    rx,
)
from leastaction.costs import ContinuousCostSum, CostSum, tracking
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics import rotations
from leastaction.optimal import DenseTrajectory, PiecewisePolynomial

SYSTEM = MechanismSystem(cart_pendulum())
RNG = np.random.default_rng(0)
T = np.linspace(0.0, 0.99, 7)
X, U = RNG.standard_normal((7, 4)), RNG.standard_normal((7, 1))
HULL = MechanismSystem(
    Mechanism([ball("hull", mass=1.0, inertia=(0.2, 0.3, 0.4))], [BodyWrench("hull", torque=("a", "b", "c"))])
)


def turned(t: float) -> np.ndarray:
    c, s = np.cos(0.8 * t), np.sin(0.8 * t)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def test_by_name_it_is_what_one_would_write_by_hand():
    path = PiecewisePolynomial.through([0.0, 0.5, 1.0], [0.0, 0.3, -0.2])
    cost = tracking(
        SYSTEM, {"*": 0.5, "theta": 100.0, "x.v": 3.0}, {"theta": lambda t: np.pi * t, "x": path, "theta.v": np.pi},
        effort={"x-force": 0.1}, inputs={"x-force": np.sin}, final={"theta": 7.0, "*.v": 2.0},
    )  # fmt: skip
    plain = ContinuousQuadraticCost(
        lambda t: np.array([float(path(t)), np.pi * t, 0.0, np.pi]), np.sin,
        Q=[0.5, 100.0, 3.0, 0.5], R=[0.1], Q_final=[0.0, 7.0, 2.0, 2.0],
    )  # fmt: skip
    np.testing.assert_allclose(cost.rates(X, U, T), plain.rates(X, U, T), rtol=1e-13)
    assert cost.final_value(X[0], 1.0) == pytest.approx(plain.final_value(X[0], 1.0), rel=1e-13)


def test_whole_states_are_taken_as_they_come():
    states = PiecewisePolynomial.through([0.0, 1.0], [[0.0] * 4, [1.0] * 4], kind="linear")
    for wanted in (states, lambda t: np.full(4, t)):
        np.testing.assert_allclose(
            tracking(SYSTEM, {"theta": 2.0}, wanted, effort=1e-9).rates(X, 0.0 * U, T), (X[:, 1] - T) ** 2, atol=1e-12
        )
    still = tracking(SYSTEM, {"theta": 2.0}, [0.0, 1.0, 0.0, 0.0], effort=1e-9)
    np.testing.assert_allclose(still.rates(X, 0.0 * U, T), (X[:, 1] - 1.0) ** 2, atol=1e-12)


def test_a_rotation_is_wanted_by_the_name_of_its_joint():
    cost = tracking(HULL, {"hull.wx": 8.0, "hull.w*.v": 0.5}, {"hull": turned}, final={"hull.wx": 2.0})
    q = rotations.exponential(np.array([1.0, 0.0, 0.0]))
    x = np.concatenate([q, [0.3, 0.0, 0.4]])
    off = 1.0 - 0.8 * 0.7
    assert cost.rate(x, np.zeros(3), 0.7) == pytest.approx(4.0 * off**2 + 0.25 * 0.25, rel=1e-10)
    assert cost.final_value(x, 0.7) == pytest.approx(off**2, rel=1e-6)


@pytest.mark.parametrize("collocate", [True, False])
def test_a_motion_is_found_by_it_with_a_mesh_and_without(collocate):
    words = tracking(SYSTEM, {"theta": 2.0, "*.v": 0.1}, {"theta": np.sin}, effort=0.1, final={"x": 50.0})
    plain = ContinuousQuadraticCost(
        lambda t: np.array([0.0, np.sin(t), 0.0, 0.0]), [0.0], Q=[0.0, 2.0, 0.1, 0.1], R=[0.1],
        Q_final=[50.0, 0.0, 0.0, 0.0],
    )  # fmt: skip
    parts = ContinuousCostSum(
        [tracking(SYSTEM, {"theta": 2.0}, {"theta": np.sin}, effort=0.04, final={"x": 50.0}),
         tracking(SYSTEM, {"*.v": 0.1}, effort=0.06)]
    )  # fmt: skip
    found = [
        optimize(
            SYSTEM, each, initial=([0.2, 0.1, 0.0, 0.0], [0.0]), horizon=(0.0, 1.0), collocate=collocate, tolerance=1e-8
        )
        for each in (plain, words, parts)
    ]
    assert all(each.success for each in found)
    for each in found[1:]:
        assert each.cost == pytest.approx(found[0].cost, rel=1e-7)
        np.testing.assert_allclose(each.dense.sample(T)[0], found[0].dense.sample(T)[0], atol=1e-5)


@pytest.mark.parametrize("collocate", [True, False])
def test_it_counts_while_it_is_asked_for(collocate):
    cost = tracking(SYSTEM, {"theta": 2.0}, effort=1e-9, during=(0.25, 0.5))
    counts = (T >= 0.25) & (T < 0.5)
    np.testing.assert_allclose(cost.rates(X, 0.0 * U, T), np.where(counts, X[:, 1] ** 2, 0.0), atol=1e-15)
    assert cost.jumps == (0.25, 0.5)
    heavy = tracking(SYSTEM, {"x": 1e3}, {"x": 0.1}, effort=1e-3, during=(0.5, 0.8))
    found = optimize(SYSTEM, heavy, initial=(np.zeros(4), [0.0]), horizon=(0.0, 1.0), collocate=collocate)
    assert found.success
    u = found.dense.sample(np.linspace(0.801, 0.999, 5))[1]
    assert np.abs(u).max() < 1e-3 < np.abs(found.dense.sample(np.array([0.2]))[1]).max()


@pytest.mark.parametrize("collocate", [True, False])
def test_a_body_turns_as_it_is_wanted_to(collocate):
    cost = tracking(HULL, {"hull.w?": 100.0}, {"hull": turned}, effort=1e-3, final={"hull.w?": 10.0})
    start = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = optimize(HULL, cost, initial=(start, np.zeros(3)), horizon=(0.0, 1.0), collocate=collocate)
    assert found.success
    np.testing.assert_allclose(found.x[-1, :4], [np.cos(0.4), np.sin(0.4), 0.0, 0.0], atol=1e-3)
    # As a hinge of the same inertia does.
    hinge = MechanismSystem(Mechanism([rx("turn", mass=1.0, inertia=(0.2, 0.3, 0.4))], [JointForce("turn", input="a")]))
    plain = tracking(hinge, {"turn": 100.0}, {"turn": lambda t: 0.8 * t}, effort=1e-3, final={"turn": 10.0})
    other = optimize(hinge, plain, initial=(np.zeros(2), [0.0]), horizon=(0.0, 1.0), collocate=collocate)
    assert found.cost == pytest.approx(other.cost, rel=1e-5)


def test_derivatives_are_those_of_the_values():
    curve = DenseTrajectory.from_functions(
        lambda t: np.concatenate([rotations.exponential(np.array([t, 0.3, -0.2 * t])), [t, 0.1, 0.2]]),
        lambda t: np.array([t, 1.0, -t]), horizon=(0.0, 1.0), nx=7, nu=3,
    )  # fmt: skip
    one = tracking(HULL, {"*": 1.0, "hull.wx": 8.0}, {"hull": turned}, final={"hull.w?": 2.0})
    for cost in (one, ContinuousCostSum([one, tracking(HULL, {"*.v": 2.0}, during=(0.3, 0.6), final={"*.v": 1.0})])):
        assert check_derivatives(cost, curve).ok


def test_what_is_wrong_is_said():
    for change, words in (
        ({"weights": {"tetha": 1.0}}, "weights: unknown name 'tetha'; did you mean 'theta'"),
        ({"weights": {"tetha.v": 1.0}}, "weights: unknown name 'tetha.v'; did you mean 'theta.v'"),
        ({"final": {"tetha": 1.0}}, "final: unknown name 'tetha'"),
        ({"weights": {"theta": -1.0}}, r"weights\['theta'\]: got -1"),
        ({"wanted": {"tetha": 1.0}}, "wanted: unknown name 'tetha'; did you mean 'theta'"),
        ({"wanted": {"theta": np.zeros(3)}}, r"wanted\['theta'\]: got shape .*PiecewisePolynomial.through"),
        ({"wanted": np.zeros((5, 4))}, r"wanted: got shape .*PiecewisePolynomial.through"),
        ({"effort": {"push": 1.0}}, "effort: unknown input 'push'"),
        ({"inputs": {"x-forse": 1.0}}, "inputs: unknown name 'x-forse'; did you mean 'x-force'"),
        ({"during": (0.5, 0.5)}, "during: got 0.5 to 0.5 s"),
    ):
        with pytest.raises(ArgumentError, match=words):
            tracking(SYSTEM, **{"weights": {"theta": 1.0}, **change})
    with pytest.raises(ArgumentError, match=r"wanted\['theta'\] at t = .*got shape"):
        tracking(SYSTEM, {"theta": 1.0}, {"theta": lambda t: np.zeros(2)}).rates(X, U, T)
    with pytest.raises(ArgumentError, match="costs: got none"):
        ContinuousCostSum([])
    with pytest.raises(ArgumentError, match="in continuous time it is a ContinuousCostSum"):
        CostSum([tracking(SYSTEM, {"theta": 1.0})])
