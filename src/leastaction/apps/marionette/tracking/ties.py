"""Strings that are tied to bars, in a plan by tensions: what it costs that they are not as long as they are tied.

With its tension as an input a string may be of any length at any instant, as if its end ran over a winch. One that is
tied to a bar may not. How much longer it is, ``c = (d^2 - L^2) / (2 L)`` with the distance d of its ends and its length
L, is brought close to zero by a price: each instant costs ``w c^2 / 2``. The weight w grows from one optimisation to
the next, as `WEIGHTS` say, until winding hardly pays: the strings are tied ever more firmly, and every motion on the
way is one that strings make. The lengths are those that suit the motion, the means of the distances, until
`FIXED_FROM`. What is left, less than a tenth of a millimetre, goes at once (`settle.py`): the motion becomes one of
the marionette on strings of fixed lengths.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from leastaction.mechanics import Distance, Mechanism
from leastaction.models.marionette import tied_strings
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal import Cost
from leastaction.systems import MidpointSystem
from leastaction.systems.costs.configurations import CostOfConfigurations

LEAST_WEIGHT: Final = 1.0
"""Of a length that is off (1/m^2), with which a plan begins."""

WEIGHTS: Final = tuple(10.0**power for power in range(1, 8))
"""Those that follow. From 1e7 on rounding of what the lengths cost may look like negative curvature."""

FIXED_FROM: Final = 1e5
"""The weight from which on strings stay as long as they are tied."""


class Ties:
    """The lengths of strings on bars along a plan, and what it costs that they are others. For one thread.

    ``whole``: the marionette by lengths. ``by_tension``: the same by tensions.

    Attributes: ``names`` of the lengths, ``lengths`` (m,), ``weight``, ``firm`` (whether that is enough for strings to
    be `settled`).
    """

    def __init__(self, whole: Mechanism, by_tension: Mechanism) -> None:
        strings = tied_strings(whole)
        ends = [Distance(string.hook, string.control, 1.0, name=f"ends of {string.name}") for string in strings]
        self.measured = by_tension.with_elements(ends)
        self.names = tuple(string.length for string in strings)
        self.lengths = np.array([whole.parameters[name] for name in self.names])
        self.weight, self.firm = LEAST_WEIGHT, False

    def priced(self, cost: Cost, system: MidpointSystem) -> Cost:
        """Return a cost of a system with that of the lengths as it stands."""
        return TiedCost(cost, system, self.measured, lengths=self.lengths, weight=self.weight)

    def distances(self, x: Array) -> Array:
        """Return how far the ends of each string are apart (N+1, m) in states (N+1, nx)."""
        return np.sqrt(_squares(self.measured, x))

    def off(self, x: Array) -> Array:
        """Return how much longer the strings are than they are tied (N+1, m)."""
        return _off(self.measured, x, self.lengths)

    def slopes(self, q: Array) -> Array:
        """Return the derivative (m, nq) of that by the configuration (nq,)."""
        J = self.measured.core.constraint_jacobian(np.ascontiguousarray(q))
        return np.asarray(J / (2.0 * self.lengths[:, None]))


class TiedCost(CostOfConfigurations):
    """Another cost, and that of strings being longer or shorter than they are tied; as fit for several threads.

    ``measured``: a mechanism whose constraints are the distances of the strings' ends from 1 m. ``lengths`` (m,),
    ``weight``: see the module.
    """

    def __init__(
        self, cost: Cost, system: MidpointSystem, measured: Mechanism, *, lengths: Array, weight: float
    ) -> None:
        super().__init__(cost, "lengths of strings", system)
        self._measured, self._weight = measured, weight
        self._lengths = read_only(lengths.copy())

    def eased(self, ease: float) -> None:  # noqa: ARG002
        """Return None: as of `TrackingCost`, it leads to motions in which strings are far from tied."""
        return

    def _prices(self, q: Array, start: int) -> Array:  # noqa: ARG002 - strings are tied all along
        return np.asarray(0.5 * self._weight * np.sum(_off(self._measured, q, self._lengths) ** 2, axis=1))

    def _slopes(self, q: Array) -> Array:
        m = self._measured
        return np.array([pull @ m.core.constraint_jacobian(at) for at, pull in zip(q, self._pulls(q), strict=True)])

    def _bends(self, q: Array, *, exact: bool) -> Array:
        m, share = self._measured, self._weight / (4.0 * self._lengths[:, None] ** 2)
        J = np.array([m.core.constraint_jacobian(at) for at in q])
        bends = np.asarray(J.transpose(0, 2, 1) @ (share * J))
        if exact:
            for k, pull in enumerate(self._pulls(q)):
                bends[k] += m.core.constraint_hessian(q[k], pull)
        return bends

    def _pulls(self, q: Array) -> Array:
        """Return the slopes of the cost by the squared distances (n, m)."""
        return np.ascontiguousarray(self._weight * _off(self._measured, q, self._lengths) / (2.0 * self._lengths))


def _off(measured: Mechanism, x: Array, lengths: Array) -> Array:
    """Return how much longer strings are than their lengths (n, m) in states (n, nx)."""
    return np.asarray((_squares(measured, x) - lengths**2) / (2.0 * lengths))


def _squares(measured: Mechanism, x: Array) -> Array:
    """Return the squared distances of the strings' ends (n, m) in states (n, nx)."""
    q = np.ascontiguousarray(x[:, : measured.nq])
    return np.array([measured.core.constraints(each) for each in q]) + 1.0
