"""The equality constraints of an MJCF: bodies that are connected or welded, joints that are coupled."""

from __future__ import annotations

from typing import Any

from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.io.mechanisms.parts import SitePart


def elements_of_equalities(spec: Any, names: Names) -> Found:
    """Return the equality constraints of a specification."""
    return Found(left_out=tuple(LeftOut(f"equality {each.name!r}", "not taken over yet") for each in spec.equalities))


def extra_sites(spec: Any) -> dict[str, list[SitePart]]:
    """Return the places on bodies, by their names, that equality constraints need frames at."""
    return {}
