"""Signals over time as a simulation takes them, checked."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.numerics.arrays import Array, as_array, shape_of

StateLaw = Callable[[float, Array], ArrayLike]
"""An input as a function of the time (s) and the state."""

OfTime = ArrayLike | Callable[[float], ArrayLike]

Signal = OfTime | Mapping[str, OfTime] | None
"""A constant, one row a step, a function of time, these of some entries by their names, or nothing."""


def signal_rows(
    signal: Signal, times: Array, names: tuple[str, ...], what: str, default: Array, *, extra_row: bool = False
) -> Array:
    """Return a signal as one row a step (N, n): constant, given by rows, or a function of time; or these by name.

    Rows of a single entry may come without their second axis.
    With `extra_row` rows at all N + 1 instants are taken too, of which the first is dropped.
    """
    N, n = len(times), len(names)
    signal = put_together(signal, names, what, default)
    if signal is None:
        return np.tile(default, (N, 1))
    if callable(signal):
        return np.array([as_array(signal(float(at)), f"{what}({at:g})", (n,), names=names) for at in times]).reshape(
            N, n
        )
    shape = shape_of(signal)
    if n == 1 and shape in ((N,), (N + 1,)) and shape != (1,) and (extra_row or shape == (N,)):
        signal, shape = np.reshape(np.asarray(signal), (-1, 1)), (*shape, 1)
    if shape is not None and len(shape) <= 1:
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


def put_together(signal: object, names: Sequence[str], what: str, default: Array) -> Any:
    """Return what is given by name as one signal: constant, rows, or a function of time; leave what is not as it is.

    ``default``: the values of what has none.
    """
    if not isinstance(signal, Mapping) or not names:
        return signal
    parts: dict[str, Any] = dict(zip(names, default.tolist(), strict=True))
    for name, part in signal.items():
        if name not in parts:
            raise unknown("name", name, names, what)
        if takes_state(part):
            raise ArgumentError(f"{what}[{name!r}]: got a function of time and state; give one for all: {what}=law")
        parts[name] = part if callable(part) else as_array(part, f"{what}[{name!r}]", (), (None,))
    lengths = {name: len(part) for name, part in parts.items() if np.ndim(part)}
    functions = [name for name, part in parts.items() if callable(part)]
    if functions and lengths:
        raise ArgumentError(
            f"{what}: got rows of {next(iter(lengths))!r} and a function for {functions[0]!r}, expected rows or "
            "functions, and constants beside them"
        )
    if functions:
        return lambda t: [part(t) if callable(part) else part for part in parts.values()]
    if len(set(lengths.values())) > 1:
        raise ArgumentError(
            f"{what}: got rows of different lengths: {', '.join(f'{n} of {k!r}' for k, n in lengths.items())}"
        )
    return np.stack(np.broadcast_arrays(*parts.values()), axis=-1)


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
