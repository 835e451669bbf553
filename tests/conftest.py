"""What every test shares: which tests run, and an environment that is alike everywhere."""

from __future__ import annotations

import os

# Before NumPy, JAX and Matplotlib are imported: tests share their cores with each other, oracles
# compute in double precision, and figures need no screen.
for _name, _value in {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "JAX_ENABLE_X64": "1",
    "JAX_PLATFORMS": "cpu",
    "MPLBACKEND": "Agg",
}.items():
    os.environ.setdefault(_name, _value)

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# Derandomised: a failure on one machine is a failure on all.
settings.register_profile("leastaction", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("leastaction")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long studies too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--slow") or os.environ.get("LEASTACTION_SLOW", "0") not in ("", "0"):
        return
    slow = [item for item in items if "slow" in item.keywords]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if "slow" not in item.keywords]


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator that gives every test the same numbers every time."""
    return np.random.default_rng(2012)
