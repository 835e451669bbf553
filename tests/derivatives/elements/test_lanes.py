"""Every element says the same to several configurations side by side as to one after the other."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jax")

from derivatives.elements.cases import Case, problem
from derivatives.elements.checks import every
from leastaction import MidpointVI
from leastaction.mechanics.discrete.derivatives import linearize_arrays

DT, STEPS, MANY = 2e-3, 6, 11


@every("potential", "constraint", "force", "rotor")
def test_roll_outs_side_by_side_are_those_of_each(case: Case, seed: int) -> None:
    of = problem(case.name, seed)
    m, rng = of.mechanism, np.random.default_rng([seed, 6])
    vi = MidpointVI(m)
    start = vi.start(of.q).x
    x0 = np.tile(start, (MANY, 1))
    x0[:, m.nq : m.nq + m.nd] += 0.3 * rng.standard_normal((MANY, m.nd))
    t = DT * np.arange(STEPS + 1)
    still = np.concatenate([np.zeros(m.n_inputs), start[m.nd : m.nq]])
    moved = np.concatenate([np.ones(m.n_inputs), 1e-4 * np.ones(m.nrho)])
    u = still + moved * rng.standard_normal((MANY, STEPS, len(still)))
    many = vi.core.roll_out_many(t, x0, u, 1)
    assert sum(many.alone) <= 0.25 * MANY * STEPS  # most went side by side, also where some are stiff
    for i in range(MANY):
        alone = vi.core.roll_out(t, x0[i], None, u[i], None)
        assert many.steps[i] == alone.steps
        scale = np.abs(alone.x[: alone.steps + 1]).max(initial=1e-3)
        motion = np.ascontiguousarray(alone.x)
        if alone.steps == STEPS:
            A, B, done = vi.core.linearize_many(t, motion[None], u[i : i + 1], 1)
            d = linearize_arrays(vi, t, motion, u[i])
            assert done == STEPS
            for ours, theirs in ((A[0], d.A), (B[0], d.B)):
                np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max(initial=1.0))
        np.testing.assert_allclose(
            many.x[i, : alone.steps + 1], alone.x[: alone.steps + 1], rtol=0.0, atol=1e-9 * scale
        )
