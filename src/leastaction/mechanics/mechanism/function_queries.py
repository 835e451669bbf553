"""The functions that a mechanism is made of, of the whole or of one element alone; `Mechanism` asks for them.

What is here evaluates them; see `leastaction.mechanics.mechanism.function_derivatives.Evaluate`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from leastaction import _core
from leastaction.mechanics.elements import Parts
from leastaction.numerics.arrays import Array


class Compiled(Protocol):
    """A mechanism, as far as it is asked here."""

    core: _core.Mechanism
    nq: int
    n_inputs: int


@dataclass(frozen=True)
class PotentialAt:
    """Potentials by q at a configuration (nq,): their sum."""

    mechanism: Compiled
    parts: Parts
    q: Array

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        n, parts = self.mechanism.nq, self.parts
        first, last = parts.first.potentials, parts.last.potentials
        each = np.full(last - first, weights[0])
        values, gradients, hessian = self.mechanism.core.potentials(first, last, each, self.q, directions)
        value, gradient, bend = values.sum(keepdims=True), gradients.reshape(-1, n).sum(0), hessian.reshape(n, n)
        if parts.uniform_gravity:
            still = np.zeros_like(directions)
            L, slope, second = self.mechanism.core.lagrangian_of_bodies(self.q, np.zeros(n), directions, still)
            value = value - L
            gradient = gradient - slope[0, :n]
            bend = bend - weights[0] * second.reshape(2 * n, 2 * n)[:n, :n]
        return value, gradient[None], bend


@dataclass(frozen=True)
class LagrangianAt:
    """The Lagrangian by [q; v] at a state (nq,), (nq,)."""

    mechanism: Compiled
    parts: Parts
    q: Array
    v: Array

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        n, parts = self.mechanism.nq, self.parts
        dq, dv = (np.ascontiguousarray(half) for half in (directions[:, :n], directions[:, n:]))
        value, gradient, hessian = self.mechanism.core.lagrangian_of_bodies(self.q, self.v, dq, dv)
        second = weights[0] * hessian.reshape(2 * n, 2 * n)
        # Along a direction in which only the velocity changes, the potentials do not.
        V, V_q, V_qq = PotentialAt(self.mechanism, parts.without_gravity(), self.q)(dq, weights)
        gradient[0, :n] -= V_q[0]
        second[:n, :n] -= V_qq
        return value - V, gradient, second


@dataclass(frozen=True)
class ConstraintsAt:
    """Constraint functions by q at a configuration (nq,)."""

    mechanism: Compiled
    parts: Parts
    q: Array

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        n, first, last = self.mechanism.nq, self.parts.first.constraints, self.parts.last.constraints
        found = self.mechanism.core.constraint_functions(first, last, weights, self.q, directions)
        values, gradients, hessian = found
        return values, gradients.reshape(-1, n), hessian.reshape(n, n)


@dataclass(frozen=True)
class ForceAt:
    """Generalised forces (nq,) by [q; v; u] at a state and inputs; without derivatives along directions."""

    mechanism: Compiled
    parts: Parts
    q: Array
    v: Array
    u: Array

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        assert not len(directions), "forces have a highest order of two"
        core, at = self.mechanism.core, (self.q, self.v, self.u)
        parts = _core.ElementParts(self.parts.first, self.parts.last)
        gradients = np.hstack(core.force_jacobians(*at, parts))
        return core.force(*at, parts), gradients, core.force_curvature(*at, weights, parts)
