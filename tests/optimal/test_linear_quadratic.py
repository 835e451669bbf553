"""The linear-quadratic recursion against dense linear algebra and its own identities."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from leastaction.errors import ArgumentError
from leastaction.optimal import adjoint, regulate, solve_linear_quadratic, sweep_forward
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.discrete.cost import CostGradient
from leastaction.optimal.discrete.descent import minimise_model
from leastaction.optimal.discrete.hessians import HessianPart, ModelHessian, between, shifted
from leastaction.optimal.discrete.linear_quadratic import Workspace, feedforward_of_drift
from leastaction.optimal.system import Linearization


def _with_drift(rng, N, nx, nu):
    """A problem with linear terms and a drift, but for its dynamics."""
    return {
        "Q": rng.uniform(1, 2, nx),
        "R": rng.uniform(1, 2, nu),
        "q": rng.standard_normal((N, nx)),
        "r": rng.standard_normal((N, nu)),
        "c": rng.standard_normal((N, nx)),
        "Q_final": _positive(rng, nx),
        "q_final": rng.standard_normal(nx),
    }


def _positive(rng, n, floor=0.1):
    M = rng.standard_normal((n, n))
    return M @ M.T / n + floor * np.eye(n)


def _symmetric(rng, *shape):
    M = rng.standard_normal(shape)
    return M + np.swapaxes(M, -1, -2)


@pytest.fixture
def problem():
    """A random affine problem in which every term is present."""
    rng = np.random.default_rng(3)
    N, nx, nu = 7, 5, 3
    return {
        "A": rng.standard_normal((N, nx, nx)),
        "B": rng.standard_normal((N, nx, nu)),
        "Q": np.stack([_positive(rng, nx, 1.0) for _ in range(N)]),
        "R": np.stack([_positive(rng, nu, 1.0) for _ in range(N)]),
        "S": 0.1 * rng.standard_normal((N, nx, nu)),
        "H": 0.02 * _symmetric(rng, N, nx + nu, nx + nu),
        "q": rng.standard_normal((N, nx)),
        "r": rng.standard_normal((N, nu)),
        "c": rng.standard_normal((N, nx)),
        "Q_final": _positive(rng, nx),
        "q_final": rng.standard_normal(nx),
    }


def _hessian(p, k):
    nx = p["A"].shape[1]
    H = p["H"][k].copy()
    H[:nx, :nx] += p["Q"][k]
    H[nx:, nx:] += p["R"][k]
    H[:nx, nx:] += p["S"][k]
    H[nx:, :nx] += p["S"][k].T
    return H


def _value(p, dx, du):
    total = 0.5 * dx[-1] @ p["Q_final"] @ dx[-1] + p["q_final"] @ dx[-1]
    for k in range(len(du)):
        y = np.concatenate([dx[k], du[k]])
        total += 0.5 * y @ _hessian(p, k) @ y + p["q"][k] @ dx[k] + p["r"][k] @ du[k]
    return total


def _dense_solution(p, dx0):
    """The same problem as one dense equality-constrained quadratic program."""
    N, nx, nu = p["B"].shape
    n = nx + nu
    size = N * n + nx
    H, g = np.zeros((size, size)), np.zeros(size)
    E, e = np.zeros(((N + 1) * nx, size)), np.zeros((N + 1) * nx)
    E[:nx, :nx], e[:nx] = np.eye(nx), dx0
    for k in range(N):
        at = slice(k * n, (k + 1) * n)
        H[at, at] = _hessian(p, k)
        g[at] = np.concatenate([p["q"][k], p["r"][k]])
        row = slice((k + 1) * nx, (k + 2) * nx)
        E[row, at] = -np.hstack([p["A"][k], p["B"][k]])
        E[row, (k + 1) * n : (k + 1) * n + nx] = np.eye(nx)
        e[row] = p["c"][k]
    H[N * n :, N * n :], g[N * n :] = p["Q_final"], p["q_final"]
    kkt = np.block([[H, E.T], [E, np.zeros((len(E), len(E)))]])
    y = np.linalg.solve(kkt, np.concatenate([-g, e]))[:size]
    steps = y[: N * n].reshape(N, n)
    return np.vstack([steps[:, :nx], y[N * n :]]), steps[:, nx:]


def _roll(p, solution, dx0):
    dx, du = [dx0], []
    for k in range(len(p["A"])):
        du.append(-solution.K[k] @ dx[-1] - solution.C[k])
        dx.append(p["A"][k] @ dx[-1] + p["B"][k] @ du[-1] + p["c"][k])
    return np.array(dx), np.array(du)


def test_equals_the_dense_kkt_solution(problem):
    dx0 = np.arange(5.0) - 2.0
    solution = solve_linear_quadratic(**problem)
    assert solution.definite
    assert solution.stage is None
    dx, du = _roll(problem, solution, dx0)
    dx_dense, du_dense = _dense_solution(problem, dx0)
    np.testing.assert_allclose(dx, dx_dense, rtol=0, atol=1e-10 * np.abs(dx_dense).max())
    np.testing.assert_allclose(du, du_dense, rtol=0, atol=1e-10 * np.abs(du_dense).max())


def test_value_function_is_the_cost_of_the_solution(problem):
    solution = solve_linear_quadratic(**problem)
    for dx0 in (np.zeros(5), np.arange(5.0)):
        predicted = 0.5 * dx0 @ solution.P0 @ dx0 + solution.b[0] @ dx0 + solution.constant
        actual = _value(problem, *_roll(problem, solution, dx0))
        assert predicted == pytest.approx(actual, rel=1e-11)


def test_riccati_fixed_point():
    rng = np.random.default_rng(0)
    A, B = rng.standard_normal((6, 6)), rng.standard_normal((6, 2))
    Q, R = _positive(rng, 6), _positive(rng, 2)
    N = 300
    solution = solve_linear_quadratic(np.tile(A, (N, 1, 1)), np.tile(B, (N, 1, 1)), Q=Q, R=R, Q_final=Q)
    expected = scipy.linalg.solve_discrete_are(A, B, Q, R)
    np.testing.assert_allclose(solution.P0, expected, rtol=1e-10)
    K = np.linalg.solve(R + B.T @ expected @ B, B.T @ expected @ A)
    np.testing.assert_allclose(solution.K[0], K, rtol=1e-9, atol=1e-11)


def test_P_is_symmetric_to_the_last_bit(problem):
    P = solve_linear_quadratic(**problem, keep_P=True).P
    assert P.shape == (8, 5, 5)
    assert np.array_equal(P, np.swapaxes(P, 1, 2))
    np.testing.assert_array_equal(P[-1], problem["Q_final"])


def test_b_is_the_adjoint_of_the_closed_loop(problem):
    del problem["c"]
    solution = solve_linear_quadratic(**problem)
    p = problem
    z = adjoint(p["A"], p["B"], solution.K, p["q"], p["r"], p["q_final"])
    np.testing.assert_allclose(z, solution.b, rtol=1e-11, atol=1e-11)
    expected = p["q_final"]
    for k in range(len(p["A"]) - 1, -1, -1):
        K = solution.K[k]
        expected = p["q"][k] - K.T @ p["r"][k] + (p["A"][k] - p["B"][k] @ K).T @ expected
    np.testing.assert_allclose(z[0], expected, rtol=1e-11)


def test_a_further_drift_is_solved_for_with_what_was_kept(problem):
    p = problem
    solution = solve_linear_quadratic(**p, keep_P=True)
    further = np.random.default_rng(4).standard_normal(p["c"].shape)
    wanted = solve_linear_quadratic(**{**p, "c": p["c"] + further})
    added = feedforward_of_drift(p["A"], p["B"], solution.K, solution.P, solution.factors, further)
    np.testing.assert_allclose(solution.C + added, wanted.C, rtol=1e-10, atol=1e-11)
    with pytest.raises(ArgumentError, match=r"factors: got shape"):
        feedforward_of_drift(p["A"], p["B"], solution.K, solution.P, solution.factors[1:], further)


def test_a_further_drift_with_a_pattern_reads_nothing_else():
    rng = np.random.default_rng(14)
    A, B = _mechanical(rng, 8)
    N, nx, nu = B.shape
    pattern = np.concatenate([A, B], axis=2).any(axis=0)
    p = _with_drift(rng, N, nx, nu)
    solution = solve_linear_quadratic(A, B, **p, pattern=pattern, keep_P=True)
    further = rng.standard_normal((N, nx))
    wanted = solve_linear_quadratic(A, B, **{**p, "c": p["c"] + further})
    kept = solution.K, solution.P, solution.factors
    for each in (A, B):
        each[:, ~(pattern[:, :nx] if each is A else pattern[:, nx:])] = np.nan
    added = feedforward_of_drift(A, B, *kept, further, pattern=pattern)
    np.testing.assert_allclose(solution.C + added, wanted.C, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("at", [(0, 0, 0), (3, 1, 2), (6, 2, 4)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_gains_that_are_no_numbers_have_no_adjoint(problem, at, value):
    p = problem
    K = np.array(solve_linear_quadratic(**p).K)
    K[at] = value
    with pytest.raises(ArgumentError, match=r"K: got (nan|inf)"):
        adjoint(p["A"], p["B"], K, p["q"], p["r"], p["q_final"])


def test_an_adjoint_with_a_pattern_reads_nothing_else():
    rng = np.random.default_rng(12)
    A, B = _mechanical(rng, 8)
    N, nx, nu = B.shape
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    assert not pattern[:, :nx].any(axis=0).all()
    assert pattern.sum(axis=1).min() <= 2 < pattern.sum(axis=1).max()
    K, q, r = rng.standard_normal((N, nu, nx)), rng.standard_normal((N, nx)), rng.standard_normal((N, nu))
    expected = adjoint(A, B, K, q, r, q[0])
    hidden = [np.where(part, whole, np.nan) for part, whole in ((pattern[:, :nx], A), (pattern[:, nx:], B))]
    found = adjoint(*hidden, K, q, r, q[0], pattern=pattern)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13 * np.abs(expected).max())


def test_sweep_forward_and_the_slope(problem):
    del problem["c"]
    solution = solve_linear_quadratic(**problem)
    dx, du = sweep_forward(problem["A"], problem["B"], solution)
    expected = _roll({**problem, "c": np.zeros((7, 5))}, solution, np.zeros(5))
    np.testing.assert_allclose(dx, expected[0], atol=1e-12)
    np.testing.assert_allclose(du, expected[1], atol=1e-12)
    slope = np.sum(problem["q"] * dx[:-1]) + np.sum(problem["r"] * du) + problem["q_final"] @ dx[-1]
    assert 2.0 * solution.constant == pytest.approx(slope, rel=1e-10)


@pytest.mark.parametrize("layout", ["diagonal", "matrix", "diagonal per stage", "matrix per stage"])
def test_layouts_of_the_weights(problem, layout):
    N, nx, nu = problem["B"].shape
    rng = np.random.default_rng(5)
    Q, R, Q_final = rng.uniform(1, 2, nx), rng.uniform(1, 2, nu), rng.uniform(1, 2, nx)

    def laid_out(diagonal):
        return {
            "diagonal": diagonal,
            "matrix": np.diag(diagonal),
            "diagonal per stage": np.tile(diagonal[:, None], (N, 1, 1)),
            "matrix per stage": np.tile(np.diag(diagonal), (N, 1, 1)),
        }[layout]

    reference = {**problem, "Q": np.tile(np.diag(Q), (N, 1, 1)), "Q_final": np.diag(Q_final)}
    reference["R"] = np.tile(np.diag(R), (N, 1, 1))
    expected = solve_linear_quadratic(**reference)
    final = Q_final if layout.startswith("diagonal") else np.diag(Q_final)
    got = solve_linear_quadratic(**{**problem, "Q": laid_out(Q), "R": laid_out(R), "Q_final": final})
    np.testing.assert_allclose(got.K, expected.K, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(got.P0, expected.P0, rtol=1e-12, atol=1e-13)


def test_a_constant_cross_weight_and_the_scale_of_H(problem):
    S = problem["S"][0]
    N = len(problem["A"])
    constant = solve_linear_quadratic(**{**problem, "S": S, "H_scale": 0.5})
    stacked = {**problem, "S": np.tile(S, (N, 1, 1)), "H": 0.5 * problem["H"]}
    np.testing.assert_allclose(constant.K, solve_linear_quadratic(**stacked).K, rtol=1e-12)


def _mechanical(rng, N, nq=5, nr=3):
    """A, B of the shape of a mechanism's: copied rows, differenced rows, unused columns; too large to be small."""
    nx = 2 * (nq + nr)
    A, B = np.zeros((N, nx, nx)), np.zeros((N, nx, nr))
    dense = np.r_[0:nq, nq + nr : 2 * nq + nr]
    A[:, dense, : 2 * nq + nr] = 0.4 * rng.standard_normal((N, dense.size, 2 * nq + nr))
    B[:, dense] = rng.standard_normal((N, dense.size, nr))
    rho, rate, i = nq + np.arange(nr), 2 * nq + nr + np.arange(nr), np.arange(nr)
    B[:, rho, i] = 1.0
    B[:, rate, i], A[:, rate, rho] = 10.0, -10.0
    return A, B


