"""What elements are given, checked: numbers, names, directions, factors and paths of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.poses import pose
from leastaction.numerics.arrays import Array, as_array, as_flag, as_number
from leastaction.numerics.curve import Curve
from leastaction.numerics.names import check_name

Direction = str | Sequence[float]
"""An axis ``"x"``, ``"y"`` or ``"z"`` of a frame, or three numbers in its axes."""

PULLS_BACK = "as a spring drives back to its rest"

# Axes by name, each with the two after it: the three are right-handed.
_AXES = {"x": (0, 1, 2), "y": (1, 2, 0), "z": (2, 0, 1)}


class Factors(dict[str, float]):
    """Numbers by name that can be hashed, as the fields of a frozen element must be."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


def number(value: object, what: str) -> float:
    """Return a finite number, or raise a `DescriptionError`."""
    return as_number(value, what, error=DescriptionError)


def positive(value: object, what: str, why: str, *, zero: bool = False) -> float:
    """Return a positive number (or zero, if that is allowed), or raise with the reason."""
    given = number(value, what)
    if given < 0.0 or (given == 0.0 and not zero):
        raise DescriptionError(
            f"{what}: got {given:g}, expected {'zero or more' if zero else 'a positive number'}, {why}"
        )
    return given


def flag(value: object, what: str) -> bool:
    """Return True or False, or raise a `DescriptionError`."""
    return as_flag(value, what, error=DescriptionError)


def length_or_variable(value: object, what: str) -> float | str:
    """Return a positive length (m) or the name of the variable that prescribes it."""
    if isinstance(value, str):
        return check_name(value, what)
    length = number(value, what)
    if length <= 0.0:
        raise DescriptionError(
            f"{what} is {length:g} m; expected a positive one, as a string of zero length has no "
            "direction to pull in"
        )
    return length


def show_length(length: float | str) -> str:
    """Return a checked length or its variable as text."""
    return length if isinstance(length, str) else f"{length:g} m"


def three(value: object, what: str) -> tuple[float, float, float]:
    """Return three finite numbers, or raise a `DescriptionError`."""
    x, y, z = as_array(value, what, (3,), error=DescriptionError)
    return float(x), float(y), float(z)


def direction(value: object, what: str) -> str | tuple[float, float, float]:
    """Return an axis' name or three numbers that are not all zero, or raise a `DescriptionError`."""
    if isinstance(value, str):
        if value not in _AXES:
            raise DescriptionError(
                f"{what}: got {value!r}, expected 'x', 'y', 'z' or three numbers in the frame's axes"
            )
        return value
    vector = three(value, what)
    if not any(vector):
        raise DescriptionError(f"{what}: all three numbers are zero, which is no direction")
    return vector


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


def rotation(value: object, what: str) -> tuple[tuple[float, float, float], ...]:
    """Return the rows of a rotation matrix (3, 3), or raise a `DescriptionError`."""
    given = as_array(value, what, (3, 3), error=DescriptionError)
    try:
        matrix = pose(rotation=given).matrix
    except DescriptionError as error:
        raise DescriptionError(f"{what}: {error}") from None
    assert matrix is not None
    return tuple(three(row, what) for row in matrix[:3, :3])


def show(given: Direction) -> str:
    """Return a checked direction as text."""
    return given if isinstance(given, str) else f"({', '.join(f'{c:g}' for c in given)})"


def factors(value: object, what: str) -> Factors:
    """Return a variable's name or a mapping of names to factors that are not zero as the latter."""
    if isinstance(value, str):
        return Factors({check_name(value, f"{what}: a variable's name"): 1.0})
    if not isinstance(value, Mapping):
        raise DescriptionError(
            f"{what}: expected a variable's name or a mapping such as {{'theta': 2.0}}, got {value!r}"
        )
    if not value:
        raise DescriptionError(f"{what}: the mapping is empty; give at least one variable")
    result = Factors()
    for name, factor in value.items():
        result[check_name(name, f"{what}: a variable's name")] = number(factor, f"{what}: {name!r}")
        if result[name] == 0.0:
            raise DescriptionError(
                f"{what}: the factor of {name!r} is zero; leave the variable out"
            )
    return result


def path(value: object, what: str) -> tuple[str, ...]:
    """Return the frames of a path: two or more, each different from the one before it."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise DescriptionError(f"{what}: expected a list of frames, got {value!r}")
    names = tuple(check_name(name, what) for name in value)
    if len(names) < 2:
        raise DescriptionError(
            f"{what}: got {len(names)} frame{'s'[: len(names) != 1]}, expected two or more: both ends "
            "and what lies between"
        )
    for before, name in pairwise(names):
        if before == name:
            raise DescriptionError(
                f"{what}: {name!r} follows itself, which is a piece of length zero; name it once"
            )
    return names


def read_curve(value: object, what: str) -> Curve:
    """Return a `Curve`, or raise a `DescriptionError`."""
    if not isinstance(value, Curve):
        raise DescriptionError(
            f"{what}: expected a Curve, got {value!r}; make one from points, Curve(x, y), or by "
            "Curve.from_function"
        )
    return value
