"""The installed package: its version, its types, its compiled variants, what importing it costs."""

from __future__ import annotations

import ast
import importlib.metadata
import os
import subprocess
import sys
from importlib.resources import files

import pytest

import leastaction
from leastaction import _core


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a fresh interpreter."""
    clean = {name: value for name, value in os.environ.items() if name != "LEASTACTION_CORE"}
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=clean | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_version_is_the_installed_one() -> None:
    assert leastaction.__version__ == importlib.metadata.version("leastaction")


def test_package_is_marked_as_typed() -> None:
    assert files("leastaction").joinpath("py.typed").is_file()


def test_best_available_variant_is_chosen() -> None:
    result = python("from leastaction import _core; print(_core.variant)")
    assert result.stdout.strip() == _core.available_variants()[-1], result.stderr


@pytest.mark.parametrize("variant", _core.VARIANTS)
def test_every_variant_has_the_same_names(variant: str) -> None:
    code = "from leastaction import _core; print(_core.variant, *sorted(_core.__all__))"
    result = python(code, LEASTACTION_CORE=variant)
    if variant not in _core.available_variants():
        assert result.returncode != 0
        assert f"LEASTACTION_CORE: got '{variant}'" in result.stderr
        return
    assert result.stdout.split() == [variant, *sorted(_core.__all__)], result.stderr


def test_all_available_variants_can_be_loaded_side_by_side() -> None:
    code = (
        "import importlib; from leastaction import _core\n"
        "for v in _core.available_variants(): importlib.import_module(f'leastaction._core._{v}')"
    )
    result = python(code)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""


def test_unknown_variant_is_an_error_that_names_the_known_ones() -> None:
    result = python("import leastaction._core", LEASTACTION_CORE="v9")
    assert result.returncode != 0
    assert "ImportError: LEASTACTION_CORE: got 'v9' (no such variant)" in result.stderr
    assert ", ".join(_core.available_variants()) in result.stderr


def test_stub_states_every_name_of_the_core() -> None:
    tree = ast.parse(files("leastaction._core").joinpath("_native.pyi").read_text("utf-8"))
    stated = {node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)} | {
        node.target.id for node in tree.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    written_in_python = {"VARIANTS", "available_variants", "variant"}
    assert set(_core.__all__) - written_in_python <= stated


def test_classes_of_the_core_do_not_name_the_variant() -> None:
    classes = [value for value in vars(_core).values() if isinstance(value, type)]
    assert {c.__module__ for c in classes} <= {"leastaction._core"}


def test_import_loads_nothing_that_only_an_extra_brings() -> None:
    extras = "matplotlib viser pybvh jax mujoco pinocchio casadi sympy hypothesis pytest"
    result = python(f"import sys, leastaction; print(*(set({extras.split()}) & set(sys.modules)))")
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == []
