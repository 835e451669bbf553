"""Rows that are entries of states or inputs, which most limits are: all at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty, zeros
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.sides import Sided, SideLayout
from leastaction.optimal.quantity import Entries

_FEW = 512  # entries of states or inputs below which fresh memory is quicker


class EntryRows:
    """Those of some rows that are entries of the state, or of the input, with their derivatives.

    Parameters
    ----------
    rows : sequence of Rows
        All of them.
    layout : Layout
        Of what is taken and returned: an array for each of the rows.
    of_state : bool
    width : int
        Number of entries of a state, or of an input.
    """

    def __init__(self, rows: Sequence[Rows], layout: SideLayout, *, of_state: bool, width: int) -> None:
        places, factors, bounds = [np.empty(0, dtype=np.intp)], [np.empty(0)], [np.empty(0)]
        at = [np.empty(0, dtype=np.intp)]
        for i, each in enumerate(rows):
            quantity = each.quantity
            if isinstance(quantity, Entries) and quantity.of_state is of_state:
                at.append(np.arange(layout.ends[i], layout.ends[i + 1]))
                places.append((each.k[:, None] * width + quantity.places).ravel())
                factors.append(np.broadcast_to(each.sign * quantity.factors, each.bounds.shape).ravel())
                bounds.append((each.sign * each.bounds).ravel())
        self.places, self.factors, self.bounds = np.concatenate(places), np.concatenate(factors), np.concatenate(bounds)
        self.squares = self.factors**2
        self.columns = np.unique(self.places % width)  # of those that have entries
        self.first = int(self.places.min(initial=np.iinfo(np.intp).max))  # of the places that have entries
        # Where they are among all; a part of them in one piece, as far as it is one.
        index = np.concatenate(at)
        whole = len(index) > 0 and index[-1] - index[0] == len(index) - 1
        self.at: Any = slice(index[0], index[-1] + 1) if whole else index

    def values(self, z: Array, to: Sided) -> None:
        """Put the values c (n, m) at states or inputs to those of all rows."""
        if len(self.places):
            found = self._taken(z)
            found -= self.bounds
            to.flat[self.at] = found

    def along(self, dz: Array, to: Sided) -> None:
        """Put the changes dc (n, m) along changes of states or inputs to those of all rows."""
        if len(self.places):
            to.flat[self.at] = self._taken(dz)

    def pulled(self, y: Sided, gradient: Array) -> Array:
        """Return a gradient by states or inputs less ``y . dc``; itself where there are no such rows."""
        if not len(self.places):
            return gradient
        pull = self._gathered(self.factors, y, gradient.shape)
        return np.subtract(gradient, pull, out=pull)

    def hessian(self, sigma: Sided, shape: tuple[int, int]) -> Array | None:
        """Return the diagonals of ``dc' sigma dc`` by states or inputs; None where there are no such rows."""
        return self._gathered(self.squares, sigma, shape) if len(self.places) else None

    def _taken(self, z: Array) -> Array:
        """Return the factors times the entries of states or inputs."""
        found: Array = z.take(self.places, out=empty(self.places.shape), mode="clip")
        found *= self.factors
        return found

    def _gathered(self, factors: Array, values: Sided, shape: tuple[int, ...]) -> Array:
        """Return the sums of factors times values at the places."""
        size = shape[0] * shape[1]
        weighed = np.multiply(factors, values.flat[self.at], out=empty(factors.shape))
        if size < _FEW:
            sums: Any = np.bincount(self.places, weighed, size)
            summed: Array = sums.reshape(shape)
            return summed
        found = zeros((size,))
        np.add.at(found, self.places, weighed)
        return found.reshape(shape)
