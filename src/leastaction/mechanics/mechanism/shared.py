"""One number of several elements, frames or bodies: a parameter that stands for others, which have its value.

Its derivative is the sum of theirs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from leastaction.errors import ArgumentError, DescriptionError, brief, unknown
from leastaction.numerics.arrays import Array

Groups = Mapping[str, tuple[str, ...]]
"""The parameters that each shared one stands for, by its name."""


def checked_groups(given: object) -> dict[str, tuple[str, ...]]:
    """Return the parameters that each shared one stands for; raise a `DescriptionError` for what is none."""
    if not isinstance(given, Mapping):
        raise DescriptionError(
            f"shared: got {brief(repr(given))}, expected names of parameters by the name that stands for them, such as "
            "{'k': ['left.stiffness', 'right.stiffness']}"
        )
    groups: dict[str, tuple[str, ...]] = {}
    taken: dict[str, str] = {}
    for name, members in given.items():
        if not isinstance(name, str) or not name.strip():
            raise DescriptionError(f"shared: got the name {brief(repr(name))}, expected a text")
        listed = isinstance(members, Iterable) and not isinstance(members, str)
        groups[name] = tuple(members) if listed else ()
        if not groups[name] or not all(isinstance(member, str) for member in groups[name]):
            raise DescriptionError(f"shared: {name!r}: got {brief(repr(members))}, expected a list of parameters")
        for member in groups[name]:
            if member in taken:
                raise DescriptionError(
                    f"shared: the parameter {member!r} is listed under {taken[member]!r} and under {name!r}"
                )
            taken[member] = name
    return groups


def check_values(groups: Groups, parameters: Mapping[str, float]) -> None:
    """Raise a `DescriptionError` where a shared parameter stands for none, or for some of different values."""
    for name, members in groups.items():
        if name in parameters:
            raise DescriptionError(
                f"shared: {name!r} is a parameter of its own; give what stands for several another name"
            )
        for member in members:
            if member not in parameters:
                raise DescriptionError(f"shared: {name!r}: {unknown('parameter', member, parameters)}")
        values = {parameters[member] for member in members}
        if len(values) > 1:
            told = ", ".join(f"{member!r} = {parameters[member]:g}" for member in members)
            raise DescriptionError(f"shared: {name!r} has one value, but {told}; give them the same")


def spread(groups: Groups, values: Mapping[str, float]) -> dict[str, float]:
    """Return values by parameter, of those that shared ones stand for in their place."""
    refuse_members(groups, values)
    return {member: value for name, value in values.items() for member in groups.get(name, (name,))}


def members_of(groups: Groups, names: Sequence[str]) -> tuple[list[str], Array]:
    """Return the parameters that names stand for, and sums over them: (members, names) of ones and zeros."""
    refuse_members(groups, names)
    each = [groups.get(name, (name,)) for name in names]
    members = [member for group in each for member in group]
    sums = np.repeat(np.eye(len(each)), [len(group) for group in each], axis=0)
    return members, sums


def joined(groups: Groups, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters with shared ones in the place of those that they stand for."""
    owner = {member: name for name, members in groups.items() for member in members}
    return {owner.get(name, name): value for name, value in parameters.items()}


def refuse_members(groups: Groups, names: Iterable[str]) -> None:
    """Raise an `ArgumentError` for a parameter that another one stands for."""
    for name in names:
        for shared, members in groups.items():
            if name in members:
                raise ArgumentError(f"parameters: {name!r} is shared with others as {shared!r}; name that")
