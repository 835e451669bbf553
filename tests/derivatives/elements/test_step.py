"""A step with every element type, and its first two derivatives, against implicit differentiation of the oracle's.

The start is on the constraints and in motion; prescribed variables go on nearly as they were. Both splits of forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from derivatives.elements.cases import CASES, Case, problem
from derivatives.elements.checks import every, oracle_of
from leastaction.mechanics import MidpointVI, State, Trajectory
from oracles import lagrangian as implicit
from oracles.step_oracle import Orders, shape_of, step_orders, step_residuals

DT = 0.01
SPLITS = ("symmetric", "left")
# First derivatives, second ones, relative to the largest entry of each block.
A_AND_B, CURVATURE = 1e-10, 1e-8


@dataclass(frozen=True)
class Solved:
    """A step of the package, and the oracle's: where its residuals vanish, and their derivatives there."""

    vi: MidpointVI
    run: Trajectory
    z: np.ndarray
    orders: Orders
    residual: float  # of the package's solution, relative to the terms


@cache
def solved(name: str, seed: int, split: str) -> Solved:
    p, oracle = problem(name, seed), oracle_of(name, seed)
    m = p.mechanism
    rng = np.random.default_rng([seed, 5])
    v = rng.uniform(-1.0, 1.0, m.nq)
    Dh = m.constraint_jacobian(p.q)
    v[: m.nd] -= np.linalg.lstsq(Dh[:, : m.nd], Dh @ v, rcond=None)[0]
    momentum = m.momentum(p.q, v)[: m.nd] + 0.1 * rng.uniform(-1.0, 1.0, m.nd)
    u = rng.uniform(0.5, 2.0, m.nu)
    rho = (p.q + DT * v)[m.nd :] + 0.3 * DT**2 * rng.uniform(-1.0, 1.0, m.nrho)
    vi = MidpointVI(m, split=split, threads=1)
    start = State(0.0, p.q, momentum, v[m.nd :])
    run = vi.simulate(start, [0.0, DT], inputs=u, rho=rho)
    assert run.steps == 1, run.message
    s = shape_of(oracle)
    z = np.concatenate([run.q[1, : m.nd], run.lam[0], p.q, momentum, u, rho])
    orders = step_orders(oracle, DT, split, z)
    residual = float(np.abs(orders[0][: s.ny]).max() / np.abs(momentum).max())
    for _ in range(2):  # its own Newton iterations, to rounding
        z[: s.ny] -= np.linalg.solve(orders[1][: s.ny, : s.ny], orders[0][: s.ny])
        orders = step_orders(oracle, DT, split, z)
    return Solved(vi, run, z, orders, residual)


@cache
def wanted(name: str, seed: int, split: str) -> dict[str, np.ndarray]:
    """Return the derivatives by ``[x; u]`` of the next q and p, and of lam."""
    made = solved(name, seed, split)
    m = made.vi.mechanism
    ny = m.nd + m.nc
    first, second = implicit.differentiate_implicitly(made.orders, m.nd, ny)
    # th = [q1; p1; u; rho2] is [x; u] without v_rho, which no step depends on.
    at = np.r_[: m.nq + m.nd, m.nx : m.nx + m.nu + m.nrho]
    n = m.nx + m.nu + m.nrho
    one, two = np.zeros((ny + m.nd, n)), np.zeros((ny + m.nd, n, n))
    one[:, at] = first
    two[:, at[:, None], at] = second
    rows = {"q": slice(0, m.nd), "lam": slice(m.nd, ny), "p": slice(ny, None)}
    return {name: one[part] for name, part in rows.items()} | {f"{name}2": two[part] for name, part in rows.items()}


def parts(m: object, x: np.ndarray, lam: np.ndarray) -> dict[str, np.ndarray]:
    return {"q": x[: m.nd], "p": x[m.nq : m.nq + m.nd], "lam": lam}


def error(ours: np.ndarray, theirs: np.ndarray) -> float:
    assert ours.shape == theirs.shape
    if not theirs.size:
        return 0.0
    assert np.abs(theirs).max() > 1e-6, "nothing is compared with nothing"
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


