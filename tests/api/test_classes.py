"""Classes are final or abstract: what others build upon is not made itself."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator

from api.modules import MODULES

# What users extend with steps, costs or results of their own, and so does the package.
OPEN = {"MidpointSystem", "OptimizationResult"}


def made(module: object) -> Iterator[type]:
    """Return the classes that a module calls by their names."""
    for node in ast.walk(ast.parse(inspect.getsource(module))):  # type: ignore[arg-type]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            called = getattr(module, node.func.id, None)
            if inspect.isclass(called):
                yield called


def own(kind: type) -> bool:
    return kind.__module__.startswith(("leastaction.", "leastaction_marionette."))


def test_no_class_is_both_made_and_built_upon() -> None:
    every = [importlib.import_module(name) for name in MODULES]  # all of them first, so that all subclasses are there
    bases = set()
    for module in every:
        for called in made(module):
            if own(called) and not issubclass(called, Exception) and any(map(own, called.__subclasses__())):
                bases.add(called.__name__)
    assert bases == OPEN


# Two words for what a field of an element holds, which are those of a frame and of many names too.
SHARED = {"Frame", "Names"}


def test_every_class_has_a_name_of_its_own() -> None:
    found: dict[str, str] = {}
    twice = set()
    for name in MODULES:
        for node in ast.walk(ast.parse(inspect.getsource(importlib.import_module(name)))):
            if isinstance(node, ast.ClassDef) and found.setdefault(node.name, name) != name:
                twice.add(node.name)
    assert twice <= SHARED
