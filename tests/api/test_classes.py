"""Classes are final or abstract: what others build upon is not made itself."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator

import numpy as np

import leastaction as la
from api.modules import MODULES, public_names
from leastaction import control, identification, io, mechanics, models, optimal, systems, viz
from leastaction.models.cart_pendulum import cart_pendulum

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


PACKAGES = (control, identification, io, mechanics, models, optimal, systems, viz)


def test_what_users_hold_prints_as_more_than_a_place_in_memory() -> None:
    names = {**public_names(), **{name: getattr(package, name) for package in PACKAGES for name in package.__all__}}
    classes = {name: it for name, it in names.items() if inspect.isclass(it) and own(it)}
    assert len(classes) > 100
    silent = {name for name, it in classes.items() if it.__repr__ is object.__repr__ and it.__str__ is object.__str__}
    assert not silent


def test_a_system_prints_its_names_and_its_horizon() -> None:
    vi = la.MidpointVI(cart_pendulum())
    system = la.MidpointSystem(vi, np.linspace(0.0, 3.0, 151))
    assert str(system) == "<MidpointSystem: states x, theta, p_x, p_theta; inputs x-force; 150 steps, 0 to 3 s>"
    assert "v_theta; inputs x-force>" in str(la.MechanismSystem(cart_pendulum()))
    cost = la.QuadraticCost(np.zeros((151, 4)), np.zeros((150, 1)), Q=np.ones(4), R=[1.0])
    assert str(cost).startswith("<QuadraticCost: x_wanted (151, 4), u_wanted (150, 1), Q (4,)")
    assert "tolerance 1e-13" in str(vi)


def test_what_is_not_made_yet_prints_too() -> None:
    for kind in (la.MidpointSystem, la.MidpointVI, la.QuadraticCost, la.MPC, optimal.FunctionSystem):
        assert str(kind.__new__(kind)).startswith(f"<{kind.__name__}")
