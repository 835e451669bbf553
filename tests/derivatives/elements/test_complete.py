"""No element type without a proof: every type of the package has a case, a formula, and is exported."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

import pytest

pytest.importorskip("jax")

from derivatives.elements import formulas
from derivatives.elements.cases import CASES, problem
from leastaction import mechanics
from leastaction.mechanics import Armature, Constraint, Element, Force, Potential

FAMILIES = {
    "potential": (Potential, formulas.POTENTIALS),
    "constraint": (Constraint, formulas.CONSTRAINTS),
    "force": (Force, formulas.FORCES),
    "rotor": (Armature, formulas.ROTORS),
}


def element_types(base: type[Element] = Element) -> Iterator[type[Element]]:
    """Yield the types of the package that can be put on a mechanism: those that no other derives from."""
    own = [cls for cls in base.__subclasses__() if cls.__module__.startswith("leastaction.")]
    for cls in own:
        yield from element_types(cls)
    if not own and base is not Element and not inspect.isabstract(base):
        yield base


TYPES = sorted(set(element_types()), key=lambda cls: cls.__name__)


def test_there_are_types_of_every_family() -> None:
    assert len(TYPES) > 20
    for base in (Potential, Constraint, Force):
        assert sum(issubclass(cls, base) for cls in TYPES) > 5


@pytest.mark.parametrize("cls", TYPES, ids=lambda cls: cls.__name__)
def test_every_type_has_a_case(cls: type[Element]) -> None:
    name = cls.__name__
    assert getattr(mechanics, name, None) is cls, f"{name} is not exported from leastaction.mechanics"
    assert name in mechanics.__all__
    family = next(key for key, (base, _) in FAMILIES.items() if issubclass(cls, base))
    assert name in FAMILIES[family][1], f"{name} has no formula in derivatives/elements/formulas.py"
    proofs = [case for case in CASES.values() if name in case.types and case.family == family]
    assert proofs, f"{name} has no case in derivatives/elements/cases.py, so nothing proves its derivatives"


@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: case.name)
def test_a_case_holds_what_it_says(case: object) -> None:
    elements = problem(case.name, 0).mechanism.elements.values()
    assert {formulas.kind(element) for element in elements} == set(case.types)
    assert all(isinstance(element, FAMILIES[case.family][0]) for element in elements)
