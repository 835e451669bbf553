"""What every test shares: which tests run, and an environment that is alike everywhere."""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
import tomllib
from collections.abc import Callable, Iterator
from importlib.abc import MetaPathFinder
from importlib.metadata import entry_points
from pathlib import Path

# What JAX compiles is most of the oracles' time: the processes of a run, and the next run, share it.
_COMPILED = Path(__file__).resolve().parents[1] / ".pytest_cache" / "jax"

_ORACLES = ("pybvh", "jax", "pinocchio", "example_robot_data", "mujoco", "casadi", "crocoddyl")

# Before NumPy, JAX and Matplotlib are imported: tests share their cores with each other, oracles
# compute in double precision, and figures need no screen.
for _name, _value in {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "JAX_ENABLE_X64": "1",
    "JAX_PLATFORMS": "cpu",
    "JAX_COMPILATION_CACHE_DIR": str(_COMPILED),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
    "MPLBACKEND": "Agg",
}.items():
    os.environ.setdefault(_name, _value)

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import HealthCheck, settings  # noqa: E402

# Derandomised: a failure on one machine is a failure on all. Nor is a busy one a failure: no deadlines.
settings.register_profile(
    "leastaction",
    deadline=None,
    derandomize=True,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("leastaction")
# Hypothesis also draws the numbers that stand in the modules that are loaded, which depends on what ran before.
with contextlib.suppress(ImportError):  # versions that draw none
    from hypothesis.internal.conjecture.providers import HypothesisProvider

    HypothesisProvider._maybe_draw_constant = lambda *_, **__: None


# An editable install keeps the entry points of the day when it was made; tests find those of today.
_ROOT = Path(__file__).resolve().parents[1]
_STATED = tomllib.loads((_ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]


def _find_entry_points() -> None:
    """State the entry points of pyproject.toml where an installed package does not, for tests and their processes."""
    missing = {
        group: names for group, names in _STATED.items() if not entry_points(group=group).names.issuperset(names)
    }
    if missing:
        place = _ROOT / ".pytest_cache" / "entry_points"
        info = place / "leastaction_today-0.dist-info"
        info.mkdir(parents=True, exist_ok=True)
        lines = [
            f"[{group}]\n" + "".join(f"{n} = {what}\n" for n, what in names.items()) for group, names in missing.items()
        ]
        (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: leastaction-today\nVersion: 0\n", encoding="utf-8")
        sys.path.append(str(place))
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(place)]))


_find_entry_points()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long studies too")
    parser.addoption("--without-oracles", action="store_true", help="skip what needs them, also where they are")


class _NoOracles(MetaPathFinder):
    """Says of every oracle that it is not there."""

    def find_spec(self, name: str, path: object, target: object = None) -> None:
        if name in _ORACLES:
            raise ModuleNotFoundError(f"--without-oracles: {name} is not to be used", name=name)


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--without-oracles"):
        sys.meta_path.insert(0, _NoOracles())


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--slow") or os.environ.get("LEASTACTION_SLOW", "0") not in ("", "0"):
        return
    slow = [item for item in items if "slow" in item.keywords]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if "slow" not in item.keywords]


# Linux gives a process 65530 areas of memory, and every function that JAX compiles takes dozens: the compiler
# crashes when none is left.
_AREAS = Path("/proc/self/maps")
_MOST_AREAS = 20_000
_TESTS_BETWEEN = 20  # to count them takes ten milliseconds

_tests = itertools.count()


@pytest.fixture(autouse=True)
def _compiled_oracles_are_dropped() -> Iterator[None]:
    """Drop what JAX compiled for the tests so far before the system's bookkeeping of it overflows."""
    yield
    jax = sys.modules.get("jax")
    if next(_tests) % _TESTS_BETWEEN or jax is None or not _AREAS.exists():
        return
    if _AREAS.read_bytes().count(b"\n") > _MOST_AREAS:
        jax.clear_caches()


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator that gives every test the same numbers every time."""
    return np.random.default_rng(2012)


@pytest.fixture
def leastaction(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run the command line in this process: its exit code, output and error output."""
    from leastaction.apps.cli import main

    def run(*words: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        captured = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, captured.out, captured.err

    return run
