"""Motions that return: the last state is the first one, or so far from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array, as_number
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Quantity, Samples
from leastaction.optimal.unknowns.system import ExtendedSystem

__all__ = ["Periodic"]


@dataclass(frozen=True)
class Periodic(Limit):
    """Equations ``x_N = x_0 + offset`` of entries of the state, for a motion that may go on like this for ever.

    The initial state has to be free, ``optimize(..., free_start=True)``, or some entries of it. What nothing depends
    on, such as the place of a walker, is better held there: ``free_start=["knee", "p_*"]``.

    Parameters
    ----------
    names : str or sequence of str
        Entries, by the names of ``system.quantity("state")``, with wildcards: of a `MidpointSystem` its variables,
        ``"p_..."`` for momenta and ``"v_..."`` for rates of prescribed variables. Multipliers, which the next step has
        its own of, are no part of it.
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

    def entries(self, system: DiscreteSystem) -> list[int]:
        """Return the places of the entries in the state of a system."""
        known = system.quantity("state").names
        patterns = (self.names,) if isinstance(self.names, str) else tuple(self.names)
        places = system.returning_entries(patterns, str(self))
        if not places:
            raise ArgumentError(f"{self}: got no names")
        chosen = [known[i] for i in places]
        for what in ("offset", "modulo"):
            for name in getattr(self, what):
                if name not in chosen:
                    there = closest(name, chosen, what="entries that return")
                    raise ArgumentError(f"{self}: {what}: {name!r} is none of its entries; {there}")
        return places

    def rows(self, system: DiscreteSystem, first: int) -> list[Rows]:
        """Return both sides of the equations."""
        if not isinstance(system, ExtendedSystem) or first > 0:
            raise ArgumentError(
                f"{self}: got a fixed initial state, expected one that is free. Give free_start=True or the names that "
                "are free to `optimize`; to come back to a given state, ask for `Equal` at the end"
            )
        places = self.entries(system.system)
        known = system.system.quantity("state").names
        names = [known[i] for i in places]
        copies = system.at_copies + np.searchsorted(system.copied, places)
        offset = np.array([self.offset.get(name, 0.0) for name in names])
        modulo = np.array([self.modulo.get(name, np.inf) for name in names])
        quantity = _Change(names, np.array(places, dtype=np.intp), copies, offset, modulo)
        k, bounds = np.array([system.N], dtype=np.intp), np.zeros((1, len(names)))
        scale = np.ones(len(names))
        return [Rows(str(self), quantity, sign, bounds, k, scale, equal=True) for sign in (1.0, -1.0)]


class _Change(Quantity):
    """By how much entries of the state have changed, less what is wanted, from what was copied at the start."""

    of_state, kind = True, "return of"

    def __init__(
        self, names: Sequence[str], places: np.ndarray, copies: np.ndarray, offset: Array, modulo: Array
    ) -> None:
        self.names, self.places, self.copies, self.offset, self.modulo = tuple(names), places, copies, offset, modulo

    def values(self, at: Samples) -> Array:
        """Return the changes."""
        change = at.x[:, self.places] - at.x[:, self.copies] - self.offset
        whole = np.where(np.isinf(self.modulo), 0.0, self.modulo)
        return np.asarray(change - whole * np.round(change / self.modulo))

    def columns(self, nx: int, nu: int) -> np.ndarray:  # noqa: ARG002
        """Return the places now and at the start."""
        return np.concatenate([self.places, self.copies])

    def jacobian(self, at: Samples) -> Array:
        """Return the constant derivatives."""
        each = np.broadcast_to(np.eye(len(self.places)), (len(at.k), len(self.places), len(self.places)))
        return np.concatenate([each, -each], axis=2)

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""
