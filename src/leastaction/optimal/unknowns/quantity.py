"""A quantity of a system as one of the extended system: where its parameters change, so may the quantity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants, Quantity, Samples
from leastaction.optimal.unknowns.system import ExtendedSystem, by_differences

__all__ = ["ExtendedQuantity"]


class ExtendedQuantity(Quantity):
    """A quantity of the system's own states, at the parameters of the extended state.

    Derivatives by the parameters are differences of fourth order. ``of``: returns the quantity of a system.
    """

    def __init__(self, system: ExtendedSystem, own: Quantity, of: Callable[[Any], Quantity]) -> None:
        self.system, self.own, self.of = system, own, of
        self.names, self.kind, self.unit = own.names, own.kind, own.unit
        self.of_state, self.looks_ahead, self.says_all, self.first = (
            own.of_state, own.looks_ahead, own.says_all, own.first
        )  # fmt: skip
        # One that is always the same object depends on nothing else.
        self.fixed = not system.names or of(system.system) is own

    def columns(self, nx: int, nu: int) -> Instants:
        """Return the places of the system's own entries, and of the parameters."""
        n, count = self.system.n_own, len(self.system.names)
        places = self.own.columns(n, nu)
        if places is None:
            places = np.arange(n if self.of_state else 2 * n + nu if self.looks_ahead else n + nu)
        moved = places + np.where(places < n, 0, np.where(places < n + nu, nx - n, 2 * (nx - n)))
        moved = np.where(places >= n + nu, places - n + nx, moved)
        return moved if self.fixed else np.concatenate([moved, np.arange(n, n + count)])

    def values(self, at: Samples) -> Array:
        """Return the values."""
        own, values = self._split(at)
        return self._at(values).values(own)

    def jacobian(self, at: Samples) -> Array:
        """Return the first derivatives."""
        own, values = self._split(at)
        J = self._at(values).jacobian(own)
        if self.fixed:
            return J
        return np.concatenate([J, self._by_parameters(own, values)], axis=2)

    def curvature(self, at: Samples, y: Array) -> Array | None:
        """Return the second derivative of ``y . values``."""
        own, values = self._split(at)
        H = self._at(values).curvature(own, y)
        if self.fixed:
            return H

        def slope(moved: Array) -> Array:
            J = np.concatenate([self._at(moved).jacobian(own), self._by_parameters(own, moved)], axis=2)
            return np.asarray(np.einsum("kmi,km->ki", J, y))

        columns = [by_differences(slope, values, j) for j in range(len(values))]
        mixed = np.stack(columns, axis=2)
        n = mixed.shape[1] - len(values)
        whole = np.zeros((len(y), mixed.shape[1], mixed.shape[1]))
        if H is not None:
            whole[:, :n, :n] = H
        whole[:, :n, n:], whole[:, n:, :n] = mixed[:, :n], mixed[:, :n].transpose(0, 2, 1)
        whole[:, n:, n:] = 0.5 * (mixed[:, n:] + mixed[:, n:].transpose(0, 2, 1))
        return whole

    def _split(self, at: Samples) -> tuple[Samples, Array]:
        """Return what the system's own quantity is given, and the parameters (P,)."""
        n = self.system.n_own
        own = Samples(at.k, np.ascontiguousarray(at.x[:, :n]), at.u, np.ascontiguousarray(at.x_next[:, :n]))
        return own, self.system.values(at.x[0]).copy()

    def _at(self, values: Array) -> Quantity:
        return self.own if self.fixed else self.of(self.system.at(values))

    def _by_parameters(self, own: Samples, values: Array) -> Array:
        """Return the derivatives by the parameters (n, m, P)."""
        return np.stack(
            [by_differences(lambda p: self._at(p).values(own), values, j) for j in range(len(values))], axis=2
        )
