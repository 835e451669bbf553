"""The tendons of an MJCF: their springs, damping and friction."""

from __future__ import annotations

from typing import Any

from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names


def elements_of_tendons(spec: Any, names: Names) -> Found:
    """Return what the tendons of a specification do by themselves."""
    return Found(left_out=tuple(LeftOut(f"tendon {tendon.name!r}", "not taken over yet") for tendon in spec.tendons))