@pytest.mark.parametrize("split", SPLITS)
@every("potential", "constraint", "force", "rotor")
def test_step_meets_the_residuals_of_the_oracle(case: Case, seed: int, split: str) -> None:
    made = solved(case.name, seed, split)
    m, run = made.vi.mechanism, made.run
    ny = m.nd + m.nc
    assert made.residual < 1e-11
    assert error(run.q[1, : m.nd], made.z[: m.nd]) < 1e-12
    assert error(run.p[1], made.orders[0][ny:]) < 1e-11
    assert error(run.lam[0], made.z[m.nd : ny]) < 1e-8


@pytest.mark.parametrize("split", SPLITS)
@every("potential", "constraint", "force", "rotor")
def test_first_derivatives(case: Case, seed: int, split: str) -> None:
    made, theirs = solved(case.name, seed, split), wanted(case.name, seed, split)
    m = made.vi.mechanism
    d = made.vi.linearize(made.run, multipliers=True)
    x = np.concatenate([d.A, d.B], axis=2)[0]
    lam = np.concatenate([d.lam_dx, d.lam_du], axis=2)[0]
    for name, ours in parts(m, x, lam).items():
        assert error(ours, theirs[name]) < A_AND_B, name


@pytest.mark.parametrize("split", SPLITS)
@every("potential", "constraint", "force", "rotor")
def test_second_derivatives_contracted(case: Case, seed: int, split: str) -> None:
    made, theirs = solved(case.name, seed, split), wanted(case.name, seed, split)
    vi, run, m = made.vi, made.run, made.vi.mechanism
    rng = np.random.default_rng([seed, 6])
    z, z_lam = rng.standard_normal(m.nx), rng.standard_normal(m.nc)
    ours = vi.curvature(run, vi.linearize(run), z[None], z_lam=z_lam[None])[0]
    weights = parts(m, z, z_lam)
    expected = sum(np.tensordot(w, theirs[f"{name}2"], 1) for name, w in weights.items())
    assert error(ours, expected) < CURVATURE


@pytest.mark.parametrize("split", SPLITS)
@every("potential", "constraint", "force", "rotor")
def test_second_derivatives_in_full(case: Case, seed: int, split: str) -> None:
    made, theirs = solved(case.name, seed, split), wanted(case.name, seed, split)
    full = made.vi.tensors(made.run, 0)
    for name, ours in parts(made.vi.mechanism, full.x, full.lam).items():
        assert error(ours, theirs[f"{name}2"]) < CURVATURE, name


@pytest.mark.parametrize("name", ["elastic_string", "path_length", "linear_damper"])
def test_orders_of_the_oracle_are_those_of_its_residuals(name: str) -> None:
    """Literally: the residuals of the step, differentiated twice by JAX."""
    made, oracle = solved(name, 0, "symmetric"), oracle_of(name, 0)

    def residuals(z: jnp.ndarray) -> jnp.ndarray:
        return step_residuals(oracle, DT, "symmetric", z)

    first = jax.jacfwd(residuals)
    along = np.random.default_rng(7).uniform(-1.0, 1.0, len(made.z))
    value, J, bent = jax.jit(lambda z: (residuals(z), first(z), jax.jvp(first, (z,), (jnp.asarray(along),))[1]))(made.z)
    scale = np.abs(made.orders[0]).max()
    assert np.abs(made.orders[0] - value).max() < 1e-12 * scale
    assert error(made.orders[1], np.asarray(J)) < 1e-12
    assert error(made.orders[2] @ along, np.asarray(bent)) < 1e-12


def test_comparison_is_not_blind() -> None:
    """Without its element a step is another, to every order; so are the two splits of a force."""
    for name in CASES:
        made, oracle = solved(name, 0, "symmetric"), oracle_of(name, 0)
        s = shape_of(oracle)
        if CASES[name].family == "constraint":
            assert np.abs(made.run.lam).max() > 1e-6, name
            continue
        bare = type(oracle)(made.vi.mechanism)
        bare.elements = []
        residual = step_orders(bare, DT, "symmetric", made.z)[0][: s.ny]
        assert np.abs(residual).max() > 1e-6 * np.abs(made.z).max(), name
