"""What a class may leave out: the general way gives way to one of its own, and to a public method of the class."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.optimal import (
    ContinuousQuadraticCost,
    FunctionContinuousSystem,
    FunctionSystem,
    Linearization,
    LinearSystem,
    QuadraticCost,
    WindowSystem,
)
from leastaction.optimal.discrete.step_by_step import linearize


def step(x, u, k):
    return np.array([x[0] + 0.1 * x[1], x[1] + 0.1 * np.sin(x[0]) + 0.1 * u[0]])


HOW = {"nx": 2, "nu": 1, "N": 4, "derivatives": "complex-step"}


class Offering(FunctionSystem):
    """A way of its own for some of the states."""

    asked = 0

    def own_linearize(self, x, u, out):
        self.asked += 1
        return Linearization(np.full((4, 2, 2), 7.0), np.full((4, 2, 1), 7.0)) if x[0, 0] > 0.0 else None


class Overriding(FunctionSystem):
    """The public method, as classes outside of the library may."""

    def linearize(self, x, u, out=None):
        A, B = super().linearize(x, u, out)
        return Linearization(2.0 * A, B)


def test_a_way_of_its_own_is_asked_first_and_may_decline() -> None:
    system = Offering(step, **HOW)
    x, u = np.zeros((5, 2)), np.zeros((4, 1))
    np.testing.assert_array_equal(system.linearize(x, u).A, linearize(system, x, u).A)
    np.testing.assert_array_equal(system.linearize(x + 1.0, u).A, 7.0)
    assert system.asked == 2


def test_the_public_method_may_be_overridden_by_users() -> None:
    system = Overriding(step, **HOW)
    x, u = np.zeros((5, 2)), np.zeros((4, 1))
    plain = linearize(system, x, u)
    np.testing.assert_array_equal(system.linearize(x, u).A, 2.0 * plain.A)
    # A window is asked of the system that it is one of, whichever of both it says.
    np.testing.assert_array_equal(WindowSystem(system, 1, 3).linearize(x[:3], u[:2]).A, 2.0 * plain.A[1:3])
    offering = WindowSystem(Offering(step, **HOW), 1, 3)
    np.testing.assert_array_equal(offering.linearize(x[:3] + 1.0, u[:2]).A, 7.0)


def test_a_linear_system_with_other_derivatives_is_asked_for_them() -> None:
    class Other(LinearSystem):
        def derivatives(self, x, u, k):
            A, B = super().derivatives(x, u, k)
            return 3.0 * A, B

    system = Other(np.eye(2), np.ones((2, 1)), N=2)
    np.testing.assert_array_equal(system.linearize(np.zeros((3, 2)), np.zeros((2, 1))).A, [3.0 * np.eye(2)] * 2)


def test_what_is_missing_is_named() -> None:
    system = FunctionSystem(step, **HOW)
    x, u = np.zeros((5, 2)), np.zeros((4, 1))
    assert system.curvature(x[0], u[0], 0, np.ones(2)) is None
    with pytest.raises(NotImplementedError, match="FunctionSystem has no second derivative: implement `curvature`"):
        system.linearize(x, u).curvature(np.ones((4, 2)))
    system.parameters = {"mass": 1.0}
    with pytest.raises(NotImplementedError, match="FunctionSystem has no parameters: implement `differentiate_by`"):
        system.linearize_by(x, u, ["mass"])


def test_a_convex_hessian_of_its_own_counts() -> None:
    class Bent(QuadraticCost):
        def hessian(self, x, u):
            return super().hessian(x, u)._replace(R=np.full(1, -1.0))

    class Offered(Bent):
        def own_convex_hessian(self, x, u):
            return super().hessian(x, u)._replace(R=np.full(1, 5.0))

    x, u = np.zeros((3, 2)), np.zeros((2, 1))
    given = {"Q": np.ones(2), "R": np.ones(1)}
    for kind, R in ((QuadraticCost, 1.0), (Bent, 0.0), (Offered, 5.0)):
        cost = kind(x, u, **given)
        np.testing.assert_array_equal(cost.convex_hessian(x, u).R, R)
        np.testing.assert_array_equal(cost.model_hessian(x, u, convex=True).R, R)


def test_a_final_term_is_a_part() -> None:
    system = FunctionContinuousSystem(lambda x, u, t: u, nx=1, nu=1, derivatives="complex-step")
    cost = ContinuousQuadraticCost([0.0], [0.0], Q=[1.0], R=[1.0], Q_final=[4.0], x_final=[1.0])
    x = np.array([3.0])
    assert cost.final_value(x, 1.0) == 8.0
    np.testing.assert_array_equal(cost.final_gradient(x, 1.0), [8.0])
    np.testing.assert_array_equal(cost.convex_final_hessian(x, 1.0), [[4.0]])
    without = ContinuousQuadraticCost([0.0], [0.0], Q=[1.0], R=[1.0])
    assert without.final_term is None
    assert without.final_value(x, 1.0) == 0.0
    np.testing.assert_array_equal(system.rates(x[None], x[None], np.zeros(1)), [[3.0]])
