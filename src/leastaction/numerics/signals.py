"""Signals over time as a simulation takes them, checked."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, shape_of

Signal = npt.ArrayLike | Callable[[float], npt.ArrayLike] | None
"""A constant, one row a step, a function of time, or nothing."""


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