@pytest.mark.parametrize("case", ["mechanical", "changing", "no dense row", "single input", "diagonal weights"])
def test_structure_changes_nothing_but_the_time(case):
    rng = np.random.default_rng(8)
    N = 12
    A, B = _mechanical(rng, N)
    if case == "changing":
        A[3] = rng.standard_normal(A[3].shape)
        B[5, :, :] = 0.0
        A[7, 2] = 0.0
        A[8, :, 1] = 0.0
        B[9, 4], A[9, 4, 6] = 0.0, 2.0
    elif case == "no dense row":
        A[:] = np.eye(A.shape[1])
        B[:] = np.roll(np.eye(A.shape[1]), 1, axis=0)[:, : B.shape[2]]
    elif case == "single input":
        B = np.ascontiguousarray(B[:, :, :1])
    nx, nu = B.shape[1:]
    weights = {
        "Q": _positive(rng, nx),
        "R": _positive(rng, nu),
        "H": 0.005 * _symmetric(rng, N, nx + nu, nx + nu),
        "q": rng.standard_normal((N, nx)),
        "r": rng.standard_normal((N, nu)),
        "c": rng.standard_normal((N, nx)),
        "Q_final": _positive(rng, nx),
        "q_final": rng.standard_normal(nx),
    }
    if case == "diagonal weights":
        # As in an optimisation: nothing couples the last states, the rates, with the others.
        weights |= {"Q": rng.uniform(1, 2, nx), "R": rng.uniform(1, 2, nu)}
        weights["Q_final"] = rng.uniform(1, 2, nx)
        weights["H"][:, nx - 3 : nx] = weights["H"][:, :, nx - 3 : nx] = 0.0
    for without_H in (False, True):
        if without_H:
            del weights["H"]
        dense = solve_linear_quadratic(A, B, **weights, use_structure=False, keep_P=True)
        structured = solve_linear_quadratic(A, B, **weights, keep_P=True)
        assert dense.structured_stages == 0
        assert structured.structured_stages >= N - 1
        for name in ("K", "C", "b", "P"):
            expected = getattr(dense, name)
            scale = np.abs(expected).max()
            np.testing.assert_allclose(getattr(structured, name), expected, atol=1e-12 * scale)
        assert structured.constant == pytest.approx(dense.constant, rel=1e-12)


