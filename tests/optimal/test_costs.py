"""The quadratic tracking cost."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import MidpointSystem, MidpointVI, optimize
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import Bound, QuadraticCost, check_derivatives
from leastaction.optimal.discrete.cost import CostGradient, CostHessian, convex
from leastaction.optimal.discrete.hessians import HessianPart, ModelHessian, between, same
from leastaction.optimal.limits.cost import LimitedCost
from leastaction.systems import PlaceCost
from optimal.systems import CartPendulum

N, NX, NU = 9, 4, 1


@pytest.fixture
def curves():
    rng = np.random.default_rng(4)
    return [rng.standard_normal(shape) for shape in ((N + 1, NX), (N, NU)) * 2]


def _weights(layout):
    rng = np.random.default_rng(6)
    q, r = rng.uniform(1, 2, NX), rng.uniform(1, 2, NU)
    if layout == "diagonal":
        return q, r
    if layout == "matrix":
        M = rng.standard_normal((NX, NX))
        return M @ M.T, np.diag(r)
    if layout == "diagonal per stage":
        return rng.uniform(1, 2, (N, NX, 1)), rng.uniform(1, 2, (N, NU, 1))
    M = rng.standard_normal((N, NX, NX))
    return M @ np.swapaxes(M, 1, 2), rng.uniform(1, 2, (N, NU, 1, 1))[:, :, 0]


def _at(weight, k):
    weight = weight[k] if weight.ndim == 3 else weight
    return np.diag(weight.ravel()) if weight.ndim == 1 or weight.shape[1] != len(weight) else weight


@pytest.mark.parametrize("layout", ["diagonal", "matrix", "diagonal per stage", "matrix per stage"])
def test_value_and_derivatives(curves, layout):
    x_wanted, u_wanted, x, u = curves
    Q, R = _weights(layout)
    cost = QuadraticCost(x_wanted, u_wanted, Q=Q, R=R)
    dx, du = x - x_wanted, u - u_wanted
    stages = np.array([0.5 * dx[k] @ _at(Q, k) @ dx[k] + 0.5 * du[k] @ _at(R, k) @ du[k] for k in range(N)])
    final = 0.5 * dx[N] @ _at(Q, N - 1) @ dx[N]
    np.testing.assert_allclose(cost.stage_values(x[:-1], u, 0), stages)
    np.testing.assert_allclose(cost.stage_values(x[3:6], u[3:6], 3), stages[3:6])
    assert cost.value(x, u) == pytest.approx(stages.sum() + final)
    assert cost.nonnegative
    assert check_derivatives(CartPendulum(N), x, u, cost=cost).ok


def test_final_weight(curves):
    x_wanted, u_wanted, x, u = curves
    plain = QuadraticCost(x_wanted, u_wanted, Q=np.ones(NX), R=np.ones(NU))
    heavy = QuadraticCost(x_wanted, u_wanted, Q=np.ones(NX), R=np.ones(NU), Q_final=3 * np.eye(NX))
    extra = np.sum((x - x_wanted)[-1] ** 2)
    assert heavy.value(x, u) - plain.value(x, u) == pytest.approx(extra)
    assert check_derivatives(CartPendulum(N), x, u, cost=heavy).ok


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"Q": np.ones(3)}, "Q: got shape"),
        ({"R": np.ones((2, 2))}, "R: got shape"),
        ({"Q_final": np.ones((N, NX, NX))}, "Q_final: got shape"),
        ({"R": np.zeros(1)}, "R: got a smallest eigenvalue of 0.*positive definite"),
        ({"R": [[-1.0]]}, "positive definite"),
        ({"Q": [1.0, 1.0, -1e-3, 1.0]}, "positive semidefinite"),
        ({"Q": np.diag([1.0, 1.0, -1e-3, 1.0])}, "positive semidefinite"),
        ({"Q": np.triu(np.ones((4, 4)))}, "symmetric"),
        ({"Q": [1.0, np.nan, 1.0, 1.0]}, r"Q: got nan at index \(1,\)"),
        ({"x_wanted": np.full((N + 1, NX), np.inf)}, "x_wanted: got inf"),
        ({"x_wanted": np.ones((N, NX))}, "one state more than inputs"),
        ({"u_wanted": np.ones((2, N, NU))}, r"\(N, nu\)"),
        ({"u_wanted": np.ones(N)}, "R: got shape"),
    ],
)
def test_complains(curves, arguments, message):
    given = {
        "x_wanted": curves[0],
        "u_wanted": curves[1],
        "Q": np.ones(NX),
        "R": np.ones(NU),
        **arguments,
    }
    with pytest.raises(ArgumentError, match=message):
        QuadraticCost(given.pop("x_wanted"), given.pop("u_wanted"), **given)


def test_a_semidefinite_matrix_is_accepted(curves):
    ones = np.ones((NX, NX))
    cost = QuadraticCost(curves[0], curves[1], Q=ones, R=np.ones(NU))
    assert np.array_equal(cost.Q, ones)


def test_weights_for_every_stage_as_rows(curves):
    x_wanted, u_wanted, x, u = curves
    rng = np.random.default_rng(3)
    Q, R = rng.uniform(0.5, 2.0, (N, NX)), rng.uniform(0.5, 2.0, (N, NU))
    rows = QuadraticCost(x_wanted, u_wanted, Q=Q, R=R)
    columns = QuadraticCost(x_wanted, u_wanted, Q=Q[..., None], R=R[..., None])
    assert rows.value(x, u) == columns.value(x, u)
    assert np.array_equal(rows.Q_final, Q[-1])
    assert check_derivatives(CartPendulum(N), x, u, cost=rows).ok


def test_the_callers_arrays_are_copied_and_the_costs_own_cannot_be_written_to(curves):
    x_wanted, u_wanted, x, u = (a.copy() for a in curves)
    Q, R, Q_final = np.ones(NX), np.ones(NU), np.ones(NX)
    cost = QuadraticCost(x_wanted, u_wanted, Q=Q, R=R, Q_final=Q_final)
    before = cost.value(x, u)
    for array in (x_wanted, u_wanted, Q, R, Q_final):
        array *= 7.0
    assert cost.value(x, u) == before
    for name in ("x_wanted", "u_wanted", "Q", "R", "Q_final"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(cost, name)[0] = 1.0


def test_the_convex_part_of_a_hessian():
    rng = np.random.default_rng(8)
    W = rng.normal(size=(5, 4, 4))
    bent, stiff = W + np.swapaxes(W, 1, 2), W @ np.swapaxes(W, 1, 2)
    R = np.ones((5, 2, 1))
    same = CostHessian(stiff, R, None, np.ones(4))
    assert convex(same) is same
    found = convex(CostHessian(bent, R, None, -np.ones(4)))
    values, vectors = np.linalg.eigh(bent)
    wanted = (vectors * np.maximum(values, 0.0)[:, None]) @ np.swapaxes(vectors, 1, 2)
    np.testing.assert_allclose(found.Q, wanted, atol=1e-13)
    assert found.R is R
    np.testing.assert_array_equal(found.Q_final, np.zeros(4))
    # What couples states and inputs counts too.
    crossed = CostHessian(np.ones(4), np.ones(2), 2.0 * np.eye(4, 2), np.ones(4))
    Q, R, S, _ = convex(crossed)
    whole = np.block([[Q[0], S[0]], [S[0].T, R[0]]])
    assert np.linalg.eigvalsh(whole).min() > -1e-13
    np.testing.assert_allclose(np.linalg.eigvalsh(whole)[-2:], [3.0, 3.0])


class Wavy(QuadraticCost):
    """A cost of one's own that bends downwards: ``w (1 - cos(pole - pi))`` beside the weights."""

    def stage_values(self, x, u, start):
        return super().stage_values(x, u, start) + 10.0 * (1.0 + np.cos(x[:, 1]))

    def gradient(self, x, u):
        q, r, q_final = super().gradient(x, u)
        q = q.copy()
        q[:, 1] -= 10.0 * np.sin(x[:-1, 1])
        return CostGradient(q, r, q_final)

    def hessian(self, x, u):
        Q, R, S, Q_final = super().hessian(x, u)
        stages = np.tile(Q, (len(u), 1))[:, :, None]
        stages[:, 1, 0] -= 10.0 * np.cos(x[:-1, 1])
        return CostHessian(stages, R, S, Q_final)


