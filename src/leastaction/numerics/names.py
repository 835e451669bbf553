"""What every name, and every pattern of names, that a user gives goes through."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase

from leastaction.errors import ArgumentError, DescriptionError, brief


def check_name(name: object, what: str) -> str:
    """Return a name, or raise a `DescriptionError` if it is not a string with something in it.

    ``what``: what it names, for the message.
    """
    if not isinstance(name, str) or not name.strip():
        raise DescriptionError(f"{what}: a name is a string that is not empty, got {name!r}")
    return name


def as_names(names: object, what: str, of: str) -> tuple[str, ...]:
    """Return some names, or raise an `ArgumentError` if they are no list of words; ``of``: what they are names of."""
    if isinstance(names, str):
        raise ArgumentError(f"{what}: expected a list of {of}, got the string {names!r}")
    if not isinstance(names, Iterable) or isinstance(names, (bytes, Mapping)):
        raise ArgumentError(f"{what}: expected a list of {of}, got {brief(repr(names))}")
    found = tuple(names)
    for name in found:
        if not isinstance(name, str):
            raise ArgumentError(f"{what}: expected a list of {of} by name, got {brief(repr(name))} among them")
    return found


def some_names(names: object, what: str, of: str) -> tuple[str, ...]:
    """Return one name or several, at least one, or raise an `ArgumentError` as `as_names` does."""
    found = (names,) if isinstance(names, str) else as_names(names, what, of)
    if not found:
        raise ArgumentError(f"{what}: got no name, expected {of}")
    return found


def matching(names: Sequence[str], pattern: str) -> list[int]:
    """Return the places of the names that are the pattern, or that it means with wildcards (``"string-*"``)."""
    if not isinstance(pattern, str):
        raise ArgumentError(f"got {brief(repr(pattern))} ({type(pattern).__name__}) where the name of an entry belongs")
    return [i for i, name in enumerate(names) if name == pattern or fnmatchcase(name, pattern)]
