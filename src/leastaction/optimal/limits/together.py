"""Rows of limits that are asked at the same instants, taken at once: such as distances from many obstacles."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.sides import Sided, SideLayout
from leastaction.optimal.quantity import Instants, Quantity, QuantityView, Samples, names_of


class Together:
    """Some of the rows of a problem as `Rows` of one quantity, whose functions are all of theirs.

    ``rows``: what they are together. ``at`` (n, m): where their values are among those of all rows.
    """

    def __init__(self, parts: Sequence[Rows], which: Sequence[int], quantity: Quantity, layout: SideLayout) -> None:
        self.at = np.hstack([np.arange(*layout.ends[i : i + 2]).reshape(layout.shapes[i]) for i in which])
        self.rows = parts[0]
        if len(parts) > 1:
            signs = [np.full(part.bounds.shape[1], part.sign) for part in parts]
            bounds, scale = np.hstack([p.sign * p.bounds for p in parts]), np.concatenate([p.scale for p in parts])
            view = _Signed(quantity, [part.quantity for part in parts], np.concatenate(signs))
            self.rows = Rows("limits", view, 1.0, bounds, parts[0].k, scale)

    def of(self, values: Sided) -> Array:
        """Return the values (n, m) of these rows among those of all."""
        return values.flat.take(self.at)


class _Signed(QuantityView):
    """Functions of quantities, in their order, of one that is all of those; with signs (m,)."""

    def __init__(self, whole: Quantity, parts: Sequence[Quantity], signs: Array) -> None:
        super().__init__(whole)
        begins = np.cumsum([0, *(len(part.names) for part in _distinct(parts))])
        first = {id(part): begin for part, begin in zip(_distinct(parts), begins, strict=False)}
        self._of = np.concatenate([first[id(part)] + np.arange(len(part.names)) for part in parts])
        self._signs, self.names = signs, tuple(whole.names[j] for j in self._of)
        self._sums = np.zeros((len(signs), len(whole.names)))
        self._sums[np.arange(len(signs)), self._of] = signs

    def columns(self, nx: int, nu: int) -> Instants | None:
        return self.whole.columns(nx, nu)

    def values(self, at: Samples) -> Array:
        return np.asarray(self.whole.values(at)[:, self._of] * self._signs)

    def jacobian(self, at: Samples) -> Array:
        return np.asarray(self.whole.jacobian(at)[:, self._of] * self._signs[:, None])

    def curvature(self, at: Samples, y: Array) -> Array | None:
        return self.whole.curvature(at, y @ self._sums)


class _Beside(Quantity):
    """Several quantities that depend on the same entries."""

    def __init__(self, parts: Sequence[Quantity], columns: Instants) -> None:
        self.parts, self._columns = tuple(parts), columns
        self.names = names_of(parts)
        self.of_state, self.looks_ahead = parts[0].of_state, parts[0].looks_ahead
        self._ends = np.cumsum([len(part.names) for part in parts])[:-1]

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        return self._columns

    def values(self, at: Samples) -> Array:
        return np.hstack([part.values(at) for part in self.parts])

    def jacobian(self, at: Samples) -> Array:
        return np.concatenate([part.jacobian(at) for part in self.parts], axis=1)

    def curvature(self, at: Samples, y: Array) -> Array | None:
        weights = np.split(y, self._ends, axis=1)
        each = [part.curvature(at, weight) for part, weight in zip(self.parts, weights, strict=True)]
        bent = [H for H in each if H is not None]
        return np.asarray(sum(bent[1:], bent[0])) if bent else None


def together(rows: Sequence[Rows], which: Sequence[int], layout: SideLayout, nx: int, nu: int) -> list[Together]:
    """Return some of the rows of a problem, as few at a time as those that are alike can be.

    Alike are those of the same instants whose quantities can be joined, or depend on the same entries.
    """
    found = []
    for group in _grouped(which, lambda i: (rows[i].k.tobytes(), *_kind(rows[i].quantity))):
        first, *others = _distinct([rows[i].quantity for i in group])
        joined = first.joined(others) if others else first
        if joined is not None:
            found.append(Together([rows[i] for i in group], group, joined, layout))
            continue
        for part in _grouped(group, lambda i: rows[i].columns(nx, nu).tobytes()):
            quantities = _distinct([rows[i].quantity for i in part])
            beside = _Beside(quantities, rows[part[0]].columns(nx, nu)) if len(quantities) > 1 else quantities[0]
            found.append(Together([rows[i] for i in part], part, beside, layout))
    return found


def _kind(quantity: Quantity) -> tuple[Hashable, ...]:
    return type(quantity), quantity.of_state, quantity.looks_ahead


def _distinct(quantities: Sequence[Quantity]) -> list[Quantity]:
    """Return quantities without those that are the same object as an earlier one."""
    return list({id(quantity): quantity for quantity in quantities}.values())


def _grouped(which: Sequence[int], key: Callable[[int], Hashable]) -> list[list[int]]:
    """Return indices in groups of the same key, in the order in which these come first."""
    groups: dict[Hashable, list[int]] = defaultdict(list)
    for i in which:
        groups[key(i)].append(i)
    return list(groups.values())
