"""Directions that are fixed in a frame: an axis by its name, or three numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.numerics.arrays import Array, as_array

Direction = str | Sequence[float]
"""An axis ``"x"``, ``"y"`` or ``"z"`` of a frame, or three numbers in its axes."""

# Axes by name, each with the two after it: the three are right-handed.
_AXES = {"x": (0, 1, 2), "y": (1, 2, 0), "z": (2, 0, 1)}


def three(value: object, what: str) -> tuple[float, float, float]:
    """Return three finite numbers, or raise a `DescriptionError`."""
    x, y, z = as_array(value, what, (3,), error=DescriptionError)
    return float(x), float(y), float(z)


def read_direction(value: object, what: str) -> str | tuple[float, float, float]:
    """Return an axis' name or three numbers that are not all zero, or raise a `DescriptionError`."""
    if isinstance(value, str):
        if value not in _AXES:
            raise DescriptionError(
                f"{what}: got {value!r}, expected 'x', 'y', 'z' or three numbers in the frame's axes"
            )
        return value
    given = three(value, what)
    if not any(given):
        raise DescriptionError(f"{what}: all three numbers are zero, which is no direction")
    return given


def vector(given: Direction) -> Array:
    """Return a checked direction as three numbers (3,), as long as it was given."""
    if isinstance(given, str):
        axis: Array = np.eye(3)[_AXES[given][0]]
        return axis
    return np.array(given, dtype=np.float64)


def triad(given: Direction) -> tuple[Array, Array, Array]:
    """Return the unit vector of a checked direction and two more that make it right-handed.

    For an axis these are the next axes, such as z, x, y for ``"z"``.
    """
    if isinstance(given, str):
        first, second, third = (np.eye(3)[index] for index in _AXES[given])
        return first, second, third
    along = vector(given)
    along /= np.abs(along).max()
    along /= np.linalg.norm(along)
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return along, across, np.cross(along, across)
