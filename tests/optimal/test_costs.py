"""The quadratic tracking cost."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.optimal import QuadraticCost, check_derivatives
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
        ({"u_wanted": np.ones(N)}, r"\(N, nu\)"),
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
