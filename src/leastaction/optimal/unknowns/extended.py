"""What systems that are extended by constants share, in either kind of time.

``y = [x of the system, less c where that is kept; parameters p; entries c of the first state]``, where p and c stay.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.differences import fourth_order
from leastaction.optimal.loop import Callback
from leastaction.optimal.quantity import Entries, Instants, as_slice
from leastaction.optimal.result import IterationRecord, OptimizationResult
from leastaction.optimal.system import FINAL_TIME, System


@dataclass(frozen=True, eq=False)
class ConstantsLayout:
    """Places in ``y = [x of the system; parameters p; copies c of entries of the first state; copies of rotations]``.

    ``copied``, ``copied_moves`` (m,): entries of x that are copied, and the directions that move them; ``kept``,
    ``kept_moves``: the same, as slices where they follow each other, which copies nothing. ``turns`` (n, 2): first
    number and first direction of each rotation that is copied; ``turned``, ``turned_moves``: all of these.
    ``at_copies``, ``at_turns``: where copies begin in y; ``at_copied_moves``: where their directions begin in a
    difference.
    """

    copied: Instants
    copied_moves: Instants
    kept: Any
    kept_moves: Any
    turns: Any
    turned: Instants
    turned_moves: Instants
    at_copies: int
    at_turns: int
    at_copied_moves: int

    @classmethod
    def of(
        cls,
        system: Any,
        parameters: int,
        copied: Sequence[int],
        moves: Sequence[int] | None,
        turns: Sequence[tuple[int, int]],
    ) -> ConstantsLayout:
        """Return the places of a number of parameters, and of copies of a system's state; see `Extended`."""
        entries = np.array(copied, dtype=np.intp)
        directions = entries if moves is None else np.array(moves, dtype=np.intp)
        first = np.array(turns, dtype=np.intp).reshape(-1, 2)
        numbers, turning = (first[:, [i]] + np.arange(n) for i, n in ((0, 4), (1, 3)))
        at_copies = system.nx + parameters
        return cls(
            copied=entries,
            copied_moves=directions,
            kept=as_slice(entries),
            kept_moves=as_slice(directions),
            turns=first,
            turned=numbers.ravel(),
            turned_moves=turning.ravel(),
            at_copies=at_copies,
            at_turns=at_copies + len(entries),
            at_copied_moves=system.ndx + parameters,
        )


_PART = 1e-3  # step of differences by a parameter, in parts of its value
_SOME = 1e-3  # least entry of a direction that counts, in parts of the largest


