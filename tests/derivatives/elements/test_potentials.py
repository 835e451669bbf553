"""Potentials of every type on random trees, to the third order, against automatic differentiation."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jax")

from derivatives.elements.cases import Case, problem
from derivatives.elements.checks import FIRST, SECOND, THIRD, assert_near, every, oracle_of, points


@every("potential")
def test_value_gradient_and_hessian(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    rest = np.zeros(m.nq)
    for q, *_ in points(case, seed):
        V, V_q, V_qq, _ = oracle.potential_orders(q)
        assert m.core.kinetic_energy(q, rest) == 0.0  # so that L is -V
        assert_near(np.array(m.core.potential_energy(q)), V, FIRST)
        assert_near(-m.core.gradient(q, rest)[0], V_q, FIRST)
        assert_near(-m.core.hessian(q, rest)[0], V_qq, SECOND)


@every("potential")
def test_third_order_along_a_direction(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    rest = np.zeros(m.nq)
    for q, *_, dq in points(case, seed):
        wanted = oracle.potential_orders(q)[3] @ dq
        assert_near(-m.core.third(q, rest, dq, rest)[0], wanted, THIRD, flat=3 in case.flat)


@every("potential")
def test_it_adds_to_the_lagrangian_of_the_tree(case: Case, seed: int) -> None:
    """In motion too, where the bodies' own part is there, and along a direction of velocity."""
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    q, v, _, _, dq = points(case, seed)[1]
    dv = dq[::-1].copy()
    n = m.nq
    L = oracle.kinetic_orders(np.concatenate([q, v]))
    for order, part in enumerate(oracle.potential_orders(q)):
        L[order][(slice(n),) * order] -= part
    assert_near(np.array(m.core.kinetic_energy(q, v) - m.core.potential_energy(q)), L[0], FIRST)
    assert_near(np.concatenate(m.core.gradient(q, v)), L[1], FIRST)
    assert_near(whole(m.core.hessian(q, v)), L[2], SECOND)
    third = L[3] @ np.concatenate([dq, dv])
    assert_near(whole(m.core.third(q, v, dq, dv)), third, THIRD)


def whole(blocks: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Return (L_qq, L_vq, L_vv) as the whole matrix by [q; v]."""
    qq, vq, vv = blocks
    return np.block([[qq, vq.T], [vq, vv]])
