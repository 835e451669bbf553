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
from leastaction.optimal.discrete.cost import AddedCost, CostGradient, CostHessian
from leastaction.systems import MidpointSystem

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


class TiedCost(AddedCost):
    """Another cost, and that of strings being longer or shorter than they are tied.

    With exact second derivatives. As fit for several threads as the other cost.

    ``measured``: a mechanism whose constraints are the distances of the strings' ends from 1 m. ``lengths`` (m,),
    ``weight``: see the module.
    """

    def __init__(
        self,
        cost: Cost,
        system: MidpointSystem,
        measured: Mechanism,
        *,
        lengths: Array,
        weight: float,
    ) -> None:
        super().__init__(cost, "lengths of strings", (system.N, system.nx, system.nu))
        self.nonnegative = cost.nonnegative
        self._measured, self._weight = measured, weight
        self._lengths = read_only(lengths.copy())

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return np.asarray(self.cost.stage_values(x, u, start) + self._values(x))

    def final_value(self, x: Array) -> float:
        return super().final_value(x) + float(self._values(x[None, :])[0])

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        m, pull = self._measured, self._pull(x)
        slopes = np.array([force @ m.core.constraint_jacobian(at) for at, force in zip(self._q(x), pull, strict=True)])
        q, q_final = q.copy(), q_final.copy()
        q[:, : m.nq] += slopes[:-1]
        q_final[: m.nq] += slopes[-1]
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives: a matrix for each stage."""
        m, q, bent = self._measured, self._q(x), self._stiff(x)
        for k, pull in enumerate(self._pull(x)):
            bent[k] += m.core.constraint_hessian(q[k], pull)
        return self._added(self.cost.hessian(x, u), x, bent)

    def convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return those of Gauss and Newton, as if lengths were linear in the configuration; see `Cost`."""
        return self._added(self.cost.convex_hessian(x, u), x, self._stiff(x))

    def eased(self, ease: float) -> None:  # noqa: ARG002
        """Return None: as of `TrackingCost`, it leads to motions in which strings are far from tied."""
        return

    def _q(self, x: Array) -> Array:
        return np.ascontiguousarray(x[:, : self._measured.nq])

    def _off(self, x: Array) -> Array:
        return _off(self._measured, x, self._lengths)

    def _values(self, x: Array) -> Array:
        return np.asarray(0.5 * self._weight * np.sum(self._off(x) ** 2, axis=1))

    def _pull(self, x: Array) -> Array:
        """Return the slopes of the cost by the squared distances (n, m)."""
        return np.ascontiguousarray(self._weight * self._off(x) / (2.0 * self._lengths))

    def _stiff(self, x: Array) -> Array:
        m, share = self._measured, self._weight / (4.0 * self._lengths[:, None] ** 2)
        J = np.array([m.core.constraint_jacobian(q) for q in self._q(x)])
        return np.asarray(J.transpose(0, 2, 1) @ (share * J))


def _off(measured: Mechanism, x: Array, lengths: Array) -> Array:
    """Return how much longer strings are than their lengths (n, m) in states (n, nx)."""
    return np.asarray((_squares(measured, x) - lengths**2) / (2.0 * lengths))


def _squares(measured: Mechanism, x: Array) -> Array:
    """Return the squared distances of the strings' ends (n, m) in states (n, nx)."""
    q = np.ascontiguousarray(x[:, : measured.nq])
    return np.array([measured.core.constraints(each) for each in q]) + 1.0
