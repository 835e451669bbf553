"""What an optimisation begins with, as it is given."""

from __future__ import annotations

from typing import Any

from leastaction.errors import ArgumentError


def pair_of(initial: Any) -> tuple[Any, Any]:
    """Return the pair (x, u) that was given to start from, or complain."""
    if not isinstance(initial, (tuple, list)) or len(initial) != 2:
        advice = "; (initial.x, initial.u) is one" if hasattr(initial, "x") and hasattr(initial, "u") else ""
        raise ArgumentError(f"initial: got {type(initial).__name__}, expected a pair (x, u){advice}")
    x, u = initial
    return x, u
