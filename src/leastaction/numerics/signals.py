"""Times, time steps and signals over time as a simulation takes them, checked."""

from __future__ import annotations

import operator
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_number, shape_of

Signal = npt.ArrayLike | Callable[[float], npt.ArrayLike] | None
"""A constant, one row a step, a function of time, or nothing."""


def check_times(t: npt.ArrayLike) -> Array:
    """Return times (N+1,) as an array, N >= 1, strictly increasing and finite."""
    times = as_array(t, "t", (None,))
    if len(times) < 2:
        raise ArgumentError(f"t: got {len(times)} times, expected at least two")
    steps = np.diff(times)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise ArgumentError(
            f"t: times must increase, but t[{k}] = {times[k]} and t[{k + 1}] = {times[k + 1]}"
        )
    return times


def signal_rows(
    signal: Signal,
    times: Array,
    names: tuple[str, ...],
    what: str,
    default: Array,
    *,
    extra_row: bool = False,
) -> Array:
    """Return a signal as one row a step (N, n): constant, given by rows, or a function of time.

    With `extra_row` rows at all N + 1 instants are taken too, of which the first is dropped.
    """
    N, n = len(times), len(names)
    if signal is None:
        return np.tile(default, (N, 1))
    if callable(signal):
        return np.array(
            [as_array(signal(float(at)), f"{what}({at:g})", (n,), names=names) for at in times]
        ).reshape(N, n)
    shape = shape_of(signal)
    if shape is not None and len(shape) == 1:
        return np.tile(as_array(signal, what, (n,), names=names), (N, 1))
    rows = N + 1 if extra_row and shape is not None and shape[0] == N + 1 else N
    values = as_array(signal, what, (rows, n), names=names)
    if rows > N:
        off = np.abs(values[0] - default)
        if np.any(off > 1e-9 * np.maximum(1.0, np.abs(default))):
            i = int(np.argmax(off))
            raise ArgumentError(
                f"{what}: its first row has {names[i]!r} at {values[0, i]:.6g}, but the start has it at "
                f"{default[i]:.6g}; they must agree, or give one row a step without the first"
            )
    return values[rows - N :]


def as_count(value: int, what: str, least: int) -> int:
    """Return a whole number that is at least `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least:
        raise ArgumentError(f"{what}: got {value!r}, expected a whole number, at least {least}")
    return number


def as_time_step(dt: float) -> float:
    """Return a positive time step (s)."""
    h = as_number(dt, "dt")
    if h <= 0.0:
        raise ArgumentError(f"dt: got {h} s, expected a positive time step")
    return h
