"""The same discrete problems by CasADi and Ipopt, from mechanisms read anew: the same optima."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from leastaction.optimal import Status, optimize

pytest.importorskip("casadi")

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.multiple_shooting import MultipleShooting
from benchmarks.peers import start_of
from benchmarks.robustness_problems import PROBLEMS

BY_NAME = {problem.name: problem for problem in PROBLEMS}

# A tree, forces in a body's axes, and a closed loop with multipliers among the unknowns: of that there are many optima,
# so it starts near ours.
CASES = [
    ("planar arm, tracking, R 1e-06, final 10, rest", False),
    ("quadrotor, flight, R 0.1, final 100, rest", False),
    ("slider-crank, turning, R 1e-06, final 1, rest", True),
]


@pytest.mark.parametrize(("name", "near"), CASES)
def test_ipopt_comes_to_the_same_optimum(name, near):
    given = BY_NAME[name].build()
    result = optimize(given.system, given.cost, initial=(given.x, given.u))
    assert result.status is Status.CONVERGED
    program = MultipleShooting(given.system, given.cost)
    x, u = start_of(given)
    if near:
        rng = np.random.default_rng(0)
        u = result.u + 1e-2 * rng.normal(size=u.shape)
        x = result.x + 1e-4 * rng.normal(size=x.shape)
        x[0] = result.x[0]
    found = program.solve(program.ipopt(), x, u)
    assert found.solved
    assert result.cost == pytest.approx(found.cost, rel=1e-7)
    # An optimum is flat: the costs agree much better than the motions.
    assert np.abs(result.x - found.x).max() < 1e-3 * (1.0 + np.abs(found.x).max())
    # Ours is a trajectory of the other model too.
    lam = given.system.trajectory(result.x, result.u).lam
    size = 1.0 + np.abs(result.x).max() + (np.abs(lam).max() if lam.size else 0.0)
    assert np.abs(program.residuals(result.x, result.u, lam)).max() < 1e-9 * size
