"""A whole mechanism as plain data: frames, elements, the order of names, and numbers that were changed."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any, Literal, Union

import msgspec
from msgspec import UNSET, UnsetType

from leastaction.errors import DescriptionError
from leastaction.mechanics.mechanism.compilation import Plan, plan
from leastaction.mechanics.mechanism.record.elements import element_data, element_of, element_types
from leastaction.mechanics.mechanism.record.frames import tree_data, tree_of
from leastaction.mechanics.mechanism.record.types import AnyFrame, Strict
from leastaction.numerics.documents import Document, check_format, read_document, write_document

FORMAT = "mechanism 1"
"""What the first line of a file says: its kind, and the version of the format."""


class MechanismBase(Strict, kw_only=True):
    """A mechanism in a file: SI units and radians."""

    leastaction: Literal["mechanism 1"]
    world: str | UnsetType = UNSET
    frames: list[AnyFrame]
    dynamic: list[str] | UnsetType = UNSET
    kinematic: list[str] | UnsetType = UNSET
    inputs: list[str] | UnsetType = UNSET
    numbers: dict[str, float] | UnsetType = UNSET
    shared: dict[str, list[str]] | UnsetType = UNSET


@cache
def mechanism_type() -> Any:
    """Return the type of a mechanism's file."""
    every: Any = Union[tuple(element_types().values())]  # noqa: UP007 - the list is made
    return msgspec.defstruct(
        "Mechanism",
        [("elements", list[every] | UnsetType, UNSET)],
        bases=(MechanismBase,),
        namespace={"__doc__": MechanismBase.__doc__},
        kw_only=True,
        forbid_unknown_fields=True,
    )


def plan_data(settled: Plan) -> dict[str, Any]:
    """Return a mechanism as plain data, from which `plan_of` makes the same one.

    Raises `ModelFileError` for what no file can say, such as an element in Python.
    """
    data: dict[str, Any] = {"leastaction": FORMAT}
    if settled.tree.frames[0].name != "world":
        data["world"] = settled.tree.frames[0].name
    data["frames"] = tree_data(settled.tree)
    if settled.elements:
        data["elements"] = [element_data(element) for element in settled.elements.values()]
    by_itself = plan(settled.tree, list(settled.elements.values()))
    for kind in ("dynamic", "kinematic", "inputs"):
        if getattr(settled, kind) != getattr(by_itself, kind):
            data[kind] = list(getattr(settled, kind))
    if settled.numbers:
        data["numbers"] = dict(settled.numbers)
    if settled.shared:
        data["shared"] = {name: list(members) for name, members in settled.shared.items()}
    return data


def plan_of(document: Document) -> Plan:
    """Return the mechanism that a document describes; raise a `ModelFileError` with the place of what is wrong."""
    check_format(document, FORMAT)
    record = document.read_as(mechanism_type())
    world = "world" if record.world is UNSET else record.world
    tree = tree_of(world, record.frames, document)
    given = () if record.elements is UNSET else record.elements
    elements = [element_of(each, document, ("elements", index)) for index, each in enumerate(given)]
    try:
        return plan(tree, elements, **record.given("leastaction", "world", "frames", "elements"))
    except DescriptionError as error:
        titles = [element.label for element in elements]
        at = [index for index, title in enumerate(titles) if str(error).startswith(f"{title}: ")]
        start = str(error).partition(":")[0]
        place = ("elements", at[0]) if at else (start,) if start in record.__struct_fields__ else ()
        raise document.error(place, str(error).removeprefix(f"{start}: " if place == (start,) else "")) from None


def write_plan(settled: Plan, path: str | os.PathLike[str]) -> Path:
    """Write a mechanism to a file; see `Mechanism.save`."""
    return write_document(path, plan_data(settled))


def read_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a mechanism from a file; see `Mechanism.load`."""
    return plan_of(read_document(path))
