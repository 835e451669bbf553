"""What every name, and every pattern of names, that a user gives goes through."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from leastaction.errors import DescriptionError


def check_name(name: object, what: str) -> str:
    """Return a name, or raise a `DescriptionError` if it is not a string with something in it.

    ``what``: what it names, for the message.
    """
    if not isinstance(name, str) or not name.strip():
        raise DescriptionError(f"{what}: a name is a string that is not empty, got {name!r}")
    return name


def matching(names: Sequence[str], pattern: str) -> list[int]:
    """Return the places of the names that are the pattern, or that it means with wildcards (``"string-*"``)."""
    return [i for i, name in enumerate(names) if name == pattern or fnmatchcase(name, pattern)]
