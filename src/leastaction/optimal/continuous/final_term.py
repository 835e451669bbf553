"""Costs of the last state in continuous time."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.time_functions import TimeFunction
from leastaction.optimal.cost import Deviations, deviations, matrix_of, weigh
from leastaction.optimal.space import StateSpace, apart, bent_by_numbers, by_numbers


class FinalTerm(ABC):
    """A cost ``m(x, tf)`` of the last state (nx,) at the final time (s), with its derivatives by the state."""

    @abstractmethod
    def value(self, x: Array, t: float) -> float:
        """Return the cost."""

    @abstractmethod
    def gradient(self, x: Array, t: float) -> Array:
        """Return its gradient (nx,)."""

    @abstractmethod
    def hessian(self, x: Array, t: float) -> Array:
        """Return its second derivatives (nx, nx)."""

    @abstractmethod
    def convex_hessian(self, x: Array, t: float) -> Array:
        """Return positive semidefinite second derivatives, as Gauss and Newton's, for models far from a minimum."""


class QuadraticFinalTerm(FinalTerm):
    """Half the weighted square of the distance from a wanted last state.

    ``Q``: the weight, (nx,) or (nx, nx). ``x_wanted``: the wanted motion, at whose end the state is wanted if there is
    no ``x_final`` (nx,).
    """

    def __init__(self, space: StateSpace | None, Q: Array, x_wanted: TimeFunction, x_final: Array | None) -> None:
        self.space, self.Q, self.x_wanted, self.x_final = space, Q, x_wanted, x_final

    def value(self, x: Array, t: float) -> float:
        off = self._off(x, t)
        return 0.5 * float(off @ weigh(self.Q, off[None])[0])

    def gradient(self, x: Array, t: float) -> Array:
        if self.space is None:
            return np.asarray(matrix_of(self.Q) @ self._off(x, t))
        off = self._deviations(self.space, x, t)
        return np.asarray(by_numbers(self.space, x[None], off.gradient[:, None])[0, 0])

    def hessian(self, x: Array, t: float) -> Array:
        if self.space is None:
            return matrix_of(self.Q)
        off = self._deviations(self.space, x, t)
        return np.asarray(bent_by_numbers(self.space, x[None], off.gradient, off.squares + off.bend)[0])

    def convex_hessian(self, x: Array, t: float) -> Array:
        if self.space is None:
            return matrix_of(self.Q)
        off = self._deviations(self.space, x, t)
        return np.asarray(bent_by_numbers(self.space, x[None], np.zeros_like(off.gradient), off.squares)[0])

    def _deviations(self, space: StateSpace, x: Array, t: float) -> Deviations:
        return deviations(space, self.Q, x[None], self._wanted(t)[None])

    def _off(self, x: Array, t: float) -> Array:
        return apart(self.space, x, self._wanted(t))

    def _wanted(self, t: float) -> Array:
        if self.x_final is not None:
            return self.x_final
        # The wanted motion may jump at the end: what holds until then counts.
        return self.x_wanted.at(float(np.nextafter(t, -np.inf)))
