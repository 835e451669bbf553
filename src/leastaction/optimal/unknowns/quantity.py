"""A quantity of a system as one of the extended system: where its parameters change, so may the quantity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants, Quantity, QuantityElsewhere, QuantityView, Samples
from leastaction.optimal.unknowns.extended import Extended, by_differences, stepped

Of = Callable[[Any], Quantity]


def changing_parameters(system: Extended, of: Of, values: Array) -> Instants:
    """Return which parameters change the quantity ``of`` a system, as seen by a step from their values (P,)."""
    own = system.at(values)
    plain, found = of(own), []
    for j in range(len(values)):
        other = system.near(stepped(values, j))
        if other is not own and not plain.is_like(of(other)):
            found.append(j)
    return np.array(found, dtype=np.intp)


class ExtendedQuantity(QuantityView):
    """A quantity of the system's own states, at the parameters of the extended state.

    Derivatives by the parameters are differences of fourth order. ``of``: returns the quantity of a system.
    ``changing``: which parameters change it (see `changing_parameters`).
    """

    def __init__(self, system: Extended, own: Quantity, of: Of, changing: Instants) -> None:
        super().__init__(own)
        self.system, self.of, self.changing = system, of, changing
        self.fixed = not len(changing)
        n, nx, nu, layout = system.d_own, system.ndx, system.nu, system.layout
        copied, at = layout.copied_moves, layout.at_copied_moves
        if own.by_entries:
            n, nx, copied, at = system.n_own, system.nx, layout.copied, layout.at_copies
        places = own.all_columns(n, nu)
        # How the system's own entries and the parameters follow from entries of the extended system.
        count = len(self.changing)
        kept = (places[:, None] == copied) | (places[:, None] == n + nu + copied)
        moved = np.flatnonzero(kept.any(axis=0))
        kept = np.vstack([kept[:, moved], np.zeros((count, len(moved)))])
        self._moves = np.hstack([np.eye(len(places) + count), kept]) if len(moved) else None
        own_places = np.where(places < n, places, places + nx - n)
        self._columns = np.concatenate([own_places, n + self.changing, at + moved])

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002 - those of the extended system
        """Return the places of the system's own entries, of the parameters, and of what is kept of the first state."""
        return self._columns

    def values(self, at: Samples) -> Array:
        own, values = self._split(at)
        return self._at(values).values(own)

    def jacobian(self, at: Samples) -> Array:
        own, values = self._split(at)
        J = self._jacobian(own, values)
        return J if self._moves is None else np.asarray(J @ self._moves)

    def curvature(self, at: Samples, y: Array) -> Array | None:
        own, values = self._split(at)
        H = self._at(values).curvature(own, y)
        if self.fixed:
            return None if H is None else self._moved(H)

        def slope(at_values: Array) -> Array:
            return np.asarray(np.einsum("kmi,km->ki", self._jacobian(own, at_values), y))

        mixed = np.stack([by_differences(slope, values, j) for j in self.changing.tolist()], axis=2)
        n = mixed.shape[1] - len(self.changing)
        whole = np.zeros((len(y), mixed.shape[1], mixed.shape[1]))
        if H is not None:
            whole[:, :n, :n] = H
        whole[:, :n, n:], whole[:, n:, :n] = mixed[:, :n], mixed[:, :n].transpose(0, 2, 1)
        whole[:, n:, n:] = 0.5 * (mixed[:, n:] + mixed[:, n:].transpose(0, 2, 1))
        return self._moved(whole)

    def joined(self, others: Sequence[Quantity]) -> Quantity | None:
        parts = self.among(others)

        def joint(wholes: Sequence[Quantity]) -> Quantity | None:
            first, *rest = wholes
            return first.joined(rest) if all(type(each) is type(first) for each in rest) else None

        own = joint([part.whole for part in parts])
        if own is None or not all(np.array_equal(part.changing, self.changing) for part in parts):
            return None

        def of(system: Any) -> Quantity:
            return joint([part.of(system) for part in parts]) or own

        return ExtendedQuantity(self.system, own, of, self.changing)

    def _jacobian(self, own: Samples, values: Array) -> Array:
        """Return the derivatives by the system's own entries, and by the parameters."""
        at = self._at(values)
        by = [by_differences(lambda p: self._at(p).values(own), values, j)[:, :, None] for j in self.changing.tolist()]
        return np.concatenate([at.jacobian(own), *by], axis=2)

    def _moved(self, H: Array) -> Array:
        return H if self._moves is None else np.asarray(self._moves.T @ H @ self._moves)

    def _split(self, at: Samples) -> tuple[Samples, Array]:
        """Return what the system's own quantity is given, and the parameters (P,)."""
        x_next = self.system.own(at.x_next) if at.x_next.shape[1] else at.x_next
        return Samples(at.k, self.system.own(at.x), at.u, x_next), self.system.values(at.x[0]).copy()

    def _at(self, values: Array) -> Quantity:
        return self.whole if self.fixed else self.of(self.system.near(values))


class QuantityOfUnknowns(QuantityElsewhere):
    """A quantity of the parameters, given as states (n, P), at those of the extended state."""

    def __init__(self, system: Extended, whole: Quantity) -> None:
        super().__init__(whole)
        self.places, self.by_entries = np.arange(system.n_own, system.layout.at_copies), False
        self.changes = np.arange(system.d_own, system.d_own + len(system.names))

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002 - those of the parameters
        return self.changes

    def seen(self, at: Samples) -> Samples:
        return at._replace(x=at.x[:, self.places])
