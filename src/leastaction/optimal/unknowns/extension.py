"""An optimisation with unknowns beside the inputs, as one of an extended system."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.own_projection import with_projection
from leastaction.optimal.discrete.system import DiscreteSystem, told_of
from leastaction.optimal.initial import pair_of
from leastaction.optimal.limits.limit import Bound, Limit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.loop import Callback
from leastaction.optimal.options import Options
from leastaction.optimal.quantity import Entries
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.unknowns.conditions import is_of_unknowns, off_the_border, rows_of_bound, rows_of_condition
from leastaction.optimal.unknowns.cost import ExtendedCost
from leastaction.optimal.unknowns.extended import told_in_own_states
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.optimal.unknowns.quantity import ExtendedQuantity, changing_parameters
from leastaction.optimal.unknowns.system import ExtendedSystem
from leastaction.optimal.unknowns.unknown import Unknown


class Extension:
    """The extended system and cost of an optimisation, and the way there and back for all that is given and returned.

    Attributes
    ----------
    system : ExtendedSystem
    cost : ExtendedCost
    """

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        unknowns: Sequence[Unknown],
        limits: Sequence[Limit],
        free_start: bool | Sequence[str],
    ) -> None:
        self.own, self.unknowns, self.limits = system, tuple(unknowns), tuple(limits)
        self.first = 1 if free_start is False else 0
        known = np.array([each.value_of(system) for each in unknowns])
        self.guess = np.array([v if e.guess is None else e.guess for e, v in zip(unknowns, known, strict=True)])
        wanted = np.array([v if e.wanted is None else e.wanted for e, v in zip(unknowns, known, strict=True)])
        copied = {i for limit in limits if isinstance(limit, Periodic) for i in limit.entries(system)}
        names = [each.name for each in unknowns]
        self.system = ExtendedSystem(system, names, sorted(copied) if self.first == 0 else [], free_start)
        self.cost = ExtendedCost(cost, unknowns, wanted, self.system)
        self.system.at(self.guess)  # values that cannot be are named before anything is done
        self.conditions = system.conditions_of(names) or []
        for condition in self.conditions:
            self.guess = off_the_border(condition, self.guess)

    def rows(self) -> list[Rows]:
        """Return the rows of all limits, those of the unknowns too."""
        found = []
        for each in self.unknowns:
            if each.min is not None or each.max is not None:
                found += rows_of_bound(Bound(each.name, each.min, each.max), self.system, self.unknowns)
        for limit in self.limits:
            found += self._rows(limit)
        for condition in self.conditions:
            found += rows_of_condition(condition, self.system, self.unknowns, self.guess)
        return found

    def settings(self, given: Options) -> Options:
        """Return options for the extended system: gains and weights of a projection act on the system's own states."""
        return with_projection(given, self.own, self.cost.moved, self.cost.padded)

    def _rows(self, limit: Limit) -> list[Rows]:
        if isinstance(limit, Periodic):
            return limit.rows(self.system, self.first)
        if isinstance(limit, Bound) and is_of_unknowns(limit, self.system.names):
            return rows_of_bound(limit, self.system, self.unknowns)
        rows = limit.rows(self.own, self.first)
        return [self._extended(limit, i, row) for i, row in enumerate(rows)]

    def _extended(self, limit: Limit, i: int, row: Rows) -> Rows:
        own = row.quantity
        if isinstance(own, Entries) and not (own.of_state and np.isin(own.places, self.system.copied).any()):
            return row  # They stand where they stood.
        of = lambda system: limit.rows(system, self.first)[i].quantity  # noqa: E731
        quantity = ExtendedQuantity(self.system, own, of, changing_parameters(self.system, of, self.guess))
        # What a parameter moves is not known of the start yet.
        return replace(row, quantity=quantity, start=row.start if quantity.fixed else None)

    # ---- There ------------------------------------------------------------------------------------

    def start(self, initial: Any) -> Any:
        """Return a start for the extended system."""
        if isinstance(initial, OptimizationResult):
            return replace(initial, x=self._states(initial.x, self._values(initial)))
        x, u = pair_of(initial)
        N, nx = self.own.N, self.own.nx
        x = as_array(x, "initial x", (N + 1, nx), (nx,), meaning="(N+1, nx) or an initial state (nx,)")
        states = self._states(x, self.guess)
        self._check(states if states.ndim == 1 else states[0], np.atleast_2d(u)[0])
        return states, u

    def _check(self, x: Array, u: Array) -> None:
        """Ask for the derivatives by the unknowns, so that what they cannot be found for is said before the first step.

        Raises `ArgumentError`: from the system.
        """
        self.system.start_directions(x, None)
        with suppress(StepError):  # The start need not be a trajectory.
            self.system.derivatives(x, as_array(u, "initial u", (self.own.nu,)), 0)

    def resume(self, result: OptimizationResult) -> OptimizationResult:
        """Return an earlier result as one of the extended system."""
        missing = [name for name in self.system.names if name not in result.unknowns]
        if missing:
            raise ArgumentError(f"resume: got a result without the unknown {missing[0]!r}; give initial=result instead")
        return replace(result, x=self._states(result.x, self._values(result)))

    def _states(self, x: Any, values: Array) -> Array:
        states = as_array(x, "x", (self.own.N + 1, self.own.nx), (self.own.nx,), meaning="(N+1, nx)")
        return self.system.extended(states, values)

    def _values(self, result: OptimizationResult) -> Array:
        """Return the unknowns of a result; the guesses of those that it does not know."""
        pairs = zip(self.system.names, self.guess, strict=True)
        return np.array([result.unknowns.get(name, guess) for name, guess in pairs])

    # ---- And back ---------------------------------------------------------------------------------

    def callback(self, given: Callback | None) -> Callback | None:
        """Return a callback that calls the given one with the system's own states."""
        return told_in_own_states(given, lambda x: self.system.own(x), self.result)

    def result(self, found: OptimizationResult) -> OptimizationResult:
        """Return a result in the system's own states, with its unknowns."""
        n = self.own.ndx
        at = self.system.values(found.x[0])
        return replace(
            found,
            **told_of(self.system.at(at)),
            x=read_only(self.system.own(found.x)),
            K=np.ascontiguousarray(found.K[:, :, :n]),
            unknowns=MappingProxyType(dict(zip(self.system.names, at.tolist(), strict=True))),
        )
