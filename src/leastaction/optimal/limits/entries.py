"""Rows that are entries of states or inputs, which most limits are: all at once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Entries

__all__ = ["EntryRows"]


class EntryRows:
    """Those of some rows that are entries of the state, or of the input, with their derivatives.

    Parameters
    ----------
    rows : sequence of Rows
        All of them: what is taken and returned is a list with an array for each.
    of_state : bool
    width : int
        Number of entries of a state, or of an input.
    """

    def __init__(self, rows: Sequence[Rows], *, of_state: bool, width: int) -> None:
        places, factors, bounds = [np.empty(0, dtype=np.intp)], [np.empty(0)], [np.empty(0)]
        self.own: list[int] = []
        for i, each in enumerate(rows):
            quantity = each.quantity
            if isinstance(quantity, Entries) and quantity.of_state is of_state:
                self.own.append(i)
                places.append((each.k[:, None] * width + quantity.places).ravel())
                factors.append(np.broadcast_to(each.sign * quantity.factors, each.bounds.shape).ravel())
                bounds.append((each.sign * each.bounds).ravel())
        self.places, self.factors, self.bounds = np.concatenate(places), np.concatenate(factors), np.concatenate(bounds)
        self.shapes = [rows[i].bounds.shape for i in self.own]
        self.ends = [0, *accumulate(rows[i].bounds.size for i in self.own)]

    def values(self, z: Array, to: list[Array]) -> None:
        """Put the values c (n, m) at states or inputs to those of all rows."""
        self._put(np.take(z, self.places) * self.factors - self.bounds, to)

    def along(self, dz: Array, to: list[Array]) -> None:
        """Put the changes dc (n, m) along changes of states or inputs to those of all rows."""
        self._put(np.take(dz, self.places) * self.factors, to)

    def add_gradient(self, y: Sequence[Array], to: Array) -> None:
        """Subtract ``y . dc`` from a gradient by states or inputs."""
        to -= self._gathered(self.factors, y, to)

    def add_hessian(self, sigma: Sequence[Array], to: Array) -> None:
        """Add the diagonals of ``dc' sigma dc`` by states or inputs."""
        to += self._gathered(self.factors**2, sigma, to)

    def _put(self, values: Array, to: list[Array]) -> None:
        for i, a, b, shape in zip(self.own, self.ends[:-1], self.ends[1:], self.shapes, strict=True):
            to[i] = values[a:b].reshape(shape)

    def _gathered(self, factors: Array, values: Sequence[Array], like: Array) -> Array | float:
        if not self.own:
            return 0.0
        amounts = factors * np.concatenate([values[i].ravel() for i in self.own])
        return np.asarray(np.bincount(self.places, amounts, minlength=like.size).reshape(like.shape), np.float64)
