"""Limits on states that are no plain vectors: derivatives by charts in place of those by entries, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Entries, Instants, Quantity, QuantityView, Samples
from leastaction.optimal.space import StateSpace, bent_by_numbers, by_numbers


class ChartedQuantity(QuantityView):
    """A quantity that derives itself by the entries of a state (nx), with derivatives by its directions (ndx)."""

    def __init__(self, whole: Quantity, space: StateSpace) -> None:
        super().__init__(whole)
        self.space, self.by_entries = space, False

    def columns(self, nx: int, nu: int) -> None:
        """Return None: it may depend on all."""

    def values(self, at: Samples) -> Array:
        return self.whole.values(at)

    def jacobian(self, at: Samples) -> Array:
        return np.asarray(self.whole.whole_jacobian(at, at.x.shape[1], at.u.shape[1]) @ self._moves(at))

    def curvature(self, at: Samples, y: Array) -> Array:
        space, moves = self.space, self._moves(at)
        n, nx = at.x.shape
        pull = np.einsum("kmi,km->ki", self.whole.whole_jacobian(at, nx, at.u.shape[1]), y)
        bent = np.zeros((n, moves.shape[2], moves.shape[2]))
        bent[:, : space.ndx, : space.ndx] = space.plus_curvature(at.x, pull[:, :nx])
        own = self.whole.curvature(at, y)
        if own is not None:
            places = self.whole.all_columns(nx, at.u.shape[1])
            bent += np.swapaxes(moves[:, places], 1, 2) @ own @ moves[:, places]
        return bent

    def _moves(self, at: Samples) -> Array:
        """Return the derivatives of (x, u) by directions and inputs."""
        P, nu = self.space.plus_derivative(at.x), 0 if self.of_state else at.u.shape[1]
        n, nx, ndx = P.shape
        moves = np.zeros((n, nx + nu, ndx + nu))
        moves[:, :nx, :ndx], moves[:, nx:, ndx:] = P, np.eye(nu)
        return moves


class PlainEntries(QuantityView):
    """Entries of a state that are subtracted and added, with derivatives by the directions ``places`` (m,) they are."""

    def __init__(self, whole: Entries, places: Instants) -> None:
        super().__init__(whole)
        self.places, self.by_entries = places, False
        self._slopes = np.diag(whole.factors)

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        return self.places

    def values(self, at: Samples) -> Array:
        return self.whole.values(at)

    def jacobian(self, at: Samples) -> Array:
        return np.broadcast_to(self._slopes, (len(at.k), *self._slopes.shape))

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""


class NumberedQuantity(QuantityView):
    """A quantity that derives itself by directions of a state (ndx), with derivatives by its numbers (nx).

    For continuous time, where numbers are steered; those of a mesh may be a little off the states.
    """

    def __init__(self, whole: Quantity, space: StateSpace) -> None:
        super().__init__(whole)
        self.space, self.by_entries = space, True

    def columns(self, nx: int, nu: int) -> None:
        """Return None: it may depend on all."""

    def values(self, at: Samples) -> Array:
        return self.whole.values(self._states(at))

    def jacobian(self, at: Samples) -> Array:
        return by_numbers(self.space, at.x, self._slopes(self._states(at)))

    def curvature(self, at: Samples, y: Array) -> Array:
        there = self._states(at)
        slope = np.einsum("kmi,km->ki", self._slopes(there), y)
        bent = np.zeros((*slope.shape, slope.shape[1]))
        own = self.whole.curvature(there, y)
        if own is not None:
            places = self.whole.all_columns(self.space.ndx, at.u.shape[1])
            bent[:, places[:, None], places] = own
        return bent_by_numbers(self.space, at.x, slope, bent)

    def _states(self, at: Samples) -> Samples:
        """Return the samples with states in place of numbers that are near them."""
        return at._replace(x=self.space.plus(at.x, np.zeros((len(at.x), self.space.ndx))))

    def _slopes(self, at: Samples) -> Array:
        return self.whole.whole_jacobian(at, self.space.ndx, at.u.shape[1])


def numbered(quantity: Quantity, space: StateSpace | None) -> Quantity:
    """Return a quantity with derivatives by numbers of states, as those of plain vectors are anyway."""
    if space is None or quantity.by_entries or isinstance(quantity, Entries):
        return quantity
    return NumberedQuantity(quantity, space)


def charted(rows: Sequence[Rows], space: StateSpace | None) -> list[Rows]:
    """Return rows with derivatives by charts, as those of states that are plain vectors are anyway."""
    if space is None:
        return list(rows)
    made: dict[int, QuantityView] = {}
    found = []
    for each in rows:
        quantity = each.quantity
        if quantity.by_entries:
            # Both sides of a limit are of one quantity.
            each = replace(each, quantity=made.setdefault(id(quantity), _in_charts(quantity, space)))
        found.append(each)
    return found


def _in_charts(quantity: Quantity, space: StateSpace) -> QuantityView:
    """Return a quantity that derives itself by entries as one by directions, by as few of these as are known."""
    if isinstance(quantity, Entries) and len(set(quantity.places)) == len(quantity.places):
        moving = space.pattern[quantity.places] & ~space.curved
        if (space.pattern[quantity.places].sum(axis=1) == 1).all() and moving.any(axis=1).all():
            return PlainEntries(quantity, moving.argmax(axis=1))
    return ChartedQuantity(quantity, space)
