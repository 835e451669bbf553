"""Continuous time with every element type, to second order, against implicit differentiation of an oracle."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from derivatives.elements.cases import CASES, Case, problem
from derivatives.elements.checks import every, oracle_of
from leastaction.errors import ArgumentError
from leastaction.mechanics import ContinuousDynamics, PythonConstraint
from oracles.continuous_oracle import (
    At,
    Orders,
    differentiate_implicitly,
    equation_orders,
    equations,
)

VALUES, FIRST, SECOND = 1e-11, 1e-10, 1e-8


class Solved:
    """Our accelerations at a random motion, and the oracle's equations there."""

    def __init__(self, name: str, seed: int) -> None:
        p = problem(name, seed)
        m = p.mechanism
        rng = np.random.default_rng([seed, 8])
        v = rng.uniform(-1.0, 1.0, m.nq)
        Dh = m.constraint_jacobian(p.q)
        v[: m.nd] -= np.linalg.lstsq(Dh[:, : m.nd], Dh @ v, rcond=None)[0]
        u, rho_a = rng.uniform(0.5, 2.0, m.nu), rng.uniform(-1.0, 1.0, m.nrho)
        self.dynamics = ContinuousDynamics(m, threads=1)
        self.point = (p.q, v, u, rho_a)
        self.out = self.dynamics.accelerations(*self.point)
        self.at = At(p.q, v, np.concatenate([self.out.a, rho_a]), self.out.lam, u)

    @property
    def sizes(self) -> tuple[int, int, int]:
        m = self.dynamics.mechanism
        return m.nd, m.nq, m.nc


@cache
def solved(name: str, seed: int) -> Solved:
    return Solved(name, seed)


@cache
def orders(name: str, seed: int) -> Orders:
    return equation_orders(oracle_of(name, seed), solved(name, seed).at)


@cache
def wanted(name: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    return differentiate_implicitly(orders(name, seed), *solved(name, seed).sizes)


def error(ours: np.ndarray, theirs: np.ndarray) -> float:
    assert ours.shape == theirs.shape
    if not theirs.size:
        return 0.0
    assert np.abs(theirs).max() > 1e-6, "nothing is compared with nothing"
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def takes_fourth_order(case: Case, seed: int) -> bool:
    elements = problem(case.name, seed).mechanism.elements.values()
    return not any(isinstance(element, PythonConstraint) for element in elements)


@every("potential", "constraint", "force", "rotor")
def test_accelerations(case: Case, seed: int) -> None:
    s, value = solved(case.name, seed), orders(case.name, seed).value
    m = s.dynamics.mechanism
    size = np.abs(m.mass_matrix(s.at.q)).max() * np.abs(s.at.a).max()
    assert np.abs(value).max() < VALUES * max(size, 1.0)
    q, v = s.point[:2]
    needed = s.dynamics.inverse_dynamics(q, v, s.at.a, s.at.lam, u=s.at.u)
    assert np.abs(needed[: m.nd]).max() < VALUES * max(size, 1.0)


@every("potential", "constraint", "force", "rotor")
def test_first_derivatives(case: Case, seed: int) -> None:
    s = solved(case.name, seed)
    d = s.dynamics.linearize(*s.point)
    theirs = wanted(case.name, seed)[0]
    nd = s.sizes[0]
    assert error(d.all[:nd], theirs[:nd]) < FIRST
    assert error(d.all[nd:], theirs[nd:]) < FIRST


@every("potential", "constraint", "force", "rotor")
def test_second_derivatives_contracted(case: Case, seed: int) -> None:
    s = solved(case.name, seed)
    nd, _, nc = s.sizes
    rng = np.random.default_rng([seed, 9])
    z_a, z_lam = rng.standard_normal(nd), rng.standard_normal(nc)
    if not takes_fourth_order(case, seed):
        with pytest.raises(ArgumentError, match="fourth order"):
            s.dynamics.curvature(*s.point, z_a=z_a, z_lam=z_lam)
        return
    ours = s.dynamics.curvature(*s.point, z_a=z_a, z_lam=z_lam)
    theirs = np.tensordot(np.concatenate([z_a, z_lam]), wanted(case.name, seed)[1], 1)
    assert error(ours, theirs) < SECOND


@every("constraint")
def test_second_derivatives_in_full(case: Case, seed: int) -> None:
    if not takes_fourth_order(case, seed):
        return
    s = solved(case.name, seed)
    full, theirs = s.dynamics.tensors(*s.point), wanted(case.name, seed)[1]
    nd = s.sizes[0]
    assert error(full.a, theirs[:nd]) < SECOND
    assert error(full.lam, theirs[nd:]) < SECOND


@pytest.mark.parametrize("name", ["elastic_string", "path_length", "linear_damper"])
def test_orders_of_the_oracle_are_those_of_its_equations(name: str) -> None:
    """Literally: the equations, differentiated by JAX; the second order along one direction."""
    s, oracle, theirs = solved(name, 0), oracle_of(name, 0), orders(name, 0)
    ends = np.cumsum([len(part) for part in s.at])[:-1]

    def function(z: Any) -> jnp.ndarray:
        return equations(oracle, At(*jnp.split(z, ends)))

    z = np.concatenate(s.at)
    w = np.random.default_rng(7).uniform(-1.0, 1.0, len(z))

    def slope(y: Any) -> Any:
        return jax.jvp(function, (y,), (w,))[1]

    value, first, second = jax.jit(lambda y: (function(y), slope(y), jax.jvp(slope, (y,), (w,))[1]))(z)
    scale = np.abs(s.dynamics.mechanism.mass_matrix(s.at.q)).max() * np.abs(s.at.a).max()
    assert np.abs(theirs.value - value).max() < 1e-11 * scale
    assert error(theirs.first @ w, np.asarray(first)) < 1e-11
    assert error(theirs.second @ w @ w, np.asarray(second)) < 1e-9


def test_comparison_is_not_blind() -> None:
    """Without its element a mechanism accelerates otherwise."""
    for name in CASES:
        s = solved(name, 0)
        if CASES[name].family == "constraint":
            assert np.abs(s.at.lam).max() > 1e-6, name
            continue
        bare = type(oracle_of(name, 0))(s.dynamics.mechanism)
        bare.elements = []
        assert np.abs(equation_orders(bare, s.at).value).max() > 1e-6, name
