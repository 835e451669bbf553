"""The midpoint step and its derivatives against implicit differentiation of an independent step."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

pytest.importorskip("jax")

from derivatives.random_tree import StepProblem, random_tree, step_problem
from leastaction.mechanics import MidpointVI, State, Trajectory
from oracles import lagrangian as oracle

# Random starts fling some trees about so fast that no step exists; these seeds have one.
SEEDS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12)
SPLITS = ("symmetric", "left")
FIRST, SECOND = 1e-12, 1e-10


@cache
def problem(seed: int) -> StepProblem:
    # Steps of different lengths; every third tree runs without its constraints.
    tree = random_tree(seed)
    dt = (0.01, 0.004, 0.02)[seed % 3]
    return step_problem(tree.without_constraints() if seed % 3 == 2 else tree, seed, dt=dt)


@cache
def ours(seed: int, split: str) -> tuple[MidpointVI, Trajectory]:
    p = problem(seed)
    vi = MidpointVI(p.tree.mechanism(), split=split, threads=1)
    start = State(0.0, p.q, p.p, p.v_rho)
    run = vi.simulate(start, [0.0, p.dt], inputs=p.inputs, rho=p.rho_next)
    assert run.steps == 1, run.message
    return vi, run


@cache
def theirs(seed: int, split: str) -> dict[str, np.ndarray]:
    """Return the oracle's solution and its derivatives by ``[x; u]``: of q2 and p2 in ``x``, of lam."""
    p = problem(seed)
    vi, run = ours(seed, split)
    m, tree = vi.mechanism, p.tree
    ny, d = m.nd + m.nc, oracle.data_of(tree)
    kappas = (p.dt, 0.0) if split == "left" else (p.dt / 2, p.dt / 2)
    step = np.array([p.dt, *kappas])
    th = np.concatenate([p.q, p.p, p.inputs, p.rho_next])
    y = np.concatenate([run.q[1, : m.nd], run.lam[0]])
    for _ in range(3):  # its own Newton iterations, to rounding
        values = [np.asarray(a) for a in oracle.step_derivatives(d, m.nd, step, y, th)]
        y = y - np.linalg.solve(values[1][:ny, :ny], values[0][:ny])
    values = [np.asarray(a) for a in oracle.step_derivatives(d, m.nd, step, y, th)]
    first, second = oracle.differentiate_implicitly(values, m.nd, ny)
    # th = [q1; p1; u; rho2] is [x; u] without v_rho, which no step depends on.
    at = np.r_[: m.nq + m.nd, m.nx : m.nx + m.nu + m.nrho]
    n = m.nx + m.nu + m.nrho
    full1, full2 = np.zeros((ny + m.nd, n)), np.zeros((ny + m.nd, n, n))
    full1[:, at] = first
    full2[:, at[:, None], at] = second
    x1, x2 = np.zeros((m.nx, n)), np.zeros((m.nx, n, n))
    x1[: m.nd], x2[: m.nd] = full1[: m.nd], full2[: m.nd]
    x1[m.nq : m.nq + m.nd], x2[m.nq : m.nq + m.nd] = full1[ny:], full2[ny:]
    # rho+ = rho_next, v_rho+ = (rho_next - rho) / dt
    eye = np.eye(m.nrho)
    x1[m.nd : m.nq, m.nx + m.nu :] = eye
    x1[m.nq + m.nd :, m.nx + m.nu :] = eye / p.dt
    x1[m.nq + m.nd :, m.nd : m.nq] = -eye / p.dt
    return {
        "q": y[: m.nd],
        "lam": y[m.nd :],
        "p": values[0][ny:],
        "x": x1,
        "x2": x2,
        "lam1": full1[m.nd : ny],
        "lam2": full2[m.nd : ny],
    }


def relative(a: np.ndarray, b: np.ndarray) -> float:
    assert a.shape == b.shape
    if not b.size:
        return 0.0
    assert np.abs(b).max() > 1e-6, "nothing is compared with nothing"
    return float(np.abs(a - b).max() / np.abs(b).max())


def rows(vi: MidpointVI) -> dict[str, slice]:
    m = vi.mechanism
    return {
        "q": slice(0, m.nd),
        "rho": slice(m.nd, m.nq),
        "p": slice(m.nq, m.nq + m.nd),
        "v_rho": slice(m.nq + m.nd, m.nx),
    }


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("seed", SEEDS)
def test_step(seed: int, split: str) -> None:
    vi, run = ours(seed, split)
    wanted, nd = theirs(seed, split), vi.mechanism.nd
    assert relative(run.q[1, :nd], wanted["q"]) < 1e-12
    assert relative(run.p[1], wanted["p"]) < 1e-11
    assert relative(run.lam[0], wanted["lam"]) < 1e-9  # what the tolerance of 1e-13 leaves of it


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("seed", SEEDS)
def test_first_derivatives(seed: int, split: str) -> None:
    vi, run = ours(seed, split)
    wanted = theirs(seed, split)
    d = vi.linearize(run, multipliers=True)
    AB = np.concatenate([d.A, d.B], axis=2)[0]
    for name, at in rows(vi).items():
        assert relative(AB[at], wanted["x"][at]) < FIRST, name
    lam = np.concatenate([d.lam_dx, d.lam_du], axis=2)[0]
    assert relative(lam, wanted["lam1"]) < FIRST
    if vi.mechanism.nc:
        assert relative(d.lam[0], wanted["lam"]) < 1e-9


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("seed", SEEDS)
def test_second_derivatives(seed: int, split: str) -> None:
    vi, run = ours(seed, split)
    wanted = theirs(seed, split)
    full = vi.tensors(run, 0)
    for name, at in rows(vi).items():
        if name in ("q", "p"):
            assert relative(full.x[at], wanted["x2"][at]) < SECOND, name
        else:
            assert not full.x[at].any()
    assert relative(full.lam, wanted["lam2"]) < SECOND


@pytest.mark.parametrize("seed", SEEDS)
def test_contracted_second_derivatives(seed: int) -> None:
    vi, run = ours(seed, "symmetric")
    wanted, m = theirs(seed, "symmetric"), vi.mechanism
    rng = np.random.default_rng(seed)
    z, z_lam = rng.standard_normal(m.nx), rng.standard_normal(m.nc)
    H = vi.curvature(run, vi.linearize(run), z[None], z_lam=z_lam[None])[0]
    contraction = np.tensordot(z, wanted["x2"], 1) + np.tensordot(z_lam, wanted["lam2"], 1)
    assert relative(H, contraction) < SECOND


def test_oracle_is_not_blind() -> None:
    """The comparison sees one part in 1e9 of one inertia, and the two splits apart."""
    assert relative(theirs(0, "left")["x"], theirs(0, "symmetric")["x"]) > 1e-6
    vi, run = ours(0, "symmetric")
    wanted = theirs(0, "symmetric")
    A = vi.linearize(run).A[0].copy()
    at = np.unravel_index(np.abs(A).argmax(), A.shape)
    A[at] *= 1 + 1e-9
    assert relative(A, wanted["x"][:, : len(A)]) > FIRST
