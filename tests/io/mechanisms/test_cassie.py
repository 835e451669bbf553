"""Cassie from its MJCF, which ``LEASTACTION_CASSIE`` names: loops closed from a rough guess, kept, and moved.

Four loops over rods and leaf springs; two of them lie in a plane, so 12 equations have rank 10.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

import leastaction as la

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from benchmarks import cassie

FILE = os.environ.get("LEASTACTION_CASSIE", "")
pytestmark = pytest.mark.skipif(not FILE, reason="LEASTACTION_CASSIE names no file")


@pytest.fixture(scope="module")
def model() -> la.Model:
    pytest.importorskip("mujoco")
    return la.load(FILE, fixed=cassie.PELVIS, axes="xyz")


@pytest.mark.parametrize("seed", range(10))
def test_its_loops_close_from_a_rough_guess(model: la.Model, seed: int) -> None:
    m = model.mechanism
    closed = cassie.assembled(model, 0.2, seed)
    assert (m.nq, m.nc, m.constraint_rank(closed.q)) == (26, 12, 10)
    assert np.abs(m.constraint_values(closed.q)).max() < 1e-14
    assert closed.largest < 0.6
    for bound in model.limits:
        if bound.of == "variable":
            assert bound.min <= closed.q[m.variables.index(bound.names)] <= bound.max, bound


def test_a_fall_keeps_them_and_its_energy(model: la.Model) -> None:
    m = model.mechanism
    vi = la.MidpointVI(m)
    run = vi.simulate(vi.start(cassie.assembled(model).q), np.linspace(0.0, 0.5, 1001))
    assert np.abs(m.constraint_values(run.q)).max() < 1e-12
    energy = vi.balance(run)
    assert energy.swing < 0.02 * energy.scale


def test_its_feet_step_within_the_limits_of_the_file(model: la.Model) -> None:
    m = model.mechanism
    found = cassie.step(model)
    assert found.result.status.name == "CONVERGED"
    assert max(found.errors.values()) < 2e-3  # m, of steps of 30 cm
    run = found.trajectory
    assert np.abs(m.constraint_values(run.q)).max() < 1e-14
    ankles = run.inputs[:, [m.inputs.index(f"{foot}.input") for foot in cassie.FEET]]
    assert np.abs(ankles).max() == pytest.approx(0.9, abs=1e-6)  # without limits they would be more
    for bound in model.limits:
        values = run.inputs[:, m.inputs.index(bound.names)] if bound.of == "input" else found[bound.names]
        assert bound.min - 1e-6 <= values.min(), bound
        assert values.max() <= bound.max + 1e-6, bound
    vi = la.MidpointVI(m)
    again = vi.simulate(vi.start(run.q[0]), run.t, inputs=run.inputs)
    np.testing.assert_allclose(again.q, run.q, rtol=0.0, atol=1e-7)
