"""What unknowns have to keep to for there to be such a system."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.limits.limit import Bound
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Entries, Quantity, Samples
from leastaction.optimal.unknowns.extended import Extended
from leastaction.optimal.unknowns.quantity import QuantityOfUnknowns
from leastaction.optimal.unknowns.unknown import Unknown

_BORDER, _OFF = 1e-9, 1e-3  # largest distance at which a condition is active, and that of a start; both relative


def rows_of_condition(
    condition: Quantity, system: Extended, unknowns: Sequence[Unknown], guess: Array, instants: Any = None
) -> list[Rows]:
    """Return the row of what parameters have to keep to, where no bound says more.

    ``instants``: those of the system by which limits are stated, where that is not the system itself.
    """
    if isinstance(condition, Entries):
        least = {each.name: -np.inf if each.min is None else each.min for each in unknowns}
        own: Any = instants or system
        names = [name for name in condition.names if least[name] < 0.0]
        rows = Bound(names, 0.0, of="unknown", at="start").rows(own, 0) if names else []
        return [replace(row, is_asked=False) for row in rows]
    quantity, count = QuantityOfUnknowns(system, condition), len(condition.names)
    size, start = size_of(values_of(condition, guess)[0]), np.zeros(1, dtype=np.intp)
    return [Rows("unknowns", quantity, 1.0, np.zeros((1, count)), start, np.full(count, size), is_asked=False)]


def rows_of_bound(bound: Bound, system: Any, unknowns: Sequence[Unknown]) -> list[Rows]:
    """Return the rows of bounds of unknowns, which are constant: they hold at the start."""
    prices = {each.name: abs(each.price) for each in unknowns}
    rows = replace(bound, of="unknown", at="start").rows(system, 0)
    return [replace(row, worth=np.array([prices.get(name, 0.0) for name in row.quantity.names])) for row in rows]


def is_of_unknowns(limit: Bound, names: Collection[str]) -> bool:
    """Whether a limit is one on unknowns with these names."""
    if limit.of is not None:
        return limit.of == "unknown"
    limited = [limit.names] if isinstance(limit.names, str) else list(limit.names)
    return bool(limited) and all(name in names for name in limited)


def values_of(condition: Quantity, values: Array) -> tuple[Array, Array]:
    """Return the functions (m,) of a condition at values (P,) of the parameters, and their derivatives (m, P)."""
    at = Samples(np.zeros(1, dtype=np.intp), values[None], *[np.empty((1, 0))] * 2)
    return condition.values(at)[0], condition.whole_jacobian(at, len(values), 0)[0]


def size_of(values: Array) -> float:
    """Return what is large for the functions of a condition."""
    return float(np.abs(values).max()) or 1.0


def off_the_border(condition: Quantity, values: Array) -> Array:
    """Return values (P,) a little inside of a condition, where they are at its border: no search can begin there."""
    c, slopes = values_of(condition, values)
    at = c <= _BORDER * size_of(c)
    return np.asarray(values + _OFF * size_of(c) * (slopes[at] / np.sum(slopes[at] ** 2, axis=1)[:, None]).sum(axis=0))
