"""The check that every name given by a user goes through."""

from __future__ import annotations

from leastaction.errors import DescriptionError


def check_name(name: object, what: str) -> str:
    """Return a name, or raise a `DescriptionError` if it is not a string with something in it.

    ``what``: what it names, for the message.
    """
    if not isinstance(name, str) or not name.strip():
        raise DescriptionError(f"{what}: a name is a string that is not empty, got {name!r}")
    return name
