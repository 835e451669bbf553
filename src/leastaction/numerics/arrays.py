"""Checks of numerical arguments, shared by the whole mechanics half.

Every function returns the checked value as a fresh or read-only array of doubles and raises an
`ArgumentError` (or the error type asked for) that names what was given.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, LeastActionError

Array = npt.NDArray[np.float64]


def as_array(
    value: object,
    what: str,
    shape: tuple[int | None, ...],
    *,
    names: Sequence[str] | None = None,
    error: type[LeastActionError] = ArgumentError,
) -> Array:
    """Return a value as an array of finite doubles of the given shape.

    Parameters
    ----------
    value : array_like
        What the user gave.
    what : str
        What it is, for the message: ``"q"``, ``"the com of frame 'bob'"``.
    shape : tuple of int or None
        The expected shape; None stands for any length.
    names : sequence of str, optional
        Names of the entries along the last axis, so that a bad entry can be named.
    error : type, optional
        The error to raise.

    Returns
    -------
    ndarray of float, C-contiguous

    Raises
    ------
    ArgumentError
        If the value is not numeric, has another shape or holds a NaN or an infinity.
    """
    wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "biuf":
            raise TypeError
        array = np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise error(
            f"{what}: expected real numbers of shape {wanted}, got {_brief(value)}; "
            "give a list or an array of numbers"
        ) from None
    # ascontiguousarray turns a scalar into a one-element vector; keep the shape that was given.
    array = array.reshape(given.shape)
    matches = array.ndim == len(shape) and all(
        expected is None or expected == actual
        for expected, actual in zip(shape, given.shape, strict=True)
    )
    if not matches:
        hint = ""
        if names is not None and shape[-1] == len(names) and names:
            hint = (
                f"; the last axis holds {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"
            )
        raise error(f"{what}: expected shape {wanted}, got {array.shape}{hint}")
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        index = tuple(int(i) for i in bad[0])
        where = f" for {names[index[-1]]!r}" if names is not None and index else ""
        raise error(
            f"{what}: entry {list(index)}{where} is {array[index]}; every entry must be a finite number"
        )
    return array


def read_only(array: Array) -> Array:
    """Return a view that cannot be written to: what is frozen stays as it was computed."""
    view = array.view()
    view.setflags(write=False)
    return view


def shape_of(value: object) -> tuple[int, ...] | None:
    """Return the shape of an array_like; None for what has none, such as text or a ragged list."""
    if isinstance(value, (str, bytes)):
        return None
    try:
        return np.shape(value)  # type: ignore[call-overload, no-any-return]
    except ValueError:
        return None


def as_number(value: object, what: str, *, error: type[LeastActionError] = ArgumentError) -> float:
    """Return a value as a finite float.

    Parameters
    ----------
    value : object
        What the user gave.
    what : str
        What it is, for the message.
    error : type, optional
        The error to raise.

    Returns
    -------
    float

    Raises
    ------
    ArgumentError
        If the value is not one real, finite number.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise error(f"{what}: expected a number, got {_brief(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not np.isfinite(number):
        raise error(f"{what}: got {number}; expected a finite number")
    return number


def as_flag(value: object, what: str, *, error: type[LeastActionError] = ArgumentError) -> bool:
    """Return True or False, or raise an error: anything else is more likely a slip than meant.

    Parameters
    ----------
    value : object
        What the user gave.
    what : str
        What it is, for the message.
    error : type, optional
        The error to raise.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise error(f"{what}: expected True or False, got {_brief(value)}")
    return bool(value)


def _brief(value: object) -> str:
    text = repr(value)
    return f"{text if len(text) <= 60 else text[:57] + '...'} ({type(value).__name__})"
