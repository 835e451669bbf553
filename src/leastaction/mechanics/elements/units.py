"""Units as short texts, such as "rad" and "N m"; "" where there is none, or none that is known."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

# Of a coordinate, or of an equation that holds one: unit of the force, of the momentum and of the impulse along it.
_FORCE: Final = {"m": "N", "rad": "N m", "m^2": "N/m"}
_MOMENTUM: Final = {"m": "kg m/s", "rad": "kg m^2/s"}
_IMPULSE: Final = {"m": "N s", "rad": "N m s", "m^2": "N s/m"}


def common(units: Iterable[str]) -> str:
    """Return the unit that all have; "" where they differ or there are none."""
    found = set(units)
    return found.pop() if len(found) == 1 else ""


def force_along(unit: str) -> str:
    """Return the unit of a force along a coordinate with a unit: its work is in J."""
    return _FORCE.get(unit, "")


def momentum_along(unit: str) -> str:
    """Return the unit of a momentum along a coordinate with a unit."""
    return _MOMENTUM.get(unit, "")


def impulse_along(unit: str) -> str:
    """Return the unit of an impulse along a coordinate with a unit."""
    return _IMPULSE.get(unit, "")


def rate_of(unit: str, order: int = 1) -> str:
    """Return the unit of a derivative by time."""
    return unit and unit + ("/s" if order == 1 else f"/s^{order}")
