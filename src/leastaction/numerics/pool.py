"""Memory that is used again: arrays that a pool has lent are lent once more where nobody holds them any more.

A run of an `Optimizer` asks for the same arrays as the one before, and fresh memory is slow. What is lent may be kept
as long as one likes, in a result or by a callback: it is used again only when the last view of it is gone.
"""

from __future__ import annotations

import threading
from collections import defaultdict
from sys import getrefcount
from types import TracebackType
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array

_fresh = np.empty
_FEW = 512  # rows of an array below which fresh memory is quicker than to look for some


def _is_held(arrays: list[Any], i: int) -> bool:
    """Whether anybody but its list holds an array."""
    return getrefcount(arrays[i]) > _ALONE


_ALONE = (lambda arrays: getrefcount(arrays[0]))([np.empty(0)])  # references to an array that its list alone holds


class Pool:
    """Arrays by their shapes, for one thread at a time. Inside of a ``with`` it is what `empty` takes from."""

    def __init__(self) -> None:
        self._arrays: dict[Any, list[Any]] = defaultdict(list)
        self._before: Pool | None = None

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """Return an array that nobody holds, not initialised."""
        arrays = self._arrays[shape, dtype]
        for i in range(len(arrays)):
            if not _is_held(arrays, i):
                return arrays[i].view()
        arrays.append(np.empty(shape, dtype))
        return arrays[-1].view()

    def reserve(self) -> None:
        """Have another array beside each one that is held: the next run needs as many, while a result holds these."""
        for (shape, dtype), arrays in self._arrays.items():
            held = sum(_is_held(arrays, i) for i in range(len(arrays)))
            arrays += [np.empty(shape, dtype) for _ in range(held)]

    def __enter__(self) -> None:
        self._before, _active.pool = getattr(_active, "pool", None), self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _active.pool, self._before = self._before, None


_active = threading.local()


def empty(shape: tuple[int, ...], dtype: Any = np.float64) -> Any:
    """Return an array, not initialised: from the pool of the run that goes on in this thread, if there is one."""
    if shape[0] < _FEW:
        return _fresh(shape, dtype)
    pool: Pool | None = getattr(_active, "pool", None)
    return np.empty(shape, dtype) if pool is None else pool.empty(shape, dtype)


def zeros(shape: tuple[int, ...]) -> Array:
    """Return an array of zeros likewise."""
    if shape[0] < _FEW:
        return np.zeros(shape)
    array: Array = empty(shape)
    array.fill(0.0)
    return array


def copied(array: Array) -> Array:
    """Return a copy likewise."""
    if array.shape[0] < _FEW:
        return array.copy()
    copy: Array = empty(array.shape)
    copy[...] = array
    return copy


def kept(array: Array) -> Array:
    """Return a copy likewise that nobody can write to."""
    copy = copied(array)
    copy.setflags(write=False)
    return copy