def _packed(H, pattern):
    """Lower triangles, by rows, of the inputs and the states with entries in their columns."""
    used = [j for j in range(H.shape[1]) if pattern[:, j].any() or j >= len(pattern)]
    return np.stack([[h[i, j] for a, i in enumerate(used) for j in used[: a + 1]] for h in H])


_WEIGHTS = ["diagonal", "per stage", "coupled", "part", "part of what nothing depends on", "part of everything"]


@pytest.mark.parametrize("weights", _WEIGHTS)
@pytest.mark.parametrize("states", ["mechanical", "scattered", "one input", "all"])
def test_what_a_pattern_leaves_out_is_not_read(weights, states):
    rng = np.random.default_rng(9)
    N = 6
    A, B = _mechanical(rng, N)
    nx, nu = B.shape[1:]
    if states == "scattered":
        order = rng.permutation(nx)
        A, B = np.ascontiguousarray(A[:, order][:, :, order]), np.ascontiguousarray(B[:, order])
    elif states == "one input":
        B = np.ascontiguousarray(B[:, :, :1])
    elif states == "all":
        A, B = 0.3 * rng.standard_normal(A.shape), rng.standard_normal(B.shape)
    nu = B.shape[2]
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    unused = np.flatnonzero(~pattern[:, :nx].any(axis=0))
    H = 0.02 * _symmetric(rng, N, nx + nu, nx + nu)
    H[:, unused] = H[:, :, unused] = 0.0
    given = _with_drift(rng, N, nx, nu) | {"keep_P": True}
    if weights == "per stage":
        given |= {"Q": rng.uniform(1, 2, (N, nx, 1)), "R": np.tile(_positive(rng, nu), (N, 1, 1))}
    elif weights == "coupled":
        given |= {"Q": _positive(rng, nx, 5.0), "S": 0.01 * rng.standard_normal((nx, nu))}
    elif weights.startswith("part"):
        places = [j for j in (0, nx // 2, nx - 1, nx) if weights != "part" or j not in unused]
        if weights == "part of everything":
            places = list(range(nx + nu))
        parts = np.stack([_positive(rng, len(places)) for _ in range(N)])
        given |= {"part": (places, parts)}
    # What stands where nothing is read may be anything.
    hidden = [np.where(part, whole, np.nan) for part, whole in ((pattern[:, :nx], A), (pattern[:, nx:], B))]
    blind = H.copy()
    blind[:, unused] = blind[:, :, unused] = np.nan
    for scale, hessians in ((0.0, (None,)), (0.7, (blind, _packed(H, pattern)))):
        expected = solve_linear_quadratic(A, B, **given, H=H, H_scale=scale, use_structure=False)
        assert expected.definite
        for h in hessians:
            found = solve_linear_quadratic(*hidden, **given, H=h, H_scale=scale, pattern=pattern)
            assert found.structured_stages == (0 if states == "all" else N)
            for name in ("K", "C", "b", "P", "P0"):
                size = np.abs(getattr(expected, name)).max()
                np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12 * size)
            assert found.constant == pytest.approx(expected.constant, rel=1e-12)


@pytest.mark.parametrize("weights", _WEIGHTS)
@pytest.mark.parametrize("sizes", [(4, 1), (5, 3), (7, 2), (11, 5), (6, 0)])
def test_small_problems_are_those_of_large_ones(sizes, weights):
    # The same problem beside states that nothing has to do with is not small any more.
    rng = np.random.default_rng(sum(sizes))
    N, (nx, nu), more = 6, sizes, 20
    A, B = 0.5 * rng.standard_normal((N, nx, nx)), rng.standard_normal((N, nx, nu))
    A[:, :, 2] = 0.0  # upon which nothing depends
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    H = 0.02 * _symmetric(rng, N, nx + nu, nx + nu)
    H[:, 2] = H[:, :, 2] = 0.0
    given = _with_drift(rng, N, nx, nu)
    if weights == "per stage":
        given |= {"Q": rng.uniform(1, 2, (N, nx, 1)), "R": np.stack([_positive(rng, nu, 1.0) for _ in range(N)])}
    elif weights == "coupled":
        given |= {"Q": _positive(rng, nx, 5.0), "S": 0.01 * rng.standard_normal((nx, nu))}
    elif weights.startswith("part"):
        places = [0, nx - 1, nx] if weights == "part" else [2, nx - 1]
        places = [j for j in (range(nx + nu) if weights == "part of everything" else places) if j < nx + nu]
        given |= {"part": (places, np.stack([_positive(rng, len(places)) for _ in range(N)]))}
    large = given | {"q": np.pad(given["q"], ((0, 0), (0, more))), "c": np.pad(given["c"], ((0, 0), (0, more)))}
    large |= {"Q_final": np.pad(given["Q_final"], (0, more)), "q_final": np.pad(given["q_final"], (0, more))}
    large["Q"] = np.pad(given["Q"], ((0, 0), (0, more), (0, 0)) if given["Q"].ndim == 3 else (0, more))
    if "S" in given:
        large["S"] = np.pad(given["S"], ((0, more), (0, 0)))
    old = np.r_[:nx, nx + more : nx + more + nu]
    if "part" in given:
        large["part"] = (old[list(given["part"][0])], given["part"][1])
    large_A, large_B = np.zeros((N, nx + more, nx + more)), np.zeros((N, nx + more, nu))
    large_A[:, :nx, :nx], large_B[:, :nx] = A, B
    large_H = np.zeros((N, nx + more + nu, nx + more + nu))
    large_H[:, old[:, None], old] = H
    expected = solve_linear_quadratic(large_A, large_B, **large, H=large_H, H_scale=0.7, keep_P=True)
    assert expected.definite
    hidden = [np.where(part, whole, np.nan) for part, whole in ((pattern[:, :nx], A), (pattern[:, nx:], B))]
    blind = H.copy()
    blind[:, 2] = blind[:, :, 2] = np.nan
    for a, b, h, seen in ((A, B, H, None), (*hidden, blind, pattern), (*hidden, _packed(H, pattern), pattern)):
        found = solve_linear_quadratic(a, b, **given, H=h, H_scale=0.7, pattern=seen, keep_P=True)
        assert (found.definite, found.structured_stages) == (True, 0)
        parts = {"K": expected.K[:, :, :nx], "C": expected.C, "b": expected.b[:, :nx], "P": expected.P[:, :nx, :nx]}
        for name, part in parts.items():
            np.testing.assert_allclose(getattr(found, name), part, atol=1e-12 * np.abs(expected.P).max())
        np.testing.assert_array_equal(found.P, found.P.transpose(0, 2, 1))
        np.testing.assert_array_equal(found.P0, found.P[0])
        assert found.constant == pytest.approx(expected.constant, rel=1e-11)
        dx0, c, gradient = rng.standard_normal(nx), given["c"], (given["q"], given["r"], given["q_final"])
        moved = sweep_forward(a, b, found, dx0, c=c, pattern=seen)
        whole = sweep_forward(large_A, large_B, expected, np.pad(dx0, (0, more)), c=large["c"])
        np.testing.assert_allclose(moved[0], whole[0][:, :nx], atol=1e-12 * np.abs(whole[0]).max())
        np.testing.assert_allclose(moved[1], whole[1], atol=1e-12 * np.abs(whole[0]).max())
        z = adjoint(a, b, found.K, *gradient, pattern=seen)
        whole_z = adjoint(large_A, large_B, expected.K, large["q"], large["r"], large["q_final"])
        np.testing.assert_allclose(z, whole_z[:, :nx], atol=1e-12 * np.abs(whole_z).max())


@pytest.mark.parametrize("nu", [1, 4])
def test_small_problems_name_the_stage_that_has_no_minimum(nu):
    rng = np.random.default_rng(nu)
    A, B = 0.5 * rng.standard_normal((5, 6, 6)), rng.standard_normal((5, 6, nu))
    R = np.ones((5, nu, 1))
    R[2] = -50.0
    given = {"A": A, "B": B, "Q": np.ones(6), "R": R, "Q_final": np.ones(6)}
    small, large = solve_linear_quadratic(**given), solve_linear_quadratic(**given, regularize="stage")
    assert (small.definite, small.stage, large.stage) == (False, 2, 2)
    assert small.smallest_eigenvalue == pytest.approx(large.smallest_eigenvalue, rel=1e-9)
    assert np.isnan(small.K[:3]).all()
    assert np.isfinite(small.K[3:]).all()
    given["A"] = np.where(np.arange(5)[:, None, None] == 1, np.nan, A)
    with pytest.raises(ArgumentError, match="met at stage 1"):
        solve_linear_quadratic(**given | {"R": np.ones(nu)})


def test_a_pattern_serves_what_is_made_convex():
    rng = np.random.default_rng(10)
    A, B = _mechanical(rng, 8)
    nx, nu = B.shape[1:]
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    H = np.zeros((8, nx + nu, nx + nu))
    H[5] -= np.diag(np.where(np.arange(nx + nu) < 4, 300.0, 0.0))
    H[2] -= np.diag(np.where(np.arange(nx + nu) >= nx, 300.0, 0.0))
    given = {"A": A, "B": B, "Q": np.ones(nx), "R": np.ones(nu), "Q_final": np.ones(nx), "q": rng.normal(size=(8, nx))}
    assert not solve_linear_quadratic(**given, H=H, pattern=pattern).definite
    expected = solve_linear_quadratic(**given, H=H, regularize="stage")
    assert expected.regularized_stages >= 1
    for h in (H, _packed(H, pattern)):
        found = solve_linear_quadratic(**given, H=h, regularize="stage", pattern=pattern)
        assert (found.stage, found.regularized_stages) == (expected.stage, expected.regularized_stages)
        np.testing.assert_allclose(found.P0, expected.P0, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.K, expected.K, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("in_part", range(1, 7))
def test_a_part_may_couple_some_of_what_nothing_depends_on(in_part):
    # The model then holds them before the others: every number of them stands elsewhere in packets of any width.
    rng = np.random.default_rng(in_part)
    A, B = _mechanical(rng, 9, nq=5, nr=6)
    N, nx, nu = B.shape
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    unused = np.flatnonzero(~pattern[:, :nx].any(axis=0))
    assert len(unused) == 6
    # Dense rows too, such as those of multipliers.
    used = np.setdiff1d(np.arange(nx), unused)
    A[:, unused[:2, None], used], B[:, unused[:2]] = rng.normal(size=(N, 2, len(used))), rng.normal(size=(N, 2, nu))
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    places = np.sort(np.r_[rng.choice(unused, in_part, replace=False), 2, nx + 1])
    H = 0.02 * _symmetric(rng, N, nx + nu, nx + nu)
    H[:, unused] = H[:, :, unused] = 0.0
    given = {
        "Q": rng.uniform(1, 2, nx),
        "R": rng.uniform(1, 2, nu),
        "part": (places, np.stack([_positive(rng, len(places)) for _ in range(N)])),
        "q": rng.standard_normal((N, nx)),
        "c": rng.standard_normal((N, nx)),
        "Q_final": rng.uniform(1, 2, nx),
        "keep_P": True,
    }
    expected = solve_linear_quadratic(A, B, **given, H=H, use_structure=False)
    hidden = [np.where(part, whole, np.nan) for part, whole in ((pattern[:, :nx], A), (pattern[:, nx:], B))]
    found = solve_linear_quadratic(*hidden, **given, H=_packed(H, pattern), pattern=pattern)
    for name in ("K", "C", "b", "P"):
        size = np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12 * size)
    for each, dynamics in ((expected, (A, B)), (found, hidden)):
        swept = sweep_forward(*dynamics, each, given["q"][0], c=given["c"], pattern=pattern)
        wanted = _roll({"A": A, "B": B, "c": given["c"]}, expected, given["q"][0])
        for one, other in zip(swept, wanted, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-11 * np.abs(other).max())


@pytest.mark.parametrize("cost", ["nothing", "weight", "weight at one stage", "gradient", "final", "part"])
def test_states_that_nothing_depends_on_and_that_cost_nothing_are_not_read(cost):
    rng = np.random.default_rng(13)
    A, B = _mechanical(rng, 7)
    N, nx, nu = B.shape
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    idle = np.flatnonzero(~pattern[:, :nx].any(axis=0))[1]
    pattern[idle] = pattern.any(axis=0)  # as of a multiplier
    A[:, idle], B[:, idle] = rng.normal(size=(N, nx)) * pattern[idle, :nx], rng.normal(size=(N, nu))
    Q, q, final = np.tile(rng.uniform(1, 2, (nx, 1)), (N, 1, 1)), rng.normal(size=(N, nx)), _positive(rng, nx)
    Q[:, idle] = q[:, idle] = final[idle] = final[:, idle] = 0.0
    given = {"R": np.ones(nu), "Q": Q, "q": q, "Q_final": final, "c": rng.normal(size=(N, nx)), "keep_P": True}
    if cost == "weight":
        Q[:, idle] = 2.0
    elif cost == "weight at one stage":
        Q[3, idle] = 2.0
    elif cost == "gradient":
        q[2, idle] = 2.0
    elif cost == "final":
        final[idle, idle] = 2.0
    elif cost == "part":
        given["part"] = [idle], np.tile(2.0, (N, 1, 1))
    expected = solve_linear_quadratic(A, B, **given, use_structure=False)
    if cost in ("nothing", "final"):
        A[:-1, idle] = B[:-1, idle] = np.nan
    found = solve_linear_quadratic(A, B, **given, pattern=pattern)
    for name in ("K", "C", "b", "P"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-10, atol=1e-10)


def test_a_part_that_is_no_number_is_met():
    rng = np.random.default_rng(14)
    A, B = _mechanical(rng, 5)
    nx, nu = B.shape[1:]
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    for stage in range(5):
        matrices = np.zeros((5, 2, 2))
        matrices[stage, 1, 0] = np.nan
        with pytest.raises(ArgumentError, match=f"met at stage {stage}"):
            solve_linear_quadratic(A, B, R=np.ones(nu), part=([nx - 2, nx - 1], matrices), pattern=pattern)


@pytest.mark.parametrize("regularize", [False, True])
def test_a_part_may_couple_what_nothing_depends_on_where_stages_are_made_convex(regularize):
    rng = np.random.default_rng(11)
    A, B = _mechanical(rng, 8)
    N, nx, nu = B.shape
    pattern = np.any(np.concatenate([A, B], axis=2) != 0.0, axis=0)
    H = np.zeros((N, nx + nu, nx + nu))
    if regularize:
        H[5] -= np.diag(np.where(np.arange(nx + nu) < 4, 300.0, 0.0))
    places = [0, nx - 2, nx - 1]
    given = {"A": A, "B": B, "Q": np.ones(nx), "R": np.ones(nu), "Q_final": _positive(rng, nx), "regularize": "stage"}
    given |= {"q": rng.normal(size=(N, nx)), "part": (places, np.stack([_positive(rng, 3) for _ in range(N)]))}
    expected = solve_linear_quadratic(**given, H=H, use_structure=False)
    assert (expected.regularized_stages > 0) == regularize
    found = solve_linear_quadratic(**given, H=_packed(H, pattern), pattern=pattern)
    assert (found.stage, found.regularized_stages) == (expected.stage, expected.regularized_stages)
    for name in ("K", "C", "b", "P0"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("pattern", [np.ones((5, 7), dtype=bool), np.ones((5, 8)), "all"])
def test_a_wrong_pattern_is_refused(problem, pattern):
    with pytest.raises(ArgumentError, match=r"pattern: got .*expected bool of shape \(5, 8\)"):
        solve_linear_quadratic(**problem, pattern=pattern)


def test_packed_hessians_need_a_pattern(problem):
    packed = {**problem, "H": np.zeros((7, 36))}
    with pytest.raises(ArgumentError, match="H: got shape"):
        solve_linear_quadratic(**packed)
    assert solve_linear_quadratic(**packed, pattern=np.ones((5, 8), dtype=bool)).definite
    with pytest.raises(ArgumentError, match="H: got shape"):
        solve_linear_quadratic(**packed, pattern=np.arange(8) != np.full((5, 1), 3))


def test_one_state_and_one_input_read_nothing_behind_them():
    values = np.arange(1.0, 6.0)
    B = values[:4].reshape(4, 1, 1)  # behind whose last entry there is another number
    given = {"Q": np.ones(1), "R": np.ones(1), "regularize": "stage"}  # which is never a small problem
    assert solve_linear_quadratic(np.ones((4, 1, 1)), B, **given).structured_stages == 4


def test_large_enough_for_several_panels():
    rng = np.random.default_rng(2)
    A, B = _mechanical(rng, 6, nq=22, nr=18)
    nx, nu = B.shape[1:]
    assert (nx, nu) == (80, 18)
    structured = solve_linear_quadratic(A, B, Q=np.ones(nx), R=np.ones(nu), Q_final=np.ones(nx))
    P = np.eye(nx)
    for k in range(5, -1, -1):
        gamma = np.eye(nu) + B[k].T @ P @ B[k]
        K = np.linalg.solve(gamma, B[k].T @ P @ A[k])
        P = np.eye(nx) + A[k].T @ P @ A[k] - K.T @ gamma @ K
    np.testing.assert_allclose(structured.P0, P, atol=1e-11 * np.abs(P).max())


@pytest.mark.parametrize("nu", [1, 2, 3, 4, 5, 6, 7, 8, 9, 18])
@pytest.mark.parametrize("columns", ["all", "some"])
def test_every_stage_to_rounding_in_any_size(nu, columns):
    """Products are summed in tiles of a few packets and columns, and each size ends in others."""
    rng = np.random.default_rng(nu)
    N = 2
    for nx in range(1, 43):
        A, B = rng.standard_normal((N, nx, nx)) / np.sqrt(nx), rng.standard_normal((N, nx, nu)) / np.sqrt(nx)
        if columns == "some":
            A[:, :, nx // 2 :: 5] = 0.0
            A[:, nx // 3 : nx // 2] = 0.0
        Q, R = _positive(rng, nx, 1.0), _positive(rng, nu, 1.0)
        q, r, c = rng.standard_normal((N, nx)), rng.standard_normal((N, nu)), rng.standard_normal((N, nx))
        found = solve_linear_quadratic(A, B, Q=Q, R=R, q=q, r=r, c=c, Q_final=Q, q_final=q[0], keep_P=True)
        for k in range(N):
            P, b = found.P[k + 1].astype(np.longdouble), found.b[k + 1].astype(np.longdouble)
            K, C = found.K[k].astype(np.longdouble), found.C[k].astype(np.longdouble)
            PA, PB, shifted = P @ A[k], P @ B[k], b + P @ c[k]
            gamma, coupling, h_u = R + B[k].T @ PB, B[k].T @ PA, r[k] + B[k].T @ shifted
            close = {"rtol": 0.0, "atol": 1e-14 * float(np.abs(P).max() + np.abs(b).max()) * (nx + nu)}
            np.testing.assert_allclose(gamma @ K, coupling, **close)
            np.testing.assert_allclose(gamma @ C, h_u, **close)
            np.testing.assert_allclose(found.P[k], Q + A[k].T @ PA - K.T @ coupling, **close)
            np.testing.assert_allclose(found.b[k], q[k] + A[k].T @ shifted - K.T @ h_u, **close)


def test_an_indefinite_stage_is_reported(problem):
    R = problem["R"].copy()
    R[4] -= 100.0 * np.eye(3)
    solution = solve_linear_quadratic(**{**problem, "R": R})
    assert not solution.definite
    assert solution.stage == 4
    P = solve_linear_quadratic(**problem, keep_P=True).P[5]
    B = problem["B"][4]
    gamma = R[4] + problem["H"][4][5:, 5:] + B.T @ P @ B
    assert solution.smallest_eigenvalue == pytest.approx(np.linalg.eigvalsh(gamma)[0], rel=1e-10)
    assert "stage 4" in solution.message
    assert np.isnan(solution.K[:5]).all()
    assert np.isnan(solution.P0).all()
    assert np.isfinite(solution.K[5:]).all()


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_inputs_may_be_of_any_units(problem, unit):
    """What is definite is so in every unit, and the minimum is the same."""
    scale = np.array([unit, 1.0, 1.0 / unit])
    other = dict(problem)
    other["B"], other["S"], other["r"] = problem["B"] * scale, problem["S"] * scale, problem["r"] * scale
    other["R"] = problem["R"] * scale * scale[:, None]
    both = np.concatenate([np.ones(problem["A"].shape[1]), scale])
    other["H"] = problem["H"] * both * both[:, None]
    solution, same = solve_linear_quadratic(**problem), solve_linear_quadratic(**other)
    assert same.definite
    np.testing.assert_allclose(same.P0, solution.P0, rtol=1e-9)
    np.testing.assert_allclose(same.K * scale[:, None], solution.K, rtol=1e-6, atol=1e-9)


def test_an_indefinite_stage_can_be_made_convex(problem):
    H = problem["H"].copy()
    H[4] -= 300.0 * np.eye(8)
    H[2] -= 300.0 * np.eye(8)
    indefinite = {**problem, "H": H}
    assert not solve_linear_quadratic(**indefinite).definite
    solution = solve_linear_quadratic(**indefinite, regularize="stage", keep_P=True)
    assert solution.definite
    assert solution.regularized_stages >= 1
    assert solution.stage == 4
    assert np.isfinite(solution.K).all()
    # From such a stage on, the recursion is that of the cost alone on the positive part of P.
    P, A, B = solution.P[5], problem["A"][4], problem["B"][4]
    values, vectors = np.linalg.eigh(P)
    P = vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T
    gain = np.linalg.solve(problem["R"][4] + B.T @ P @ B, B.T @ P @ A + problem["S"][4].T)
    np.testing.assert_allclose(solution.K[4], gain, rtol=1e-9)


def test_the_convex_problem_is_one_that_can_be_stated(problem):
    """It is the given one without that stage's H and with the removed part of P as a state weight."""
    problem["H"][4] -= 300.0 * np.eye(8)
    solution = solve_linear_quadratic(**problem, regularize="stage", keep_P=True)
    assert solution.regularized_stages == 1
    P = solution.P[5]
    values, vectors = np.linalg.eigh(P)
    removed = vectors @ np.diag(np.maximum(-values, 0.0)) @ vectors.T
    stated = {**problem, "Q": problem["Q"].copy(), "H": problem["H"].copy()}
    stated["H"][4] = 0.0
    stated["Q"][5] += removed
    expected = solve_linear_quadratic(**stated)
    assert expected.definite
    for name in ("K", "C", "P0", "constant"):
        np.testing.assert_allclose(getattr(solution, name), getattr(expected, name), rtol=1e-9, atol=1e-9)


def test_a_negative_input_weight_cannot_be_made_convex(problem):
    R = problem["R"].copy()
    R[4] -= 1e4 * np.eye(3)
    solution = solve_linear_quadratic(**{**problem, "R": R}, regularize="stage")
    assert not solution.definite
    assert solution.stage == 4


@pytest.mark.parametrize("name", ["A", "B", "H"])
def test_what_is_not_finite_is_named_by_stage(problem, name):
    problem[name][3, 1, 0] = np.nan
    if name == "H":
        problem[name][3, 0, 1] = np.nan
    with pytest.raises(ArgumentError, match="stage 3"):
        solve_linear_quadratic(**problem)


@pytest.mark.parametrize("name", ["q", "r", "c", "Q", "R", "S", "Q_final", "q_final"])
def test_small_arrays_are_checked_at_once(problem, name):
    problem[name] = problem[name].copy()
    problem[name].flat[1] = np.inf
    with pytest.raises(ArgumentError, match=rf"{name}: got inf"):
        solve_linear_quadratic(**problem)


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("A", (7, 5, 4)),
        ("A", (5, 5)),
        ("B", (6, 5, 3)),
        ("B", (7, 5, 0)),
        ("Q", (4,)),
        ("Q", (7, 5)),
        ("R", (2, 2)),
        ("S", (3, 5)),
        ("H", (7, 5, 5)),
        ("q", (8, 5)),
        ("r", (7, 5)),
        ("c", (7,)),
        ("Q_final", (7, 5, 5)),
        ("q_final", (1, 5)),
    ],
)
def test_wrong_shapes(problem, name, shape):
    problem[name] = np.ones(shape)
    with pytest.raises(ArgumentError, match="got shape"):
        solve_linear_quadratic(**problem)


def test_wrong_choices(problem):
    with pytest.raises(ArgumentError, match="'none' or 'stage'"):
        solve_linear_quadratic(**problem, regularize="always")
    with pytest.raises(ArgumentError, match="array of numbers"):
        solve_linear_quadratic(**{**problem, "Q": "heavy"})


def test_the_regulator_stabilises():
    A = np.array([[1.0, 0.1], [0.5, 1.0]])
    B = np.array([[0.0], [0.1]])
    assert np.abs(np.linalg.eigvals(A)).max() > 1.1
    N = 200
    K = regulate(np.tile(A, (N, 1, 1)), np.tile(B, (N, 1, 1)))
    assert np.abs(np.linalg.eigvals(A - B @ K[0])).max() < 1.0
    per_stage = regulate(np.tile(A, (N, 1, 1)), np.tile(B, (N, 1, 1)), Q=np.ones((N, 2, 1)), R=np.eye(1))
    np.testing.assert_allclose(per_stage, K, rtol=1e-12)
    with pytest.raises(ArgumentError, match="no regulator"):
        regulate(np.tile(A, (N, 1, 1)), np.tile(B, (N, 1, 1)), R=-np.eye(1))


# ---- A part of the Hessian by a few entries --------------------------------------------------------


@pytest.mark.parametrize("columns", [[], [2], [0, 3, 4], [5, 7], [1, 4, 6, 7], list(range(8))])
def test_a_part_by_some_entries_is_what_a_whole_matrix_with_zeros_is(problem, columns):
    rng = np.random.default_rng(4)
    matrices = 0.1 * _symmetric(rng, 7, len(columns), len(columns))
    whole = problem["H"].copy()
    whole[:, np.array(columns, int)[:, None], np.array(columns, int)] += matrices
    expected = solve_linear_quadratic(**problem | {"H": whole})
    found = solve_linear_quadratic(**problem, part=(columns, matrices))
    assert found.definite
    np.testing.assert_allclose(found.K, expected.K, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.b, expected.b, rtol=1e-12, atol=1e-12)
    half = solve_linear_quadratic(**problem, H_scale=0.5, part=(columns, matrices))
    expected = solve_linear_quadratic(**problem | {"H": 0.5 * problem["H"] + whole - problem["H"]})
    np.testing.assert_allclose(half.K, expected.K, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("columns", [[0, 8], [-1, 2], [3, 2], [2, 2], [[0, 1]]])
def test_the_places_of_a_part_are_looked_at(problem, columns):
    with pytest.raises(ArgumentError, match="part: got the places"):
        solve_linear_quadratic(**problem, part=(columns, np.zeros((7, 2, 2))))
    with pytest.raises(ArgumentError, match="part: got shape"):
        solve_linear_quadratic(**problem, part=([0, 1], np.zeros((7, 3, 3))))


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_models_with_a_part_are_mixed_and_shifted_as_whole_matrices(share):
    rng = np.random.default_rng(5)
    N, nx, nu, columns = 4, 3, 2, np.array([0, 2, 3])

    def model(crossed):
        S = rng.normal(size=(N, nx, nu)) if crossed else None
        part = HessianPart(columns, _symmetric(rng, N, 3, 3))
        return ModelHessian(rng.uniform(1.0, 2.0, (N, nx, 1)), np.ones(nu), S, np.ones(nx), part)

    def whole(hessian):
        H = np.zeros((N, nx + nu, nx + nu))
        H[:, :nx, :nx] = matrix_of(np.broadcast_to(hessian.Q, (N, nx, 1)))
        H[:, nx:, nx:] = matrix_of(hessian.R)
        if hessian.S is not None:
            H[:, :nx, nx:] += hessian.S
            H[:, nx:, :nx] += hessian.S.transpose(0, 2, 1)
        H[:, columns[:, None], columns] += hessian.part.matrices
        return H

    for low, high in ((model(False), model(True)), (model(True), model(False)), (model(False), model(False))):
        mixed = between(low, high, share)
        np.testing.assert_allclose(whole(mixed), (1.0 - share) * whole(low) + share * whole(high), atol=1e-14)
        more = whole(shifted(mixed, 0.1)) - whole(mixed)
        amount = more[0, 0, 0]
        assert amount > 0.1 * np.abs(mixed.part.matrices).max(initial=0.0) / (4.0 * nx)
        np.testing.assert_allclose(more, np.broadcast_to(amount * np.eye(nx + nu), more.shape), atol=1e-14)


def test_a_model_takes_weights_that_are_no_arrays_of_the_core_and_names_those_of_a_wrong_shape() -> None:
    """Costs of users give them: single precision, lists, Fortran's order."""
    rng = np.random.default_rng(8)
    N, nx, nu = 6, 3, 2
    linearization = Linearization(rng.normal(size=(N, nx, nx)), rng.normal(size=(N, nx, nu)))
    gradient = CostGradient(rng.normal(size=(N, nx)), rng.normal(size=(N, nu)), rng.normal(size=nx))
    M = rng.normal(size=(N, nx, nx))
    Q = np.round(M @ M.transpose(0, 2, 1), 3).astype(np.float32)
    expected = None
    for given in (Q.astype(float), Q, Q.tolist(), np.asfortranarray(Q)):
        hessian = ModelHessian(given, np.ones(nu), None, np.eye(nx))
        model = minimise_model("quasi-newton", linearization, gradient, hessian, None, Workspace(N, nx, nu))
        expected = model.K if expected is None else expected
        np.testing.assert_array_equal(model.K, expected)
    wrong = ModelHessian(np.ones(nx + 1), np.ones(nu), None, np.eye(nx))
    with pytest.raises(ArgumentError, match=r"Q: got .*shape \(4,\)"):
        minimise_model("quasi-newton", linearization, gradient, wrong, None, Workspace(N, nx, nu))
