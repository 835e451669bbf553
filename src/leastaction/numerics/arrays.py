"""Checks of numerical arguments: one set for the whole package, always ``(value, what, ...)``.

Every function returns the checked value or raises an `ArgumentError` (or the error type asked for) that
names what was given, what was expected and what to do.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError, LeastActionError, brief, unknown

Array = NDArray[np.float64]

Row = ArrayLike | Mapping[str, ArrayLike]
"""One row of numbers, by place or by name; a unit quaternion by the name of its joint."""

_MOST = 2**31 - 1  # of what is counted


def as_array(
    value: object,
    what: str,
    *shapes: tuple[int | None, ...],
    meaning: str = "",
    names: Sequence[str] | None = None,
    finite: bool = True,
    error: type[LeastActionError] = ArgumentError,
) -> Array:
    """Return a value as an array of finite doubles of one of the given shapes.

    ``value``: what the user gave. It is not copied if it is a contiguous array of doubles already. ``what``: what it
    is, for the message: ``"q"``, ``"the com of frame 'bob'"``. ``*shapes``: the shapes that are allowed; None stands
    for any length, no shape at all for any shape. ``meaning``: what the axes mean, for the message: ``"(N+1, nx)"``.
    ``names``: names of the entries along the last axis, so that a bad entry can be named, and a row of them be given as
    a mapping: what that leaves out is zero. A row of one entry may be a number. ``finite``: whether infinities are
    refused too. Raises `ArgumentError` if the value is not numeric, has another shape or holds a NaN or an infinity.
    """
    if (
        finite
        and type(value) is np.ndarray
        and value.shape in shapes
        and value.dtype == np.float64
        and value.flags.c_contiguous
    ):
        require_finite(value, what, names=names, error=error)
        return value
    if names and isinstance(value, Mapping) and (len(names),) in shapes:
        value = row_by_name(value, what, names)
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "biuf":
            raise TypeError
        array = np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        wanted = f" of shape {_shapes(shapes, meaning)}" if shapes or meaning else ""
        # The result of a search, such as a projection, holds what is asked for under the same name.
        within = what.isidentifier() and isinstance(getattr(value, what, None), np.ndarray)
        advice = f"it has an array '{what}': give that" if within else "give a list or an array of numbers"
        if names and isinstance(value, Mapping):
            advice = f"give rows with the numbers of {_some(names)} in that order"
        raise error(f"{what}: got {_given(value)}, expected real numbers{wanted}; {advice}") from None
    # ascontiguousarray turns a scalar into a one-element vector; keep the shape that was given.
    array = array.reshape(given.shape)
    if array.ndim == 0 and len(names or ()) == 1 and (1,) in shapes:
        array = array.reshape(1)
    if shapes and array.shape not in shapes and not any(_matches(array.shape, shape) for shape in shapes):
        hint = ""
        if names and any(shape and shape[-1] == len(names) for shape in shapes):
            hint = f"; the last axis holds {_some(names)}"
        raise error(f"{what}: got shape {array.shape}, expected {_shapes(shapes, meaning)}{hint}")
    if finite:
        require_finite(array, what, names=names, error=error)
    elif np.isnan(array).any():
        raise error(f"{what}: got nan at index {tuple(np.argwhere(np.isnan(array))[0].tolist())}, expected numbers")
    return array


def row_by_name(
    values: Mapping[str, float],
    what: str,
    names: Sequence[str],
    rest: float = 0.0,
    known: Mapping[str, float] = MappingProxyType({}),
) -> Array:
    """Return numbers given by name as an array (len(names),); others are as ``known`` by name, else ``rest``."""
    row = dict.fromkeys(names, rest) | {**known}
    for name, value in values.items():
        if name not in row:
            raise unknown("name", name, names, what)
        row[name] = as_number(value, f"{what}: the value of {name!r}")
    return np.array(list(row.values()), dtype=np.float64)


def as_wanted(value: object, what: str, *shapes: tuple[int | None, ...], meaning: str = "") -> Array:
    """Return a value as an array of doubles of one of the given shapes, where NaN says that nothing is wanted."""
    try:
        given = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return as_array(value, what, *shapes, meaning=meaning)
    as_array(np.where(np.isnan(given), 0.0, given), what, *shapes, meaning=meaning)
    return given


def require_finite(
    array: Array, what: str, *, names: Sequence[str] | None = None, error: type[LeastActionError] = ArgumentError
) -> None:
    """Raise an error that names the first entry of an array that is not finite, if there is one."""
    # A sum of squares is finite, but for those that overflow, where all are: a third of the time for few of them.
    if math.isfinite(np.vdot(array, array)) or np.isfinite(array).all():
        return
    index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
    name = f" for {names[index[-1]]!r}" if names is not None and index else ""
    at = f" at index {index}{name}" if index else ""
    raise error(f"{what}: got {array[index]}{at}, expected finite numbers")


def read_only(array: Array) -> Array:
    """Return a view that cannot be written to, itself if it is one: what is frozen stays as it was computed."""
    if not array.flags.writeable:
        return array
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


def as_number(
    value: object,
    what: str,
    *,
    least: float | None = None,
    above: float = -np.inf,
    below: float = np.inf,
    error: type[LeastActionError] = ArgumentError,
) -> float:
    """Return a value as a finite float, in a range if one is given.

    ``what``: what it is, for messages. ``least``: the least value that is allowed. ``above``, ``below``: limits that
    are themselves not allowed. Raises `ArgumentError` if the value is not one real, finite number in the range.
    """
    if type(value) is float and above < value < below and (least is None or value >= least) and math.isfinite(value):
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]  # an array of one number and no axis is a number
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise error(f"{what}: got {_given(value)}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not np.isfinite(number):
        raise error(f"{what}: got {number}, expected a finite number")
    if least is not None and number < least:
        raise error(f"{what}: got {number}, expected a number >= {least:g}")
    if not above < number < below:
        raise error(f"{what}: got {number}, expected a number {_range(above, below)}")
    return number


def _range(above: float, below: float) -> str:
    if np.isinf(below):
        return f"> {above:g}"
    return f"< {below:g}" if np.isinf(above) else f"between {above:g} and {below:g}"


def as_count(value: object, what: str, least: int, *, error: type[LeastActionError] = ArgumentError) -> int:
    """Return a whole number that is at least `least`; a bool or a float is none."""
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if number < least:
        raise error(f"{what}: got {brief(repr(value))}, expected a whole number, at least {least}")
    if number > _MOST:
        raise error(f"{what}: got a number of {len(str(number))} digits, expected at most {_MOST}")
    return number


def as_places(value: object, what: str, meaning: str = "") -> NDArray[np.intp]:
    """Return whole numbers (n,), none of them negative: places in something; ``meaning``: in what, for the message."""
    numbers = as_array(value, what, (None,), meaning=meaning)
    if np.any(numbers != np.floor(numbers)) or np.any(numbers < 0.0) or np.any(numbers > _MOST):
        raise ArgumentError(f"{what}: got {brief(numbers.tolist())}, expected whole numbers, at least 0")
    return numbers.astype(np.intp)


def as_time_step(dt: object) -> float:
    """Return a positive time step (s)."""
    h = as_number(dt, "dt")
    if h <= 0.0:
        raise ArgumentError(f"dt: got {h} s, expected a positive time step")
    return h


def as_times(t: object, what: str = "t") -> Array:
    """Return times (N+1,), N >= 1, strictly increasing and finite, as an array of its own that nobody can write to."""
    times = as_array(t, what, (None,), meaning="(N+1,): times of N steps")
    if len(times) < 2:
        raise ArgumentError(f"{what}: got {len(times)} times, expected at least two")
    steps = np.diff(times)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise ArgumentError(f"{what}: times must increase, but t[{k}] = {times[k]} and t[{k + 1}] = {times[k + 1]}")
    return read_only(times.copy())


def as_choice(
    value: object, what: str, choices: Sequence[str], *, error: type[LeastActionError] = ArgumentError
) -> None:
    """Raise an error unless a value is one of some words, such as those of a `Literal` by `get_args`."""
    if not isinstance(value, str) or value not in choices:
        *others, last = map(repr, choices)
        raise error(f"{what}: got {brief(repr(value))}, expected {', '.join(others)} or {last}")


def as_flag(value: object, what: str, *, error: type[LeastActionError] = ArgumentError) -> bool:
    """Return True or False, or raise an error: anything else is more likely a slip than meant.

    ``what``: what it is, for messages.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise error(f"{what}: got {_given(value)}, expected True or False")
    return bool(value)


