"""One array for each side of some limits, all in one piece of memory.

There may be many sides, and they may be short: elementwise mathematics takes all of them at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate
from math import prod

import numpy as np

from leastaction.numerics.arrays import Array


class Layout:
    """Where the arrays of sides begin and end; nothing in it changes. ``shapes``: of the arrays."""

    def __init__(self, shapes: Sequence[tuple[int, ...]]) -> None:
        self.shapes = tuple(shapes)
        self.ends = (0, *accumulate(prod(shape) for shape in self.shapes))

    def empty(self) -> Sided:
        """Return arrays to be written to."""
        return Sided(np.empty(self.ends[-1]), self)

    def filled(self, values: Sequence[Array | float]) -> Sided:
        """Return arrays with a value, or some to be broadcast, for each side."""
        result = self.empty()
        for i, value in enumerate(values):
            result[i] = value
        return result


class Sided:
    """One array for each side. ``flat``: all of their entries; the arrays are views of it."""

    __slots__ = ("flat", "layout")

    def __init__(self, flat: Array, layout: Layout) -> None:
        self.flat, self.layout = flat, layout

    def __len__(self) -> int:
        return len(self.layout.shapes)

    def __getitem__(self, i: int) -> Array:
        layout = self.layout
        return self.flat[layout.ends[i] : layout.ends[i + 1]].reshape(layout.shapes[i])

    def __setitem__(self, i: int, values: Array | float) -> None:
        self[i][...] = values

    def __iter__(self) -> Iterator[Array]:
        return (self[i] for i in range(len(self)))
