"""Motions that return: the last state is the first one, or so far from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.public import public
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.looking_back import BEFORE
from leastaction.optimal.quantity import Entries, Instants, Quantity, Samples
from leastaction.optimal.system import System, returning_entries, returning_name
from leastaction.optimal.unknowns.extended import Extended
from leastaction.optimal.unknowns.returning import Returning, TurnedBack, TurnedByNumbers


@public
@dataclass(frozen=True)
class Periodic(Limit):
    """Equations ``x_N = x_0 + offset`` of entries of the state, for a motion that may go on like this for ever.

    A rotation that is a quaternion returns as a whole, as it was: ``log(q_0^-1 q_N) = 0``.

    A limit on how fast inputs change, or on accelerations, holds from the last step to the first as well, where all
    that it is of returns: inputs always do.

    The initial state has to be free, ``optimize(..., free_start=True)``, or some entries of it. The cost has to weigh
    all that is free, or it is held there, such as the place of a walker: ``free_start=["knee", "p_*"]``.

    Parameters
    ----------
    names : str or sequence of str
        Entries, by the names of ``system.quantity("state")``, with wildcards: of a `MidpointSystem` its variables,
        ``"p_..."`` for momenta and ``"v_..."`` for rates of prescribed variables; the name of a joint for the
        quaternion that it turns by. Multipliers, which the next step has its own of, are no part of it.
    offset : mapping of str to float, optional
        By how much entries change from the first state to the last, such as the place of a gait that advances.
    modulo : mapping of str to float, optional
        Of entries that return up to whole multiples of a number, such as an angle with ``2 * np.pi``. The multiple is
        the one that is nearest along the way.

    Raises
    ------
    ArgumentError
        Unknown names, numbers that are not finite, or a modulus that is not positive. By `optimize`, if the initial
        state is fixed.
    """

    names: str | Sequence[str] = "*"
    offset: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    modulo: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        for what in ("offset", "modulo"):
            given: object = getattr(self, what)
            if not isinstance(given, Mapping):
                raise ArgumentError(f"{self}: {what}: got {given!r}, expected numbers by names")
            for name, value in given.items():
                as_number(value, f"{self}: {what} of {name!r}", above=0.0 if what == "modulo" else -np.inf)

    def __str__(self) -> str:
        return f"Periodic({self.names!r})"

    def entries(self, system: System) -> list[int]:
        """Return the places of the entries in the state of a system."""
        known = system.quantity("state").names
        patterns = (self.names,) if isinstance(self.names, str) else tuple(self.names)
        places = returning_entries(system, patterns, str(self))
        if not places:
            raise ArgumentError(f"{self}: got no names")
        chosen = [known[i] for i in places if i < len(known)]
        for what in ("offset", "modulo"):
            for name in getattr(self, what):
                if name not in chosen:
                    there = closest(name, chosen, what="entries that return")
                    raise ArgumentError(f"{self}: {what}: {name!r} is none of its entries; {there}")
        return places

    def rows(self, system: Any, first: int) -> list[Rows]:
        extended = system if isinstance(system, Extended) else getattr(system, "system", None)
        if not isinstance(extended, Extended) or first > 0:
            raise ArgumentError(
                f"{self}: got a fixed initial state, expected one that is free. Give free_start=True or the names that "
                "are free to `optimize`; to come back to a given state, ask for `Equal` at the end"
            )
        own: System = extended.system
        entries = set(self.entries(own))
        places = np.array([i for i in extended.copied.tolist() if i in entries], dtype=np.intp)
        turns: tuple[tuple[int, int], ...] = ()
        if own.by_numbers:
            returning = Returning.of(own, places.tolist(), str(self))
            places, turns = returning.numbers, returning.turns
        labels = [returning_name(own, i) for i in places.tolist()]
        names = [label.removesuffix(BEFORE) for label in labels]
        rows = []
        for turning in (False, True):
            chosen = [j for j, name in enumerate(names) if (name in self.modulo) is turning]
            if not chosen:
                continue
            # What is kept of the first state counts from there, so the change is an entry itself.
            some = [names[j] for j in chosen]
            change = Entries([labels[j] for j in chosen], places[chosen], of_state=True, kind="return of")
            offset = np.array([[self.offset.get(name, 0.0) for name in some]])
            quantity: Quantity = change
            if turning:
                quantity = _Turning(change, offset[0], np.array([self.modulo[name] for name in some]))
            k, scale = np.array([system.N], dtype=np.intp), np.ones(len(some))
            rows += [Rows(str(self), quantity, sign, offset, k, scale, equal=True) for sign in (1.0, -1.0)]
        back = [self._turned_back(extended, entries), *(self._turned_by_numbers(extended, first) for first, _ in turns)]
        for turned in back:
            if turned is None:
                continue
            k, nothing = np.array([system.N], dtype=np.intp), np.zeros((1, len(turned.names)))
            scale = np.ones(len(turned.names))
            rows += [Rows(str(self), turned, sign, nothing, k, scale, equal=True) for sign in (1.0, -1.0)]
        return rows

    def _turned_by_numbers(self, extended: Extended, first: int) -> TurnedByNumbers:
        """Return a rotation that returns, where its four numbers count from the first state."""
        names = [returning_name(extended.system, first + i) for i in range(4)]
        for what in ("offset", "modulo"):
            self._refuse_numbers(what, names)
        copy = extended.layout.at_copies + extended.copied.tolist().index(first)
        return TurnedByNumbers(names[1:], np.array([*range(first, first + 4), *range(copy, copy + 4)]))

    def _turned_back(self, extended: Extended, entries: set[int]) -> TurnedBack | None:
        """Return the rotations that return, by what each is off from the first."""
        own: System = extended.system
        chosen = [j for j, first in enumerate(extended.layout.turns[:, 0].tolist()) if first in entries]
        firsts = extended.layout.turns[chosen, 0].tolist()
        numbers = [returning_name(own, first + i) for first in firsts for i in range(4)]
        for what in ("offset", "modulo"):
            self._refuse_numbers(what, numbers)
        if not chosen:
            return None
        copies, directions = extended.layout.at_turns, extended.layout.at_copied_moves + len(extended.copied)
        at = np.array([[extended.layout.turns[j, 0], copies + 4 * j] for j in chosen], dtype=np.intp)
        moves = np.array([[extended.layout.turns[j, 1], directions + 3 * j] for j in chosen], dtype=np.intp)
        return TurnedBack([name for i, name in enumerate(numbers) if i % 4], at, moves)

    def _refuse_numbers(self, what: str, numbers: Sequence[str]) -> None:
        for name in getattr(self, what):
            if name in numbers:
                raise ArgumentError(
                    f"{self}: {what}: got {name!r}, a number of a rotation, which returns as it was; expected other "
                    "entries"
                )


class _Turning(Quantity):
    """Changes of entries up to whole multiples of a modulus: those that are closest to what is wanted."""

    of_state = True

    def __init__(self, change: Entries, wanted: Array, modulo: Array) -> None:
        self.change, self.wanted, self.modulo = change, wanted, modulo
        self.names, self.kind = change.names, change.kind

    def values(self, at: Samples) -> Array:
        """Return the changes."""
        change = self.change.values(at)
        return np.asarray(change - self.modulo * np.round((change - self.wanted) / self.modulo))

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        """Return the places of the changes."""
        return self.change.places

    def jacobian(self, at: Samples) -> Array:
        """Return the constant derivatives."""
        return np.broadcast_to(np.eye(len(self.names)), (len(at.k), len(self.names), len(self.names)))

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""
