"""The elements that actuators, tendons and equality constraints of an MJCF are."""

from __future__ import annotations

from typing import Any

from leastaction.io.mechanisms.mjcf.actuators import elements_of_actuators
from leastaction.io.mechanisms.mjcf.equalities import elements_of_equalities
from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.mjcf.tendons import elements_of_tendons
from leastaction.io.mechanisms.names import Names


def elements_of(spec: Any, names: Names, *, actuators: bool) -> Found:
    """Return what tendons, equality constraints and, if they are wanted, actuators come to."""
    parts = [elements_of_tendons(spec, names), elements_of_equalities(spec, names)]
    if actuators:
        parts.append(elements_of_actuators(spec, names))
    whole = Found()
    for part in parts:
        whole = whole + part
    return whole
