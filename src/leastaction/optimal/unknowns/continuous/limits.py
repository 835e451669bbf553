"""Limits of a continuous system as those of the extended one, on the points of a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.limits import Points
from leastaction.optimal.limits.charts import numbered
from leastaction.optimal.limits.limit import Bound, Limit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Entries, Quantity
from leastaction.optimal.unknowns.conditions import rows_of_bound, rows_of_condition
from leastaction.optimal.unknowns.continuous.system import ExtendedContinuousSystem
from leastaction.optimal.unknowns.quantity import ExtendedQuantity, changing_parameters
from leastaction.optimal.unknowns.unknown import Unknown


@dataclass(frozen=True, eq=False)
class OfOwnStates(Limit):
    """A limit that is stated of a continuous system, for the extended one; ``guess`` (P,): values of its unknowns."""

    limit: Limit
    guess: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", self.limit.at)

    def __str__(self) -> str:
        return str(self.limit)

    def rows(self, system: Points, first: int) -> list[Rows]:
        extended: Any = system.system
        found = []
        for i, row in enumerate(self.limit.rows(system.of(extended.system), first)):
            own = numbered(row.quantity, extended.system.space)
            if isinstance(own, Entries) and not (own.of_state and np.isin(own.places, extended.copied).any()):
                found.append(row)  # They stand where they stood.
                continue

            def of(other: Any, i: int = i) -> Quantity:
                return numbered(self.limit.rows(system.of(other), first)[i].quantity, other.space)

            quantity = ExtendedQuantity(extended, own, of, changing_parameters(extended, of, self.guess))
            # What a parameter moves is not known of the start yet.
            found.append(replace(row, quantity=quantity, start=row.start if quantity.fixed else None))
        return found


@dataclass(frozen=True, eq=False)
class OfUnknowns(Limit):
    """Bounds of unknowns, which are constant."""

    bound: Bound
    unknowns: Sequence[Unknown]

    def __str__(self) -> str:
        return str(self.bound)

    def rows(self, system: Points, first: int) -> list[Rows]:  # noqa: ARG002 - that of the system's own states
        return rows_of_bound(self.bound, system, self.unknowns)


@dataclass(frozen=True, eq=False)
class OfCondition(Limit):
    """What unknowns have to keep to for there to be such a system."""

    condition: Quantity
    system: ExtendedContinuousSystem
    unknowns: Sequence[Unknown]
    guess: Array

    def rows(self, system: Points, first: int) -> list[Rows]:  # noqa: ARG002 - likewise
        return rows_of_condition(self.condition, self.system, self.unknowns, self.guess, system)
