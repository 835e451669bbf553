"""What an object prints as that has no words of its own: its kind, and what it was made of, never where it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

_MOST = 6  # most names that are listed


def printed(it: object) -> str:
    """Return the kind of an object with its numbers, names and shapes of arrays; of what else it holds, the kinds."""
    parts = [part for name, value in _fields(it).items() if (part := _part(name, value))]
    return f"<{type(it).__name__}: {', '.join(parts)}>" if parts else f"<{type(it).__name__}>"


def listed(names: Sequence[str]) -> str:
    """Return names, the first of them where they are many."""
    more = len(names) - _MOST
    return ", ".join(names[:_MOST]) + (f" and {more} more" if more > 0 else "")


def _fields(it: object) -> dict[str, Any]:
    """Return what an object was given or offers to be read: nothing that it keeps for itself."""
    return {name: value for name, value in getattr(it, "__dict__", {}).items() if not name.startswith("_")}


def _part(name: str, value: Any) -> str:
    """Return a field in words; empty where there is nothing to be said of it."""
    if value is None:
        return ""
    if isinstance(value, str):
        return f"{name} {value!r}"
    if isinstance(value, (bool, int, float, np.number)):
        return f"{name} {value:g}" if isinstance(value, (float, np.floating)) else f"{name} {value}"
    if isinstance(value, np.ndarray):
        return f"{name} {value.shape}" if value.ndim else f"{name} {value}"
    if isinstance(value, (Mapping, tuple, list)) and all(isinstance(each, str) for each in value):
        return f"{name} [{listed(list(value))}]" if value else ""
    if isinstance(value, (tuple, list)):
        return f"{name} [{listed([_kind(each) for each in value])}]"
    return f"{name} {_kind(value)}"


def _kind(value: object) -> str:
    """Return what something is called, or what it is."""
    return getattr(value, "__name__", type(value).__name__)
