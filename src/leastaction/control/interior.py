"""The quadratic problem of one instant of a predictive controller, with its limits: an interior point method.

Along a motion, with the changes ``z = (dx, du)`` and limits ``c + C z >= 0``::

    minimise   g'z + 1/2 z'H z + rho'e    subject to   dx+ = A dx + B du,  dx_0 = 0,  c + C z = s - e,  s, e >= 0

An excess e has a price rho, so that there always is a solution. Newton's step on the equations of optimality, with
``s y = mu`` and ``e (rho - y) = mu``, comes to one Riccati recursion with the stiffness
``sigma = 1 / (s/y + e/(rho - y))`` in the weights, as in `leastaction.optimal.limits`; each iteration makes two (the
predictor and the corrector of S. Mehrotra, SIAM J. Optim. 2, 1992). Slacks and multipliers are kept from instant to
instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import CostGradient
from leastaction.optimal.discrete.descent import minimise_model
from leastaction.optimal.discrete.hessians import ModelHessian
from leastaction.optimal.discrete.linear_quadratic import Workspace, sweep_forward
from leastaction.optimal.limits.cost import Jacobians, LimitedCost
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.quantity import Instants
from leastaction.optimal.system import Linearization

_INSIDE = 0.995  # part of the way to the nearest bound that a step may go
_WARM = 1e-2  # least slack and multiplier to begin again with, in parts of what is typical
_DEARER = 10.0  # factor by which the price of an excess rises that is needed
_BINDING = 0.5  # multiplier, in parts of its price, from which on this rises


class WindowModel(NamedTuple):
    """What is known along a motion (x, u): values and derivatives of limits, dynamics, and the cost."""

    x: Array
    u: Array
    c: Sided
    jacobians: Jacobians
    linear: Linearization
    gradient: CostGradient
    plain: ModelHessian


@dataclass(frozen=True, eq=False)
class InteriorPoint:
    """Where the interior point method ended.

    ``dx`` (N+1, ndx), ``du`` (N, nu): the changes. ``K`` (N, nu, ndx): the gains of its last recursion, in memory of
    the method. ``iterations``, ``converged``: how many there were, and whether these were enough. ``excess``: the
    largest violation of a limit to first order, in its scale.
    """

    dx: Array
    du: Array
    K: Array
    iterations: int
    converged: bool
    excess: float


class _Slacks(NamedTuple):
    """Slacks, excesses, multipliers, and what these have left to their prices."""

    s: Array
    e: Array
    y: Array
    left: Array

    @property
    def gap(self) -> float:
        """The mean of the products that are to be zero."""
        return float(self.s @ self.y + self.e @ self.left) / (2 * len(self.s))

    def moved(self, length: float, ds: Array, de: Array, dy: Array) -> _Slacks:
        """Return them after a step."""
        return _Slacks(self.s + length * ds, self.e + length * de, self.y + length * dy, self.left - length * dy)


class InteriorProgram:
    """The method and its memory: slacks, excesses, multipliers and prices. Not for several threads.

    ``limited``: the limits. ``sizes``: N, ndx, nu. ``price``: of an excess of its scale, to begin with. ``scales``: of
    all limits. ``magnitude``: of the cost, where it falls by nothing.
    """

    def __init__(
        self, limited: LimitedCost, sizes: tuple[int, int, int], price: float, scales: Array, magnitude: float
    ) -> None:
        self.limited, self.scales, self.magnitude = limited, scales, magnitude
        self.rho = price / scales
        self.work = Workspace(*sizes)
        self.kept: tuple[Array, Array, Array] | None = None  # s, e, y of the last instant
        self._later: dict[int, Instants] = {}  # where what is so many steps later stands

    def solve(self, model: WindowModel, *, tolerance: float, most: int) -> InteriorPoint | None:
        """Return the solution, to within a tolerance relative to the cost's fall; None where there is no minimum."""
        values = model.c.flat
        if not len(values):
            return self._free(model)
        at = self._begin(values)
        z: tuple[Array, Array, Array] | None = None  # dx, du, and the change of the limits
        done, converged = 0, False
        while done < most and not converged:
            sigma = 1.0 / (at.s / at.y + at.e / at.left)
            weights = self._weights(model, sigma)
            r_s, r_e = -at.s * at.y, -at.e * at.left
            found = self._towards(model, at, sigma, weights, r_s, r_e)
            if found is None:
                return None
            ds, de, dy = _changes(values, found[2], at, sigma, r_s, r_e)
            after = at.moved(_length(at, ds, de, dy, inside=1.0), ds, de, dy)
            mu = at.gap * (after.gap / at.gap) ** 3
            r_s, r_e = mu + r_s - ds * dy, mu + r_e + de * dy
            found = self._towards(model, at, sigma, weights, r_s, r_e)
            if found is None:
                return None
            ds, de, dy = _changes(values, found[2], at, sigma, r_s, r_e)
            length = _length(at, ds, de, dy, inside=_INSIDE)
            at = at.moved(length, ds, de, dy)
            z = found if length == 1.0 else _between(z, found, length)
            done += 1
            off = float(np.abs((values + z[2] - at.s + at.e) / self.scales).max())
            converged = off < tolerance and 2 * len(values) * at.gap < tolerance * self._size(model, *z[:2])
        assert z is not None
        self.kept = at.s, at.e, at.y
        binding = at.y > _BINDING * self.rho
        if binding.any():
            self.rho = np.where(binding, _DEARER * self.rho, self.rho)
        excess = -float(((values + z[2]) / self.scales).min(initial=0.0))
        return InteriorPoint(z[0], z[1], self.work.K, done, converged, max(0.0, excess))

    def _weights(self, model: WindowModel, sigma: Array) -> ModelHessian:
        """Return the second derivatives of the cost with the stiffness of limits."""
        dynamics = None
        if any(rows.quantity.looks_ahead for rows in self.limited.rows):
            dynamics = np.concatenate([model.linear.A, model.linear.B], axis=2)
        stiff = Sided(sigma, model.c.layout)
        return self.limited.hessian(model.x, model.u, stiff, model.jacobians, dynamics, plain=model.plain, share=0.0)

    def _towards(
        self, model: WindowModel, at: _Slacks, sigma: Array, weights: ModelHessian, r_s: Array, r_e: Array
    ) -> tuple[Array, Array, Array] | None:
        """Return where Newton's step leads to, and how limits change on the way; None where there is no minimum.

        ``r_s``, ``r_e``: what the products of slacks and excesses are to change by.
        """
        w = at.y + sigma * (at.s - at.e - model.c.flat + r_s / at.y - r_e / at.left)
        slopes = self.limited.with_duals(model.gradient, Sided(w, model.c.layout), model.jacobians)
        linear = model.linear
        law = minimise_model("quasi-newton", linear, slopes, weights, None, self.work)
        if not law.definite:
            return None
        dx, du = sweep_forward(linear.A, linear.B, law, pattern=linear.pattern)
        return dx, du, self.limited.along(dx, du, model.jacobians).flat

    def shift(self, steps: int) -> None:
        """Have slacks and multipliers go along with a horizon that has moved on."""
        if self.kept is None or not steps:
            return
        if steps not in self._later:
            places = np.arange(self.limited.layout.ends[-1], dtype=np.float64)
            for side in Sided(places, self.limited.layout):
                by = min(steps, len(side) - 1)
                if by > 0:
                    side[:-by] = side[by:].copy()
            self._later[steps] = places.astype(np.intp)
        s, e, y = (flat[self._later[steps]] for flat in self.kept)
        self.kept = s, e, y

    def _free(self, model: WindowModel) -> InteriorPoint | None:
        """Return the solution where there are no limits."""
        linear = model.linear
        law = minimise_model("quasi-newton", linear, model.gradient, model.plain, None, self.work)
        if not law.definite:
            return None
        dx, du = sweep_forward(linear.A, linear.B, law, pattern=linear.pattern)
        return InteriorPoint(dx, du, self.work.K, 1, True, 0.0)

    def _begin(self, values: Array) -> _Slacks:
        """Return slacks, excesses and multipliers to begin with: those of the last instant, off their bounds."""
        rho, scales = self.rho, self.scales
        if self.kept is None:
            y = 1e-3 * rho
            return _Slacks(np.maximum(values, 0.1 * scales), np.maximum(-values, _WARM * scales), y, rho - y)
        # What was active may be so no more, and the other way round.
        s, e, y = self.kept
        y = np.clip(y, 1e-6 * rho, 0.9 * rho)
        s = np.maximum(np.maximum(values, s), _WARM * scales)
        return _Slacks(s, np.maximum(np.maximum(-values, e), _WARM**2 * scales), y, rho - y)

    def _size(self, model: WindowModel, dx: Array, du: Array) -> float:
        """Return what the cost changes by, to first order, and what it is about, which a gap is measured in."""
        q, r, q_final = model.gradient
        return abs(float(np.vdot(q, dx[:-1]) + np.vdot(r, du) + q_final @ dx[-1])) + self.magnitude


