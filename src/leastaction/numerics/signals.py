"""Signals over time as a simulation takes them, checked."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, shape_of

StateLaw = Callable[[float, Array], ArrayLike]
"""An input as a function of the time (s) and the state."""

Signal = ArrayLike | Callable[[float], ArrayLike] | None
"""A constant, one row a step, a function of time, or nothing."""


def signal_rows(
    signal: Signal, times: Array, names: tuple[str, ...], what: str, default: Array, *, extra_row: bool = False
) -> Array:
    """Return a signal as one row a step (N, n): constant, given by rows, or a function of time.

    Rows of a single entry may come without their second axis.
    With `extra_row` rows at all N + 1 instants are taken too, of which the first is dropped.
    """
    N, n = len(times), len(names)
    if signal is None:
        return np.tile(default, (N, 1))
    if callable(signal):
        return np.array([as_array(signal(float(at)), f"{what}({at:g})", (n,), names=names) for at in times]).reshape(
            N, n
        )
    shape = shape_of(signal)
    if n == 1 and shape in ((N,), (N + 1,)) and shape != (1,) and (extra_row or shape == (N,)):
        signal, shape = np.reshape(np.asarray(signal), (-1, 1)), (*shape, 1)
    if isinstance(signal, Mapping) or (shape is not None and len(shape) == 1):
        row = as_array(signal, what, (n,), meaning=f"a constant; rows are of shape ({N}, {n})", names=names)
        return np.tile(row, (N, 1))
    rows = N + 1 if extra_row and shape and shape[0] == N + 1 else N
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


def takes_state(signal: object) -> TypeGuard[StateLaw]:
    """Whether this is a function of time and state: one that cannot be called without two arguments."""
    if not callable(signal):
        return False
    try:
        parameters = inspect.signature(signal).parameters.values()
    except (TypeError, ValueError, OverflowError):
        return False  # a function of C that does not say how it is called
    needed = [p for p in parameters if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    return len(needed) == 2
