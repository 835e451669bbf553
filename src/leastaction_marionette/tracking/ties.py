"""Strings that are tied to bars, in a plan by tensions: what it costs that they are not as long as they are tied.

With its tension as an input a string may be of any length at any instant, as if its end ran over a winch. One that is
tied to a bar may not. How much longer it is, ``c = (d^2 - L^2) / (2 L)`` with the distance d of its ends and its length
L, is brought close to zero by a price: each instant costs ``w c^2 / 2``. The weight w grows from one optimisation to
the next, from `LEAST_WEIGHT` on as `FIRM` says, until winding hardly pays: the strings are tied ever more firmly, and
every motion on the way is one that strings make. The lengths are those that suit the motion, the means of the
distances, until the first of the firm ones. What is left, less than a tenth of a millimetre, goes at once
(`settle.py`): the motion becomes one of the marionette on strings of fixed lengths.
"""

from __future__ import annotations

from copy import copy
from typing import Final

import numpy as np

from leastaction.mechanics import Mechanism, MovedPoints
from leastaction.models.marionette import tied_strings
from leastaction.numerics import Array, read_only
from leastaction.optimal import Cost
from leastaction.systems import CostOfConfigurations, MidpointSystem

LEAST_WEIGHT: Final = 1e3
"""Of a length that is off (1/m^2), with which a plan begins."""

FIRM: Final = tuple(10.0**power for power in range(5, 8))
"""Those with which strings stay as long as they are tied. From 1e7 on rounding of what the lengths cost may look like
negative curvature."""


class Ties:
    """The lengths of strings on bars along a plan, and what it costs that they are others. For one thread.

    ``whole``: the marionette by lengths. ``by_tension``: the same by tensions.

    Attributes: ``names`` of the lengths, ``lengths`` (m,), ``weight``, ``firm`` (whether that is enough for strings to
    be `settled`).
    """

    def __init__(self, whole: Mechanism, by_tension: Mechanism) -> None:
        strings = tied_strings(whole)
        hooks, controls = [string.hook for string in strings], [string.control for string in strings]
        self.ends = MovedPoints.of(by_tension, [*hooks, *controls])
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
        return TiedCost(cost, system, self.ends, lengths=self.lengths, weight=self.weight)

    def distances(self, x: Array) -> Array:
        """Return how far the ends of each string are apart (N+1, m) in states (N+1, nx)."""
        return np.asarray(np.linalg.norm(self._apart(x), axis=2))

    def off(self, x: Array) -> Array:
        """Return how much longer the strings are than they are tied (N+1, m)."""
        return _off(self._apart(x), self.lengths)

    def slopes(self, q: Array) -> Array:
        """Return the derivative (m, nq) of that by the configuration (nq,)."""
        apart = self.ends.apart(q[None, :])
        return np.asarray(self.ends.apart_slopes(q[None, :], apart / self.lengths[:, None])[0])

    def _apart(self, x: Array) -> Array:
        """Return where hooks are in states, seen from what their strings are tied to (n, m, 3)."""
        return self.ends.apart(np.ascontiguousarray(x[:, : self.ends.mechanism.nq]))


class TiedCost(CostOfConfigurations):
    """Another cost, and that of strings being longer or shorter than they are tied; as fit for several threads.

    ``ends``: the points of the hooks, and behind them those that the strings are tied to, in the same order.
    ``lengths`` (m,), ``weight``: see the module.
    """

    can_be_eased = False  # as of `TrackingCost`: it leads to motions in which strings are far from tied

    def __init__(self, cost: Cost, system: MidpointSystem, ends: MovedPoints, *, lengths: Array, weight: float) -> None:
        super().__init__(cost, "lengths of strings", system)
        self._ends, self._weight = ends, weight
        self._lengths = read_only(lengths.copy())

    def _prices(self, q: Array, start: int) -> Array:  # noqa: ARG002 - strings are tied all along
        off = _off(self._ends.apart(q), self._lengths)
        return np.asarray(0.5 * self._weight * np.sum(off**2, axis=1))

    def _pulls(self, apart: Array) -> Array:
        """Return what the price pulls the ends of strings together with, by how far they are apart (n, m)."""
        return np.asarray(self._weight * _off(apart, self._lengths) / self._lengths)

    def _slopes(self, q: Array) -> Array:
        apart = self._ends.apart(q)
        pull = self._pulls(apart)
        return np.asarray(np.sum(self._ends.apart_slopes(q, pull[:, :, None] * apart), axis=1))

    def _bends(self, q: Array, *, exact: bool) -> Array:
        apart = self._ends.apart(q)
        # Where a string is too long, all that makes it longer bends the price too: D^2 c = (D'D + d . D^2 d) / L.
        pull = self._pulls(apart)
        felt = pull if exact else np.maximum(pull, 0.0)  # a string that is too short bends it downwards
        stiff = np.tile(self._weight / self._lengths**2, (len(q), 1))
        bends = self._ends.apart_bent(q, apart, stiff, felt)
        if exact:
            force = pull[:, :, None] * apart
            bends += self._ends.bent(q, np.concatenate([force, -force], axis=1))
        return bends


def _off(apart: Array, lengths: Array) -> Array:
    """Return how much longer strings are than their lengths (n, m), whose ends are ``apart``."""
    return np.asarray((np.sum(apart**2, axis=2) - lengths**2) / (2.0 * lengths))