class Extended(System):
    """A system with parameters, and entries of its first state, as constant states; those entries count from there.

    ``system``: with the parameters, at values of its own. ``copied``: entries of the state whose first values are kept.
    ``free_start``: what of the system's own initial state is free. ``moves``: the directions of a state that are
    copied, if these are others than the entries. ``turns``: first number and first direction of the rotations that are
    kept: these do not count from there, and stand behind all else.
    """

    system: Any

    def __init__(
        self,
        system: Any,
        parameters: Sequence[str],
        copied: Sequence[int],
        free_start: bool | Sequence[str],
        *,
        moves: Sequence[int] | None = None,
        turns: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.system, self.names, self.free_start = system, tuple(parameters), free_start
        self.n_own, self.d_own, self.nu = system.nx, system.ndx, system.nu
        self.layout = ConstantsLayout.of(system, len(self.names), copied, moves, turns)
        self.nx = self.layout.at_turns + 4 * len(self.layout.turns)
        self.has_curvature, self.quantities = system.has_curvature, (*system.quantities, "unknown")
        # How the system's own state follows from the extended one.
        own = np.eye(self.n_own)
        self.moves = np.hstack([own, np.zeros((self.n_own, len(self.names))), own[:, self.copied]])
        free = set(range(self.n_own if free_start is True else 0))
        if not isinstance(free_start, bool):
            free = set(system.free_entries(free_start))
        self._told = np.zeros(self.n_own if moves is None else self.d_own, dtype=np.bool_)  # by equations, of the start
        told = [move for number, move in zip(self.copied, self.layout.copied_moves, strict=True) if int(number) in free]
        self._told[told] = True
        for number, move in self.layout.turns.tolist():
            self._told[move : move + 3] = number in free
        # Where the entries of [y; u] are among those of [x; p; u]: c moves what is kept.
        inputs = self.layout.at_copied_moves + np.arange(self.nu)
        self._places = np.concatenate([np.arange(self.layout.at_copied_moves), self.layout.copied_moves, inputs])

    @property
    def copied(self) -> Instants:
        """Entries of the system's own state whose first values are kept."""
        return self.layout.copied

    @property
    def final_time(self) -> int | None:
        """The place of the final time in the state, if it is found."""
        return self.n_own + self.names.index(FINAL_TIME) if FINAL_TIME in self.names else None

    # ---- Its state --------------------------------------------------------------------------------

    @abstractmethod
    def at(self, values: Array) -> Any:
        """Return the system with values of the parameters (P,)."""

    @abstractmethod
    def near(self, values: Array) -> Any:
        """Return the same for differences: as if all values were possible."""

    @abstractmethod
    def start_time(self) -> float:
        """Return the time of the first state (s)."""

    def named(self, values: Array) -> Mapping[str, float]:
        """Return values of the parameters (P,) by their names."""
        return dict(zip(self.names, values.tolist(), strict=True))

    def values(self, x: Array) -> Array:
        """Return the parameters (P,) of a state (nx,)."""
        return np.asarray(x[self.n_own : self.layout.at_copies])

    def own(self, x: Array) -> Array:
        """Return the system's own states of such of the extended system."""
        own = x[..., : self.n_own].copy()
        if len(self.copied):
            own[..., self.layout.kept] += x[..., self.layout.at_copies : self.layout.at_turns]
        return own

    def extended(self, x: Array, values: Array) -> Array:
        """Return states (nx,) or (N+1, nx) for such of the system, with values of the parameters (P,)."""
        first = (x if x.ndim == 1 else x[0])[self.layout.kept]
        whole = np.empty((*x.shape[:-1], self.nx))
        whole[..., : self.n_own], whole[..., self.n_own : self.layout.at_copies] = x, values
        whole[..., self.layout.at_copies : self.layout.at_turns] = first
        whole[..., self.layout.kept] -= first
        whole[..., self.layout.at_turns :] = (x if x.ndim == 1 else x[0])[self.layout.turned]
        return whole

    # ---- Derivatives ------------------------------------------------------------------------------

    def _joined(self, H: Array, once: Array, twice: Array) -> Array:
        """Return second derivatives by ``[y; u]``.

        ``H``: by the system's own (x, u). ``once`` (n, nx of the system + nu, P): by these and parameters. ``twice``
        (n, P, P): by parameters.
        """
        n, end = self.d_own, self.d_own + len(self.names)
        by = np.empty((len(H), end + self.nu, end + self.nu))
        by[:, :n, :n], by[:, :n, end:], by[:, end:, :n], by[:, end:, end:] = (
            H[:, :n, :n], H[:, :n, n:], H[:, n:, :n], H[:, n:, n:]
        )  # fmt: skip
        by[:, :n, n:end], by[:, end:, n:end] = once[:, :n], once[:, n:]
        by[:, n:end, :n], by[:, n:end, end:] = once[:, :n].transpose(0, 2, 1), once[:, n:].transpose(0, 2, 1)
        by[:, n:end, n:end] = 0.5 * (twice + twice.transpose(0, 2, 1))
        return self._by_extended(by)

    def _by_extended(self, H: Array) -> Array:
        """Return second derivatives by ``[y; u]``, given those by ``[x; p; u]``."""
        moved = H[:, self._places[:, None], self._places] if len(self.copied) else H
        if not len(self.layout.turns):
            return moved
        at = np.concatenate([np.arange(self.ndx - 3 * len(self.layout.turns)), self.ndx + np.arange(self.nu)])
        whole = np.zeros((len(H), self.ndx + self.nu, self.ndx + self.nu))
        whole[:, at[:, None], at] = moved
        return whole

    # ---- Its start --------------------------------------------------------------------------------

    def own_start_directions(self, x: Array, free: Sequence[str] | None) -> Array:
        del free
        n, count = self.d_own, len(self.names)
        own = self.own(x)
        if self.free_start is False:
            Z = np.zeros((n, 0))
        else:
            names = None if isinstance(self.free_start, bool) else self.free_start
            Z = self.system.start_directions(own, names)
            # Directions that only the equations of a return determine, if they do.
            idle = self.system.idle_directions(own) if self._told.any() else None
            if idle is not None and idle.shape[1] and self._told[idle.any(axis=1)].all():
                Z = np.hstack([Z, idle])
        whole = np.zeros((self.ndx, Z.shape[1] + count))
        whole[:n, : Z.shape[1]] = Z
        if count:
            system = self.at(self.values(x))
            by = system.start_by_parameters(own, self.names, self.free_start)
            whole[:n, Z.shape[1] :] = 0.0 if by is None else by
            whole[n : n + count, Z.shape[1] :] = np.eye(count)
        copies = n + count + len(self.copied)
        whole[n + count : copies] = whole[self.layout.kept_moves]
        whole[self.layout.kept_moves] = 0.0
        whole[copies:] = whole[self.layout.turned_moves]
        return whole

    def own_moved_start(self, x: Array, dx: Array) -> Array:
        values = self.values(x) + dx[self.d_own : self.d_own + len(self.names)]
        own = self.own(x)
        if self.free_start is not False:
            change = dx[: self.d_own].copy()
            change[self.layout.kept_moves] += dx[
                self.layout.at_copied_moves : self.layout.at_copied_moves + len(self.copied)
            ]
            own = self.at(values).moved_start(own, change)
        return self.extended(own, values)

    # ---- Names and quantities -------------------------------------------------------------------------

    def own_input_name(self, i: int) -> str:
        name: str = self.system.input_name(i)
        return name

    def unknowns_along(self, dx: Array) -> list[str]:
        parts = np.abs(dx[self.d_own : self.d_own + len(self.names)])
        return [name for name, part in zip(self.names, parts, strict=True) if part > _SOME * np.abs(dx).max()]

    def unknown_quantity(self) -> Entries:
        """Return the parameters as a quantity."""
        return Entries(self.names, range(self.n_own, self.layout.at_copies), of_state=True)


def told_in_own_states(
    given: Callback | None, own: Callable[[Array], Array], result: Callable[[OptimizationResult], OptimizationResult]
) -> Callback | None:
    """Return a callback that calls the given one with the system's own states.

    ``own``, ``result``: return extended states, and a result of these, as ones of the system.
    """
    if given is None:
        return None

    def tell(record: IterationRecord) -> object:
        x = read_only(own(record.x))
        return given(replace(record, x=x, snapshot=lambda: result(record.snapshot())))

    return tell


def stepped(at: Array, j: int, by: float | None = None) -> Array:
    """Return an argument (P,) with entry j moved, by a step of `by_differences` if not said by how much."""
    other = at.copy()
    other[j] += _step(at, j) if by is None else by
    return other


def by_differences(function: Callable[[Array], Any], at: Array, j: int) -> Array:
    """Return the derivative of a smooth function by entry j of its argument (P,): differences of fourth order."""
    return fourth_order(lambda by: np.asarray(function(stepped(at, j, by))), _step(at, j))


def _step(at: Array, j: int) -> float:
    return _PART * (abs(float(at[j])) or 1.0)
