"""What an optimisation begins with, as it is given."""

from __future__ import annotations

from typing import Any

from leastaction.errors import ArgumentError


def pair_of(given: Any, what: str = "initial") -> tuple[Any, Any]:
    """Return the pair (x, u) that was given, such as one to start from, or complain."""
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return given[0], given[1]
    owner = next((n for n in ("", ".result") if hasattr(getattr(given, n[1:], None) if n else given, "u")), None)
    advice = "" if owner is None else f"; ({what}{owner}.x, {what}{owner}.u) is one"
    raise ArgumentError(f"{what}: got {type(given).__name__}, expected a pair (x, u){advice}")
