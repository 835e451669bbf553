"""The strings of a mechanism, whose tensions can be limited in either kind of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants


class Strings(NamedTuple):
    """The m strings of a mechanism: the tension of each is its multiplier times ``constant + slope length``.

    ``names``: of them. ``rows`` (m,): of their equations. ``lengths`` (m,): the variables that are their lengths; where
    none is, any, with a slope of zero. ``constant``, ``slope`` (m,).
    """

    names: tuple[str, ...]
    rows: Instants
    lengths: Instants
    constant: Array
    slope: Array

    @classmethod
    def of(cls, m: Mechanism, multiplier: float) -> Strings:
        """Return the strings of a mechanism, whose multipliers are impulses (1.0) or the negative of forces (-1.0)."""
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
                place = 0 if variable is None else m.variables.index(variable)
                found.append((name, row, place, float(short[0]), float(long[0] - short[0])))
        names, rows, lengths, constant, slope = zip(*found, strict=True) if found else ((), (), (), (), ())
        return cls(
            names, np.array(rows, dtype=np.intp), np.array(lengths, dtype=np.intp), np.array(constant), np.array(slope)
        )