def _between(
    z: tuple[Array, Array, Array] | None, found: tuple[Array, Array, Array], length: float
) -> tuple[Array, Array, Array]:
    """Return what is so far on the way from one solution, or none, to the next."""
    if z is None:
        return length * found[0], length * found[1], length * found[2]
    a, b, c = (now + length * (then - now) for now, then in zip(z, found, strict=True))
    return a, b, c


def _changes(
    values: Array, moved: Array, at: _Slacks, sigma: Array, r_s: Array, r_e: Array
) -> tuple[Array, Array, Array]:
    """Return the changes of slacks, excesses and multipliers that go with limits that have changed by `moved`."""
    dy = sigma * (at.s - at.e - values - moved + r_s / at.y - r_e / at.left)
    return (r_s - at.s * dy) / at.y, (r_e + at.e * dy) / at.left, dy


def _length(at: _Slacks, ds: Array, de: Array, dy: Array, *, inside: float) -> float:
    """Return how far slacks, excesses and multipliers may go until one of them is all but at its bound; at most 1."""
    # The largest rate at which one of them falls, in parts of itself.
    rate = -float(np.concatenate([ds / at.s, de / at.e, dy / at.y, -dy / at.left]).min(initial=0.0))
    return 1.0 if rate <= inside else inside / rate
