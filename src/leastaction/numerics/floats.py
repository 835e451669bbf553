"""Checks of array arguments, shared by the modules of `leastaction.optimal`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError

Floats = NDArray[np.float64]


def as_floats(name: str, value: ArrayLike, *shapes: tuple[int, ...], what: str = "") -> Floats:
    """Return a contiguous array of finite floats with one of the given shapes, or complain.

    Parameters
    ----------
    name : str
        The argument's name, for the message.
    value : array_like
        What was given. It is not copied if it is a contiguous array of floats already.
    *shapes : tuple of int
        The shapes that are allowed; none: any shape.
    what : str, optional
        What the axes mean, for the message, such as ``(N+1, nx)``.

    Raises
    ------
    ArgumentError
        Not numbers, a wrong shape, or a value that is not finite (named by its index).
    """
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            f"{name}: got {type(value).__name__} that is not an array of numbers ({error}); "
            f"expected an array of floats{f' of shape {what}' if what else ''}."
        ) from error
    if np.ndim(value) == 0:
        array = array.reshape(())
    if shapes and array.shape not in shapes:
        wanted = " or ".join(str(shape) for shape in shapes)
        raise ArgumentError(
            f"{name}: got shape {array.shape}, expected {wanted}{f', that is {what}' if what else ''}."
        )
    require_finite(name, array)
    return array


def require_finite(name: str, array: Floats) -> None:
    """Complain about the first value that is not finite."""
    # A sum is finite if all its terms are, short of overflow; only then look at every value.
    if np.isfinite(np.sum(array)) or np.isfinite(array).all():
        return
    index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
    raise ArgumentError(
        f"{name}: got {array[index]} at index {index}, expected finite numbers. "
        "Look for a division by zero or missing data where this array comes from."
    )


def as_count(name: str, value: Any, *, minimum: int) -> int:
    """Return an integer of at least `minimum`, or complain."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < minimum:
        raise ArgumentError(f"{name}: got {value!r}, expected an integer >= {minimum}.")
    return int(value)


def as_number(name: str, value: Any, *, above: float, below: float = np.inf) -> float:
    """Return a float in the open interval (above, below), or complain."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not above < number < below:
        raise ArgumentError(f"{name}: got {value!r}, expected a number in ({above}, {below}).")
    return number