def test_a_cost_that_bends_downwards_is_no_reason_for_steepest_descent():
    """Where the cost's own second derivative is indefinite, its convex part is followed, and the minimum certified."""
    vi = MidpointVI(cart_pendulum())
    system = MidpointSystem(vi, np.linspace(0.0, 2.0, 101))
    start = vi.start([0.0, 0.3])
    wanted = np.zeros((101, 4))
    cost = Wavy(wanted, np.zeros((100, 1)), Q=[0.1, 0.0, 0.0, 0.0], R=[0.001])
    found = optimize(system, cost, initial=(start.x, np.zeros((100, 1))))
    assert check_derivatives(system, found.x, found.u, cost=cost).ok
    assert found.success
    assert "steepest" not in found.history.method
    assert found.iterations < 60


def test_weights_of_all_stages_stand_stage_after_stage_in_memory():
    """Recursions read them so: others are copied before each."""
    one, each = np.eye(NX), np.tile(2.0 * np.eye(NX), (N, 1, 1))
    for low, high in ((one, each), (each, one)):
        made = between(ModelHessian(low, one, None, one), ModelHessian(high, one, None, one), 0.5).Q
        np.testing.assert_array_equal(made, 0.75 * each)
        assert made.flags.c_contiguous
    system = MidpointSystem(MidpointVI(cart_pendulum()), 0.1 * np.arange(N + 1))
    x, u = np.zeros((N + 1, NX)), np.zeros((N, NU))
    cost = PlaceCost(QuadraticCost(x, u, Q=np.ones(NX), R=[1.0]), system, {"bob": np.zeros(3)}, {"bob": 1.0})
    assert cost.hessian(x, u).Q.flags.c_contiguous


