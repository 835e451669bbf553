"""Rows that are entries of states or inputs, which most limits are: all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction import _core
from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.sides import Sided, SideLayout
from leastaction.optimal.quantity import Entries


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
        self.columns = np.unique(self.places % width)  # of those that have entries
        self.first = int(self.places.min(initial=np.iinfo(np.intp).max))  # of the places that have entries
        self.at = np.concatenate(at)  # where they are among all
        self.core = _core.EntryRows(self.places, self.factors, self.bounds, self.at) if len(self.places) else None

    def values(self, z: Array, to: Sided) -> None:
        """Put the values c (n, m) at states or inputs to those of all rows."""
        if self.core is not None:
            self.core.values(z, to.flat)

    def along(self, dz: Array, to: Sided) -> None:
        """Put the changes dc (n, m) along changes of states or inputs to those of all rows."""
        if self.core is not None:
            self.core.along(dz, to.flat)

    def pulled(self, y: Sided, gradient: Array) -> Array:
        """Return a gradient by states or inputs less ``y . dc``; itself where there are no such rows."""
        if self.core is None:
            return gradient
        less: Array = empty(gradient.shape)
        self.core.pull(gradient, y.flat, less)
        return less

    def hessian(self, sigma: Sided, shape: tuple[int, int]) -> Array | None:
        """Return the diagonals of ``dc' sigma dc`` by states or inputs; None where there are no such rows."""
        if self.core is None:
            return None
        diagonals: Array = empty(shape)
        self.core.weigh(sigma.flat, diagonals)
        return diagonals
