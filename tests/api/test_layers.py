"""The C++ layers: the core knows no Python, the bindings hold no mathematics of their own.

Which folder of the core sees which is held by the build (one target a folder), the layers of the Python side
by import-linter (``make lint``).
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

CPP = Path(__file__).parents[2] / "cpp"
BINDINGS = sorted((CPP / "bindings").glob("*.[ch]pp"))
CORE = sorted(p for p in CPP.glob("*/*.[ch]pp") if p.parent.name not in ("bindings", "cpu"))
PYTHON = re.compile(r'#\s*include\s*[<"](Python\.h|nanobind|pybind11|numpy)|\bPy[A-Z]\w+\s*\(')


def test_the_sources_are_found() -> None:
    assert len({path.parent for path in CORE}) > 5
    assert not list(CPP.glob("*.[ch]pp")), "every file of the core has a folder"
    assert CPP / "bindings" / "module.cpp" in BINDINGS


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.name)
def test_core_knows_no_python(path: Path) -> None:
    found = PYTHON.search(path.read_text("utf-8"))
    assert found is None, f"{path.relative_to(CPP)} has {found.group() if found else ''!r}"


@pytest.mark.parametrize("path", BINDINGS, ids=lambda path: path.name)
def test_bindings_are_seen_by_the_same_pattern(path: Path) -> None:
    # Guards the test above: the pattern does find Python where Python is.
    assert PYTHON.search(path.read_text("utf-8")) is not None


@pytest.mark.parametrize("path", BINDINGS, ids=lambda path: path.name)
def test_each_binding_file_is_named_after_what_it_binds(path: Path) -> None:
    if path.suffix == ".hpp" or path.stem == "module":
        return
    name = path.stem
    assert name.startswith("bind_")
    assert re.search(rf"\bvoid {name}\s*\(", path.read_text("utf-8")), f"{name}() is not defined"
