"""The tables of docs/dissertation.md name functions, options, examples and tests that are there."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

import leastaction

ROOT = Path(__file__).parents[2]
TABLES = [
    re.split(r"(?<!\\)\|", line)[1:-1]
    for line in (ROOT / "docs" / "dissertation.md").read_text("utf-8").splitlines()
    if re.match(r"\| [2-6AB]\.\d", line)
]
NAMED = re.compile(r"`([\w.]+(?:=\w*)?)`")


def find(name: str) -> Any:
    """Return what a dotted name below the package stands for: modules as far as they go, then attributes."""
    parts = name.split(".")
    if parts[0] == "leastaction_marionette":
        return reduce(getattr, parts[1:], importlib.import_module(parts[0]))
    place: Any = leastaction
    for depth in range(len(parts), 0, -1):
        try:
            place = importlib.import_module(".".join(["leastaction", *parts[:depth]]))
        except ModuleNotFoundError:
            continue
        return reduce(getattr, parts[depth:], place)
    return reduce(getattr, parts, place)


def sections() -> list[str]:
    return [row[0].strip() for row in TABLES]


def test_every_chapter_has_its_sections() -> None:
    assert {section[0] for section in sections()} == set("23456AB")
    assert {f"{chapter}.{number}" for chapter, last in ((2, 5), (3, 6), (4, 7), (5, 3), (6, 7)) for number in
            range(1, last + 1)} <= {".".join(section.split(".")[:2]) for section in sections()}  # fmt: skip
    assert sections() == sorted(sections())


@pytest.mark.parametrize("row", TABLES, ids=sections())
def test_what_is_named_exists(row: list[str]) -> None:
    _, _, here, held = row
    names = NAMED.findall(here)
    options = [name for name in names if "=" in name]
    found = [find(name) for name in names if "=" not in name]
    assert found or "example" in here
    for option in options:
        takes = [inspect.signature(one).parameters for one in found]
        assert any(option.partition("=")[0] in parameters for parameters in takes), option
    for number in re.findall(r"example (\d+)", here):
        assert len(list((ROOT / "examples").glob(f"{int(number):02}_*.py"))) == 1
    tests = re.findall(r"`([\w/]+\.py)(?:::(\w+))?`", held)
    assert tests
    for file, function in tests:
        tree = ast.parse((ROOT / "tests" / file).read_text("utf-8"))
        defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not function or function in defined, function


@pytest.mark.parametrize("name", ["Mechanism.frame_poses", "no_such_thing", "optimal.nothing"])
def test_a_name_that_is_not_there_is_noticed(name: str) -> None:
    with pytest.raises(AttributeError):
        find(name)
