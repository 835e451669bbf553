"""What differs between searches is a part that is given, not a method that is replaced; read from the syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import leastaction.optimal

MOST_FIELDS = 25


@dataclass(frozen=True)
class Class:
    """``bases``: their names. ``methods``: that are implemented. ``fields``: of an object of it alone."""

    bases: tuple[str, ...]
    methods: frozenset[str]
    fields: frozenset[str]


def name_of(node: ast.expr) -> str:
    if isinstance(node, ast.Subscript):
        return name_of(node.value)
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def is_implemented(method: ast.FunctionDef) -> bool:
    if any("abstractmethod" in ast.dump(each) or "overload" in ast.dump(each) for each in method.decorator_list):
        return False
    return not all(isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant) for each in method.body)


def fields_of(node: ast.ClassDef) -> Iterator[str]:
    """Yield what objects of a class hold: what its methods set, and the fields of a dataclass."""
    if any("dataclass" in ast.dump(each) for each in node.decorator_list):
        for each in node.body:
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
                yield each.target.id
    for each in ast.walk(node):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store) and name_of(each.value) == "self":
            yield each.attr


def read() -> dict[str, Class]:
    found = {}
    assert leastaction.optimal.__file__ is not None
    for path in Path(leastaction.optimal.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                methods = [
                    each.name for each in node.body if isinstance(each, ast.FunctionDef) and is_implemented(each)
                ]
                bases = tuple(name_of(base) for base in node.bases)
                found[node.name] = Class(bases, frozenset(methods), frozenset(fields_of(node)))
    return found


def ancestors(name: str, classes: dict[str, Class]) -> Iterator[str]:
    for base in classes[name].bases:
        if base in classes:
            yield base
            yield from ancestors(base, classes)


def overridden(classes: dict[str, Class]) -> set[str]:
    """Return the methods that are implemented in a base and again in a class that builds upon it."""
    found = set()
    for name, each in classes.items():
        for base in ancestors(name, classes):
            for method in each.methods & classes[base].methods:
                if method not in ("__init__", "__post_init__"):
                    found.add(f"{name}.{method} of {base}")
    return found


def test_nothing_that_is_implemented_is_overridden() -> None:
    assert overridden(read()) == set()


def test_no_object_has_many_fields() -> None:
    classes = read()
    assert len(classes) > 100
    for name, each in classes.items():
        every = each.fields.union(*(classes[base].fields for base in ancestors(name, classes)))
        assert len(every) <= MOST_FIELDS, (name, len(every), sorted(every))


def test_an_overridden_method_is_seen() -> None:
    base = Class((), frozenset({"go", "stay"}), frozenset())
    between = Class(("Base",), frozenset(), frozenset())
    last = Class(("Between",), frozenset({"go"}), frozenset())
    assert overridden({"Base": base, "Between": between, "Last": last}) == {"Last.go of Base"}
