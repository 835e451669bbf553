"""Forces of every type on random trees, to the second order, against automatic differentiation."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jax")

from derivatives.elements.cases import Case, problem
from derivatives.elements.checks import FIRST, SECOND, assert_near, every, oracle_of, points


@every("force")
def test_value_and_jacobians(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    for q, v, u, *_ in points(case, seed):
        f, jacobian, _ = oracle.force_orders(np.concatenate([q, v, u]))
        assert_near(m.core.force(q, v, u)[: m.nd], f[: m.nd], FIRST)
        ours = np.hstack(m.core.force_jacobians(q, v, u))[: m.nd]
        assert_near(ours, jacobian[: m.nd], FIRST)


@every("force")
def test_second_order_contracted(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    mu = np.random.default_rng([seed, 4]).uniform(-1.0, 1.0, m.nq)
    mu[m.nd :] = 0.0  # nothing follows from a force on what is prescribed
    for q, v, u, *_ in points(case, seed):
        wanted = np.tensordot(mu, oracle.force_orders(np.concatenate([q, v, u]))[2], 1)
        ours = m.core.force_curvature(q, v, u, mu)
        assert_near(ours, wanted, SECOND, flat=2 in case.flat)
        assert_near(ours, ours.T, 1e-14, flat=2 in case.flat)
