"""Constraints of every type on random trees against automatic differentiation; the third order is in the step."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jax")

from derivatives.elements.cases import Case, problem
from derivatives.elements.checks import FIRST, SECOND, assert_near, every, oracle_of, points


@every("constraint")
def test_values_jacobian_and_hessian(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    for k, (q, _, _, lam, _) in enumerate(points(case, seed)):
        h, Dh, D2h, _ = oracle.constraint_orders(q)
        assert len(h) == m.nc == len(m.constraints)
        if k == 0:  # the case's own configuration meets the equations
            assert np.abs(h).max() < 1e-12
            assert np.abs(m.constraint_values(q)).max() < 1e-12
        else:
            assert_near(m.constraint_values(q), h, FIRST)
        assert_near(m.constraint_jacobian(q), Dh, FIRST)
        wanted = np.tensordot(lam, D2h, 1)
        assert_near(m.core.constraint_hessian(q, lam), wanted, SECOND, flat=2 in case.flat)


@every("constraint")
def test_every_equation_binds_something(case: Case, seed: int) -> None:
    """The equations of one case are independent, so that no multiplier in the step is a matter of taste."""
    p = problem(case.name, seed)
    m = p.mechanism
    Dh = m.constraint_jacobian(p.q)[:, : m.nd]
    assert np.linalg.cond(Dh) < 1e4
    assert m.degrees_of_freedom(p.q) == m.nd - m.nc
