"""The elements that actuators, tendons and equality constraints of an MJCF are."""

from __future__ import annotations

from typing import Any

from leastaction.io.mechanisms.mjcf.actuators import elements_of_actuators
from leastaction.io.mechanisms.mjcf.equalities import elements_of_equalities
from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.mjcf.muscles import Bare
from leastaction.io.mechanisms.mjcf.tendons import elements_of_tendons
from leastaction.io.mechanisms.names import Names


def elements_of(spec: Any, names: Names, bare: Bare, *, actuators: bool) -> Found:
    """Return what tendons, equality constraints and, if they are wanted, actuators come to.

    ``bare``: makes the mechanism with no elements but the armatures of its joints and those that it is given.
    """
    found = elements_of_tendons(spec, names, bare) + elements_of_equalities(spec, names)
    return found + elements_of_actuators(spec, names, bare) if actuators else found
