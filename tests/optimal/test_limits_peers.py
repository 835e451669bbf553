"""Optima within limits against solvers that know nothing of this one: dense quadratic programs, and Ipopt."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.optimal import Bound, Equal, LinearSystem, QuadraticCost, optimize

casadi = pytest.importorskip("casadi", reason="an oracle of `make test ORACLES=1`")


@pytest.mark.parametrize("seed", range(4))
def test_convex_problems_agree_with_a_dense_quadratic_program(seed: int) -> None:
    rng = np.random.default_rng(seed)
    N, nx, nu = 25, 4, 2
    A = np.eye(nx) + 0.1 * rng.normal(size=(N, nx, nx))
    B = 0.2 * rng.normal(size=(N, nx, nu))
    system = LinearSystem(A, B)
    Q, R, Q_final = rng.uniform(0.1, 1.0, nx), rng.uniform(0.1, 1.0, nu), rng.uniform(1.0, 5.0, nx)
    cost = QuadraticCost(rng.normal(size=(N + 1, nx)), rng.normal(size=(N, nu)), Q=Q, R=R, Q_final=Q_final)
    x0 = rng.normal(size=nx)
    free = optimize(system, cost, initial=(x0, np.zeros((N, nu))))
    most = 0.5 * np.abs(free.u).max()
    high = 0.7 * free.x[1:, 1].max() + 0.3 * free.x[1:, 1].min()
    end = free.x[-1, 0] + 0.1
    limits = [Bound("u*", -most, most), Bound("x[1]", max=np.full(N, high)), Equal("x[0]", end)]

    # All states as linear functions of all inputs.
    map_u, offset = [np.zeros((nx, N * nu))], [x0]
    for k in range(N):
        step = A[k] @ map_u[-1]
        step[:, k * nu : (k + 1) * nu] += B[k]
        map_u.append(step)
        offset.append(A[k] @ offset[-1])
    weights = np.concatenate([np.tile(Q, N), Q_final])
    S, s = np.vstack(map_u), np.concatenate(offset) - cost.x_wanted.ravel()
    H = S.T @ (weights[:, None] * S) + np.diag(np.tile(R, N))
    g = S.T @ (weights * s) - np.tile(R, N) * cost.u_wanted.ravel()
    rows = np.vstack([*(m[1] for m in map_u[1:]), map_u[-1][0]])
    upper = np.array([*(high - o[1] for o in offset[1:]), end - offset[-1][0]])
    lower = np.full(N + 1, -np.inf)
    lower[-1] = upper[-1]
    solver = casadi.conic(
        "s",
        "qrqp",
        {"h": casadi.Sparsity.dense(*H.shape), "a": casadi.Sparsity.dense(*rows.shape)},
        {"print_iter": False, "print_header": False, "print_info": False},
    )
    found = np.array(solver(h=H, g=g, a=rows, lba=lower, uba=upper, lbx=-most, ubx=most)["x"]).reshape(N, nu)

    result = optimize(system, cost, initial=(x0, np.zeros((N, nu))), limits=limits, tolerance=1e-12)
    assert result.success, result.message
    assert (np.abs(found) > 0.999 * most).any()
    np.testing.assert_allclose(result.u, found, atol=1e-7)


@pytest.mark.parametrize(
    "name",
    [
        "cart, swing-up, place at most 50 %",
        "cart, tracking, push at most 70 %",
        "quadrotor, flight, thrusts at most 70 %",
    ],
)
def test_nonlinear_problems_agree_with_ipopt(name: str) -> None:
    from benchmarks import limits  # asks for CasADi

    row = limits.compare(next(case for case in limits.CASES if case.name == name), rounds=1, compiled=False)
    assert row.our_status == "CONVERGED"
    assert row.ipopt_status == "Solve_Succeeded"
    assert abs(row.better) < 1e-7


@pytest.mark.parametrize(
    "name",
    [
        "planar arm of 4, reaching between 3 obstacles",
        "puppet's arm of 3, strings pull by 1.5 N",
        "slider-crank, half a turn, reactions to 12 N",
        "chain of 6, swings for ever, torques bounded",
        pytest.param("arm of 7, reaching between 3 obstacles", marks=pytest.mark.slow),
        pytest.param("marionette, walk, tensions 30 % of mean", marks=pytest.mark.slow),
        pytest.param("lift of 3 segments, reactions to 100 N", marks=pytest.mark.slow),
        pytest.param("hand, 25 tendons that only pull", marks=pytest.mark.slow),
    ],
)
def test_obstacles_strings_reactions_and_gaits_agree_with_ipopt(name: str) -> None:
    from benchmarks import limits_further  # asks for CasADi

    case = next(case for case in limits_further.CASES if case.name == name)
    row = limits_further.compare(case, rounds=1, compiled=False, tolerance=1e-9)
    if "obstacles" in name and not abs(row.better) < 1e-7:
        # There are many minima, by which instants touch them: then both go on from each other's.
        row = limits_further.compare(case, rounds=1, compiled=False, tolerance=1e-9, meet=True)
    assert row.our_status == "CONVERGED"
    assert row.ipopt_status == "Solve_Succeeded"
    assert abs(row.better) < 1e-7


@pytest.mark.parametrize("case", range(4))
def test_continuous_problems_agree_with_ipopt_on_the_same_mesh(case: int) -> None:
    from benchmarks import limits_continuous  # asks for CasADi

    row = limits_continuous.compare(limits_continuous.cases()[case], rounds=1)
    assert row.our_status in ("CONVERGED", "STALLED")
    assert row.ipopt_status == "Solve_Succeeded"
    assert abs(row.better) < 1e-7
