"""Entries of what a mechanism's equations give, times lengths: the tensions of strings, in either kind of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants


class Scaled(NamedTuple):
    """Entries of a vector, each times ``constant + slope q[place]``.

    ``names``: of them. ``rows`` (m,): of the entries. ``places`` (m,): the coordinates that scale them; where none
    does, any, with a slope of zero. ``constant``, ``slope`` (m,).
    """

    names: tuple[str, ...]
    rows: Instants
    places: Instants
    constant: Array
    slope: Array

    @classmethod
    def plain(cls, names: Sequence[str], rows: Instants) -> Self:
        """Return entries as they are."""
        return cls(tuple(names), rows, np.zeros_like(rows), np.ones(len(rows)), np.zeros(len(rows)))

    @classmethod
    def tensions(cls, m: Mechanism, multiplier: float) -> Self:
        """Return the tensions of a mechanism's strings, entries of the multipliers.

        Those are impulses (1.0) or the negative of forces (-1.0); a length that is a variable scales the tension.
        """
        one, elements, found = np.ones(1), m.elements, []
        for row, name in enumerate(m.constraints):
            element = elements.get(name)
            if element is None:
                continue
            pull = multiplier * one
            short = element.tension(pull, one, dict.fromkeys(m.variables, 0.0 * one))
            long = element.tension(pull, one, dict.fromkeys(m.variables, one))
            if short is not None and long is not None:
                variable = element.length_variable
                place = 0 if variable is None else m.coordinates.index(variable)
                found.append((name, row, place, float(short[0]), float(long[0] - short[0])))
        names, rows, places, constant, slope = zip(*found, strict=True) if found else ((), (), (), (), ())
        return cls(
            names, np.array(rows, dtype=np.intp), np.array(places, dtype=np.intp), np.array(constant), np.array(slope)
        )

    @classmethod
    def joined(cls, parts: Sequence[Scaled]) -> Self:
        """Return the entries of all, one after the other."""
        names, *numbers = zip(*parts, strict=True)
        return cls(tuple(name for each in names for name in each), *map(np.concatenate, numbers))

    def select(self, rows: Sequence[int]) -> Scaled:
        """Return some of them."""
        i, names = list(rows), tuple(self.names[row] for row in rows)
        return Scaled(names, self.rows[i], self.places[i], self.constant[i], self.slope[i])

    def factor(self, lengths: Array) -> Array:
        """Return what each is multiplied with, (n, m), where the variables at `places` are ``lengths`` (n, m)."""
        return np.asarray(self.constant + self.slope * lengths)
