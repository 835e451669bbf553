"""Strings that are tied to bars, in a plan by tensions: what it costs that they are not as long as they are tied.

With its tension as an input a string may be of any length at any instant, as if its end ran over a winch. One that is
tied to a bar may not: that it is longer or shorter has a price (`DistanceCost`), of little weight until a motion is
found, and then of `FIRM`. Every motion on the way is one that strings make. The lengths are those that suit the motion,
the means of the distances. What they are off by then goes at once (`settle.py`).
"""

from __future__ import annotations

from copy import copy
from typing import Final

import numpy as np

from leastaction.mechanics import Mechanism, MovedPoints
from leastaction.models.marionette import tied_strings
from leastaction.numerics import Array
from leastaction.optimal import Cost
from leastaction.systems import DistanceCost, MidpointSystem

LEAST_WEIGHT: Final = 1e3
"""Of a length that is off (1/m^2), with which a plan begins."""

FIRM: Final = 1e5
"""That with which strings stay nearly as long as they are tied."""


class Ties:
    """The lengths of strings on bars along a plan, and what it costs that they are others. For one thread.

    ``whole``: the marionette by lengths. ``by_tension``: the same by tensions.

    Attributes: ``pairs`` of hooks and of what these are tied to; ``names`` of the lengths, ``lengths`` (m,),
    ``weight``, ``firm`` (whether that is enough for strings to be `settled`).
    """

    def __init__(self, whole: Mechanism, by_tension: Mechanism) -> None:
        strings = tied_strings(whole)
        self.pairs = [(string.hook, string.control) for string in strings]
        self._ends = MovedPoints.of(by_tension, [name for names in zip(*self.pairs, strict=True) for name in names])
        self.names = tuple(string.length for string in strings)
        numbers = whole.parameters
        self.lengths = np.array([numbers[name] for name in self.names])
        self.weight, self.firm = LEAST_WEIGHT, False

    def tied(self, weight: float, *, firm: bool) -> Ties:
        """Return the same lengths with another weight; ``firm``: whether that is enough for strings to be settled."""
        other = copy(self)
        other.weight, other.firm = weight, firm
        return other

    def priced(self, cost: Cost, system: MidpointSystem) -> Cost:
        """Return a cost of a system with that of the lengths as it stands."""
        return DistanceCost(cost, system, self.pairs, self.lengths, self.weight)

    def distances(self, x: Array) -> Array:
        """Return how far the ends of each string are apart (N+1, m) in states (N+1, nx)."""
        apart = self._ends.apart(np.ascontiguousarray(x[:, : self._ends.mechanism.nq]))
        return np.asarray(np.linalg.norm(apart, axis=2))

    def off(self, x: Array) -> Array:
        """Return how much longer the strings are than they are tied (N+1, m)."""
        return np.asarray(self.distances(x) - self.lengths)

    def slopes(self, q: Array) -> Array:
        """Return the derivative (m, nq) of that by the configuration (nq,)."""
        apart = self._ends.apart(q[None, :])
        along = apart / np.linalg.norm(apart, axis=2, keepdims=True)
        return np.asarray(self._ends.apart_slopes(q[None, :], along)[0])
