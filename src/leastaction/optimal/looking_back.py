"""Quantities of a step and of the one before, such as how fast inputs change."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.quantity import Instants, Quantity, QuantityElsewhere, QuantityView, Samples

Need = tuple[str, int]
"""What is remembered of the step before: ("input", i) what was applied, ("state", i) where it began.

Of a rotation, whose four numbers begin at i, as a whole: `TURN` in the place of "state".
"""

TURN = "turn"

BEFORE = " a step before"
"""What stands behind the name of what is remembered."""


@dataclass(frozen=True)
class Recalled:
    """Where what is needed is remembered, in ``places`` from the end of a state, and of its directions.

    ``returning``: what the first step of a periodic motion has from the last. ``given``: what is known of before the
    first step.
    """

    places: Mapping[Need, tuple[int, int]]
    returning: frozenset[Need] = frozenset()
    given: frozenset[Need] = frozenset()


class LookingBack(Quantity):
    """Functions of a step that need some of the one before.

    The first step has none, but where all that is needed returns, as in a motion that goes on for ever the last step is
    before it, or is given. ``memory``: None of a system that does not remember, until `optimize` makes one that does.
    """

    def __init__(self, memory: Recalled | None) -> None:
        self.memory = memory
        self.first = 0 if memory is not None and (memory.returning | memory.given).issuperset(self.needs) else 1

    @property
    @abstractmethod
    def needs(self) -> tuple[Need, ...]:
        """What has to be remembered, one for each function."""

    @abstractmethod
    def remembering(self, memory: Recalled) -> Self:
        """Return the same where that is remembered, as far as it is."""

    def remembered(self) -> tuple[Instants, Instants]:
        """Return where what is needed stands, in places from the end of a state, and from that of its directions.

        Raises `ArgumentError`: if it is not remembered.
        """
        if self.memory is None:
            raise ArgumentError(
                f"{self.kind} {self.names[0]!r}: it depends on the step before, which is no part of the state: only "
                "`optimize` and `MPC` limit it"
            )
        found = np.array([self.memory.places[need] for need in self.needs], dtype=np.intp).reshape(-1, 2)
        return found[:, 0], found[:, 1]


class InputRates(LookingBack):
    """Rates of inputs from the middle of a step before to that of a step, ``2 (u_k - u_{k-1}) / (t_{k+1} - t_{k-1})``.

    ``places``: of the inputs. ``times`` (N+1,): of the instants (s).
    """

    kind = "rate of"

    def __init__(
        self, names: Sequence[str], places: Sequence[int], times: Array, memory: Recalled | None = None
    ) -> None:
        self.names, self.places = tuple(names), np.array(places, dtype=np.intp)
        self.times = read_only(times.copy())
        super().__init__(memory)

    @property
    def needs(self) -> tuple[Need, ...]:
        return tuple(("input", int(i)) for i in self.places)

    def remembering(self, memory: Recalled) -> InputRates:
        return InputRates(self.names, self.places.tolist(), self.times, memory)

    def own_select(self, rows: Sequence[int]) -> InputRates:
        chosen = [int(self.places[row]) for row in rows]
        return InputRates([self.names[row] for row in rows], chosen, self.times, self.memory)

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        return np.concatenate([nx + self.remembered()[1], nx + self.places])

    def values(self, at: Samples) -> Array:
        return np.asarray((at.u[:, self.places] - at.x[:, self.remembered()[0]]) / self._lasts(at))

    def jacobian(self, at: Samples) -> Array:
        each = np.eye(len(self.names)) / self._lasts(at)[:, :, None]
        return np.concatenate([-each, each], axis=2)

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""

    def own_is_like(self, other: Quantity) -> bool:
        return isinstance(other, InputRates) and np.array_equal(self.times, other.times)

    def _lasts(self, at: Samples) -> Array:
        return lasting(self.times, returns=self.memory is not None and bool(self.memory.returning))[at.k, None]


def lasting(times: Array, *, returns: bool = False) -> Array:
    """Return how long it is (N,) from the middle of the step before to that of each step between times (N+1,).

    Before the first is the last one, of a motion that returns, and else one as long as itself.
    """
    dt = np.diff(times)
    return np.asarray(0.5 * (dt + np.concatenate([dt[-1:] if returns else dt[:1], dt[:-1]])))


class OwnQuantity(QuantityElsewhere):
    """A quantity of a system, of the states (nx,) of one that remembers: its own come first."""

    def __init__(self, whole: Quantity, sizes: tuple[int, int, int]) -> None:
        super().__init__(whole)
        self.nx, self.ndx, self.nu = sizes

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002 - of the system that remembers
        n, more = self.ndx, nx - self.ndx
        own = self.whole.all_columns(n, self.nu)
        # Inputs stand behind what is remembered, next states behind both.
        return np.asarray(own + more * (own >= n))

    def seen(self, at: Samples) -> Samples:
        x_next = at.x_next[:, : self.nx] if at.x_next.shape[1] else at.x_next
        return at._replace(x=at.x[:, : self.nx], x_next=x_next)


def needs_of(quantity: Quantity) -> tuple[Need, ...]:
    """Return what a quantity needs to be remembered that is not yet; mostly nothing."""
    while isinstance(quantity, QuantityView):
        quantity = quantity.whole
    return quantity.needs if isinstance(quantity, LookingBack) and quantity.memory is None else ()