def require_instance(value: object, what: str, kind: type, instead: str = "") -> None:
    """Raise an `ArgumentError` unless a value is of a class; ``instead``: how one is made, for the message."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        advice = f"; {instead}" if instead else ""
        raise ArgumentError(f"{what}: got {type(value).__name__}, expected {article} {kind.__name__}{advice}")


def require_mapping(value: object, what: str, example: str) -> None:
    """Raise an `ArgumentError` unless a value is a mapping; ``example``: one, for the message."""
    if not isinstance(value, Mapping):
        raise ArgumentError(f"{what}: got {_given(value)}, expected a mapping of names to values, such as {example}")


def _matches(shape: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    return len(shape) == len(expected) and all(n is None or n == m for n, m in zip(expected, shape, strict=True))


def _shapes(shapes: Sequence[tuple[int | None, ...]], meaning: str) -> str:
    """Return the shapes as text: ``(any, 3) or (3,), that is (N, nx) or (nx,)``."""
    text = " or ".join(
        "(" + ", ".join("any" if n is None else str(n) for n in shape) + ",)"[len(shape) != 1 :] for shape in shapes
    )
    return ", that is ".join(part for part in (text, meaning) if part)


def _some(names: Sequence[str]) -> str:
    """Return names as text, the first of them if they are many."""
    return f"{', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"


def _given(value: object) -> str:
    return f"{brief(repr(value))} ({type(value).__name__})"


def smooth_rise(share: Array) -> Array:
    """Return a rise from 0 to 1 where ``share`` goes from 0 to 1, with two zero derivatives at both ends."""
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))
