"""What the tests of the elements share: cases as parameters, points, and comparisons that cannot be empty."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from derivatives.elements.cases import CASES, Case, problem
from oracles.mechanism_oracle import Oracle

SEEDS = (0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6)))

# Relative to the largest entry: value and first, second, contracted third derivatives.
FIRST, SECOND, THIRD = 1e-12, 1e-10, 1e-8


def cases(*families: str) -> list[Any]:
    return [case for case in CASES.values() if case.family in families]


def every(*families: str) -> pytest.MarkDecorator:
    """Run a test for every case of some families, on trees of several seeds."""
    named = [pytest.param(case, id=case.name) for case in cases(*families)]

    def mark(test: Any) -> Any:
        return pytest.mark.parametrize("seed", SEEDS)(pytest.mark.parametrize("case", named)(test))

    return mark


@cache
def oracle_of(name: str, seed: int) -> Oracle:
    """Return the oracle of a case; the compiled graphs stay with it."""
    return Oracle(problem(name, seed).mechanism)


def points(case: Case, seed: int, count: int = 3) -> list[tuple[np.ndarray, ...]]:
    """Return the configuration of the case and some near it, each with random v, u, weights and direction."""
    p = problem(case.name, seed)
    m = p.mechanism
    rng = np.random.default_rng([seed, 3])
    out = []
    for k in range(count):
        q = p.q + 0.3 * min(k, 1) * rng.uniform(-1.0, 1.0, m.nq)
        v, dq = rng.uniform(-1.0, 1.0, (2, m.nq))
        out.append((q, v, rng.uniform(0.5, 2.0, m.nu), rng.uniform(-1.0, 1.0, m.nc), dq))
    return out


def assert_near(
    ours: np.ndarray,
    theirs: np.ndarray,
    tolerance: float,
    *,
    flat: bool = False,
    scale: float = 0.0,
) -> None:
    """Assert equality relative to the largest entry, or to a larger scale where terms cancel.

    ``flat``: theirs must vanish, and ours with it; else theirs must not.
    """
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    assert ours.shape == theirs.shape
    size = np.abs(theirs).max(initial=0.0)
    if flat:
        assert size < 1e-12, "said to vanish, but does not"
    else:
        assert size > 1e-6, "nothing is compared with nothing"
    error = np.abs(ours - theirs).max(initial=0.0) / max(size, scale, 1.0 if flat else 0.0)
    assert error < tolerance, f"off by {error:.2g} of {max(size, scale):.3g}"