def test_what_few_entries_weigh_is_a_part():
    """A price of configurations beside another, and limits of entries: no whole matrix for each stage."""
    system = MidpointSystem(MidpointVI(cart_pendulum()), 0.1 * np.arange(N + 1))
    rng = np.random.default_rng(3)
    x, u = rng.normal(size=(N + 1, NX)), rng.normal(size=(N, NU))
    quadratic = QuadraticCost(0.0 * x, 0.0 * u, Q=np.eye(NX) + 0.1, R=[1.0])
    cost = PlaceCost(quadratic, system, {"bob": np.zeros(3)}, {"bob": 1.0})
    twice = PlaceCost(cost, system, {"bob": np.ones(3)}, {"bob": 0.5})
    for as_convex, whole, single in (
        (False, twice.hessian(x, u), cost.hessian(x, u)),
        (True, twice.convex_hessian(x, u), cost.convex_hessian(x, u)),
    ):
        by_parts = twice.model_hessian(x, u, convex=as_convex)
        assert by_parts.Q.shape == (NX, NX)
        assert by_parts.part is not None
        assert by_parts.part.matrices.shape == (N, 2, 2)
        np.testing.assert_array_equal(by_parts.whole().Q, whole.Q)
        # Both prices are in it.
        assert not np.allclose(whole.Q, single.Q)
        assert not np.allclose(whole.Q_final, single.Q_final)
    limited = LimitedCost(cost, Bound("p_theta", min=-9.0).rows(system, 1), NX, NU)
    limited.duals.begin(limited.asked(x, u), 1.0, 1.0)
    sigmas = limited.duals.stiffnesses(limited.duals.room(limited.asked(x, u)))
    plain = cost.model_hessian(x, u, convex=False)
    found = limited.hessian(x, u, sigmas, [], plain=plain)
    assert found.Q.shape == (NX, NX)
    assert found.part is not None
    np.testing.assert_array_equal(found.part.columns, [0, 1, 3])
    diagonal = limited.of_states.hessian(sigmas, x.shape)
    assert diagonal is not None
    expected = plain.whole().Q + np.einsum("ki,ij->kij", diagonal[:-1], np.eye(NX))
    np.testing.assert_allclose(found.whole().Q, expected, rtol=1e-14)
    # A later one is written where the first was, and no stiffness is left of that.
    again = limited.hessian(x, u, sigmas, [], plain=plain)
    np.testing.assert_allclose(again.whole().Q, expected, rtol=1e-14)
    assert again.part is not None
    assert np.shares_memory(again.part.matrices, found.part.matrices)
    assert same(again, found)
    assert not same(again, again._replace(part=None))
    assert not same(again, again._replace(part=again.part._replace(matrices=2.0 * again.part.matrices)))


def test_parts_by_columns_that_are_not_neighbours():
    part = HessianPart(np.array([0, 3]), np.arange(8.0).reshape(2, 2, 2))
    both = ModelHessian(np.ones(4), np.ones(1), None, np.ones(4)).plus(part).plus(part).part
    assert both is not None
    np.testing.assert_array_equal(both.matrices, 2.0 * part.matrices)
    wide = ModelHessian(np.ones(4), np.ones(1), None, np.ones(4), part).plus(
        HessianPart(np.array([3]), np.ones((2, 1, 1)))
    )
    np.testing.assert_array_equal(np.diagonal(wide.whole().Q, axis1=1, axis2=2), [[1, 1, 1, 5], [5, 1, 1, 9]])
    np.testing.assert_array_equal(wide.whole().Q[:, 0, 3], [1.0, 5.0])
