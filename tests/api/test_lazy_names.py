"""Packages whose names are loaded when they are first used: the tables are whole, and importing costs little."""

from __future__ import annotations

import ast
import builtins
import importlib
import os
import subprocess
import sys
from importlib.resources import files
from typing import Any

import pytest

import leastaction

LAZY = (
    "leastaction", "leastaction.control", "leastaction.identification", "leastaction.mechanics", "leastaction.numerics",
    "leastaction.optimal", "leastaction.systems",
)  # fmt: skip


def fresh(code: str) -> str:
    """Run code in a fresh interpreter and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env=os.environ, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def stated(package: str) -> tuple[dict[str, set[str]], set[str]]:
    """Return a package's names by module as type checkers see them in its stub, and those that it exports there."""
    tree = ast.parse(files(package).joinpath("__init__.pyi").read_text("utf-8"))
    seen: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            seen.setdefault(node.module or "", set()).update(a.name for a in node.names)
    [exported] = [ast.literal_eval(node.value) for node in tree.body if isinstance(node, ast.Assign)]
    return seen, set(exported)


@pytest.mark.parametrize("package", LAZY)
def test_all_that_type_checkers_see_is_exported_and_nothing_else(package: str) -> None:
    seen, exported = stated(package)
    unsaid = {"open"} if package == "leastaction" else set[str]()
    assert exported == set().union(*seen.values()) - unsaid
    assert set(importlib.import_module(package).__all__) == exported


@pytest.mark.parametrize("package", LAZY)
def test_every_name_is_what_its_module_has_and_no_module_of_the_same_name(package: str) -> None:
    seen, _ = stated(package)
    for module, names in seen.items():
        assert module.startswith("leastaction.")
        for name in names:
            assert getattr(importlib.import_module(package), name) is getattr(importlib.import_module(module), name)
            shadow = files(package).joinpath(f"{name}.py")
            assert not shadow.is_file(), f"{shadow}: importing this module would hide the name that {module} has"


@pytest.mark.parametrize("package", LAZY)
def test_star_import_and_dir_have_every_name(package: str) -> None:
    names: dict[str, Any] = {}
    exec(f"from {package} import *", names)
    module = importlib.import_module(package)
    assert set(module.__all__) <= set(names)
    assert fresh(f"import {package} as p; print(set(p.__all__) <= set(dir(p)))").strip() == "True"


def test_star_import_hides_no_name_of_python() -> None:
    assert not set(leastaction.__all__).intersection(dir(builtins))
    assert leastaction.open is importlib.import_module("leastaction.io").open
    assert "open" in dir(leastaction)


def test_names_that_have_moved_are_found_and_not_listed() -> None:
    tree = ast.parse(files("leastaction").joinpath("__init__.py").read_text("utf-8"))
    [moved] = [node.value for node in tree.body if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict)]
    where: dict[str, str] = ast.literal_eval(moved)
    assert sum(len(names.split()) for names in where.values()) > 70
    for place, names in where.items():
        for name in names.split():
            assert name in importlib.import_module(place).__all__, f"{name} is no public name of {place}"
            assert getattr(leastaction, name) is getattr(importlib.import_module(place), name)
            assert name not in leastaction.__all__
            assert name not in dir(leastaction)


def test_missing_name_is_an_attribute_error_that_names_it() -> None:
    with pytest.raises(AttributeError, match="module 'leastaction' has no attribute 'Mechansim'"):
        leastaction.Mechansim  # type: ignore[attr-defined]  # noqa: B018
    with pytest.raises(ImportError, match=r"cannot import name 'optimise' from 'leastaction\.optimal'"):
        exec("from leastaction.optimal import optimise")


def test_packages_of_the_package_are_names_too() -> None:
    assert fresh("import leastaction as la; print(la.models.__name__)").strip() == "leastaction.models"


def test_importing_the_package_loads_no_numerics() -> None:
    loaded = fresh("import sys, leastaction; print(*sys.modules)").split()
    assert "numpy" not in loaded
    assert {name for name in loaded if name.startswith("leastaction")} == {
        "leastaction", "leastaction._names", "leastaction._version",
    }  # fmt: skip


def test_a_mechanism_loads_neither_the_optimiser_nor_scipy() -> None:
    loaded = fresh("import sys; from leastaction import Mechanism, MidpointVI; print(*sys.modules)").split()
    assert "leastaction.mechanics.discrete.midpoint" in loaded
    assert not [name for name in loaded if name.startswith(("leastaction.optimal.", "leastaction.systems.", "scipy"))]


def test_what_a_first_script_imports_costs_a_few_times_numpy_and_scipy() -> None:
    # Measured: the package 0.03, numpy with SciPy's linear algebra 1, these three names 2.4 without bytecode and 1.3
    # with it; everything in the package 3.4. The oldest numpy and SciPy load in two thirds: 3.8 and 2.4.
    code = (
        "import os, subprocess, sys\n"
        "def seconds(what):\n"
        "    def once():\n"
        "        before = os.times(); subprocess.run([sys.executable, '-c', what], check=True); after = os.times()\n"
        "        return after[2] + after[3] - before[2] - before[3]\n"  # of the processor: others are busy too
        "    return min(once() for _ in range(5))\n"
        "nothing = seconds('pass')\n"
        "unit = seconds('import numpy, scipy.linalg') - nothing\n"
        "print((seconds('import leastaction') - nothing) / unit)\n"
        "print((seconds('from leastaction import Mechanism, MidpointVI, optimize') - nothing) / unit)\n"
    )
    package, names = map(float, fresh(code).split())
    print(package, names)
    assert package < 0.5
    assert names < 5.0
