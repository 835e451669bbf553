"""A system whose state also holds what it did in the step before."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, cast

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.system import DiscreteSystem, derivatives_by, linearized, with_parameters
from leastaction.optimal.looking_back import BEFORE, TURN, LookingBack, Need, OwnQuantity, Recalled, needs_of
from leastaction.optimal.quantity import Entries, Instants, Quantity
from leastaction.optimal.remembered.cost import RememberedCost
from leastaction.optimal.space import ProductSpace, Rotations, Vectors
from leastaction.optimal.system import Linearization, returning_entries, returning_name, second_derivative


class RememberingSystem(DiscreteSystem):
    """A system with state ``[x; m]``, where m are inputs of the step before, and entries of the state it began with.

    ``needs``: what is remembered: inputs, then entries, then rotations, each as a whole. ``returning``: what the first
    step has from the last, of a motion that returns; it is free in the first state. ``before`` (nu,): inputs of before
    the first step, where they are known. As fit for several threads as the system is.
    """

    def __init__(
        self,
        system: DiscreteSystem,
        needs: Sequence[Need],
        returning: Collection[Need] = (),
        before: Array | None = None,
    ) -> None:
        self.system, self.needs, self.returning = system, tuple(needs), frozenset(returning)
        self.before = before
        self.n_own, self.d_own, self.N, self.nu = system.nx, system.ndx, system.N, system.nu
        self.has_curvature = system.has_curvature
        self.quantities, self.beside = system.quantities, system.beside
        self.inputs = np.array([i for kind, i in needs if kind == "input"], dtype=np.intp)
        charts, turns = system.charts(), [i for kind, i in needs if kind == TURN]
        numbers = [i for kind, i in needs if kind == "state"] + [i + j for i in turns for j in range(4)]
        self.states = np.array(numbers, dtype=np.intp)
        moves = numbers if charts is None else [j for i in numbers for j in np.flatnonzero(charts.pattern[i]).tolist()]
        self.moves = np.array(list(dict.fromkeys(moves)), dtype=np.intp)
        self.memory = ProductSpace(Vectors(len(needs) - len(turns)), *(Rotations() for _ in turns))
        self.nx = system.nx + self.memory.nx
        if charts is not None:
            self.space = ProductSpace(charts, self.memory)
        # Where each of it begins in the memory, and among the directions of that.
        plain = len(needs) - len(turns)
        numbers = [*range(plain), *(plain + 4 * k for k in range(len(turns)))]
        moves = [*range(plain), *(plain + 3 * k for k in range(len(turns)))]
        self.at = dict(zip(needs, zip(numbers, moves, strict=True), strict=True))

    # ---- Its state --------------------------------------------------------------------------------

    def own(self, x: Array) -> Array:
        """Return the system's own states."""
        return np.ascontiguousarray(x[..., : self.n_own])

    def extended(self, x: Array, u: Array, *, before: Array | None = None) -> Array:
        """Return states (nx,) or (N+1, nx) of the system with what was before them.

        Nothing before the first but what is known, and what returns: as far before it as the step before the last
        state leads. ``before`` (nu,): others than the inputs of before the first step that are known.
        """
        before = self.before if before is None else before
        memory, first = self._nothing_before(x), x if x.ndim == 1 else x[0]
        if before is not None:
            memory[..., : len(self.inputs)] = before[self.inputs]
        if x.ndim == 2:
            memory[1:] = self._left(x[:-1], u)
        if self.returning:
            whole, last = x.ndim == 2, np.concatenate([u[-1, self.inputs], first[self.states]])
            if whole:
                before_last, end = self._left(x[-2:], u[[-1, -1]])
                last = self.memory.plus(last, self.memory.difference(before_last, end))
            returns = self._returning()[0]
            (memory[0] if whole else memory)[returns] = last[returns]
        return np.concatenate([x, memory], axis=-1)

    def _nothing_before(self, x: Array) -> Array:
        """Return memories (..., m) of states (..., nx) that nothing is known of before: rotations as they are."""
        memory = np.zeros((*x.shape[:-1], self.memory.nx))
        for (kind, i), (at, _) in self.at.items():
            if kind == TURN:
                memory[..., at : at + 4] = x[..., i : i + 4]
        return memory

    def _left(self, x: Array, u: Array) -> Array:
        """Return what is remembered (..., m) of steps from x with u."""
        return np.concatenate([u[..., self.inputs], x[..., self.states]], axis=-1)

    def _with(self, ends: Array, x: Array, u: Array) -> Array:
        return np.concatenate([ends, self._left(x, u)], axis=-1)

    def behind(self, rows: Array) -> Array:
        """Return rows (..., ndx of the system) with nothing for what is remembered."""
        return np.concatenate([rows, np.zeros((*rows.shape[:-1], self.memory.ndx))], axis=-1)

    def cost_of(self, cost: Cost) -> Cost:
        """Return a cost of the system's own states as one of those with a memory."""
        if not cost.needs:
            return RememberedCost(cost, self.own, self.behind, self._nothing_before)
        found = cost.remembering(self)
        if found is None:
            raise NotImplementedError(f"{type(cost).__name__} needs {cost.needs}: implement `remembering`")
        return found

    # ---- Steps ------------------------------------------------------------------------------------

    def f(self, x: Array, u: Array, k: int) -> Array:
        return self._with(self.system.f(self.own(x), u, k), x, u)

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        A, B = self.system.derivatives(self.own(x), u, k)
        A, B = self._padded(A[None], B[None])
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        own = second_derivative(self.system, self.own(x), u, k, np.ascontiguousarray(z[: self.d_own]))
        return np.asarray(self._bent(own[None])[0])

    def own_step_each(self, x: Array, u: Array) -> Rollout:
        made = self.system.step_each(self.own(x), u)
        n = len(made.x)
        return replace(made, x=self._with(made.x, x[:n], u[:n]))

    def own_rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout | None:
        """Simulate steps as the system does, whose own way is faster, where nothing remembered is fed back."""
        if K[start:stop, :, self.d_own :].any():
            return None
        own = np.ascontiguousarray(K[:, :, : self.d_own])
        made = self.system.rollout(self.own(x0), self.own(xbar), ubar, own, start, stop)
        n = made.steps_done
        memory = np.concatenate([x0[None, self.n_own :], self._left(made.x[:n], made.u[:n])])
        return replace(made, x=np.concatenate([made.x, memory], axis=1))

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization:
        return self._around(linearized(self.system, self.own(x), u, None if out is None else out.memory))

    def own_linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization:
        return self._around(self.system.linearize_each(self.own(x), u, self.own(ends)))

    def _around(self, own: Linearization) -> Linearization:
        A, B = self._padded(own.A, own.B)

        def second(z: Array) -> Array:
            return self._bent(own.curvature(np.ascontiguousarray(z[:, : self.d_own])))

        pattern = None
        if own.pattern is not None:
            d = self.d_own
            of_A, of_B = self._padded(own.pattern[None, :, :d].astype(float), own.pattern[None, :, d:].astype(float))
            pattern = np.concatenate([of_A[0], of_B[0]], axis=1) != 0.0
        return Linearization(A, B, second, own, pattern)

    def _padded(self, A: Array, B: Array) -> tuple[Array, Array]:
        d, m = self.d_own, len(self.inputs)
        whole, inputs = np.zeros((len(A), self.ndx, self.ndx)), np.zeros((len(B), self.ndx, self.nu))
        whole[:, :d, :d], inputs[:, :d] = A, B
        inputs[:, d + np.arange(m), self.inputs] = 1.0
        whole[:, d + m + np.arange(len(self.moves)), self.moves] = 1.0
        return whole, inputs

    def _bent(self, own: Array, more: int = 0) -> Array:
        """Return second derivatives by (x, u, ...) of the system as those by ([x; m], u, ...); ``more`` behind u."""
        n, d = self.ndx + self.nu + more, self.d_own
        at = np.concatenate([np.arange(d), self.ndx + np.arange(self.nu + more)])
        whole = np.zeros((len(own), n, n))
        whole[:, at[:, None], at] = own
        return whole

    # ---- Its start --------------------------------------------------------------------------------

    def own_start_directions(self, x: Array, free: Sequence[str] | None) -> Array:
        own = self._above(self.system.start_directions(self.own(x), free))
        return np.hstack([own, np.eye(self.ndx)[:, self.d_own + self._returning()[1]]])

    def own_moved_start(self, x: Array, dx: Array) -> Array:
        own = self.system.moved_start(self.own(x), np.ascontiguousarray(dx[: self.d_own]))
        return np.concatenate([own, self.memory.plus(x[self.n_own :], dx[self.d_own :])])

    def _returning(self) -> tuple[Instants, Instants]:
        """Return which numbers of the memory return, and which of its directions."""
        numbers, moves = list[int](), list[int]()
        for need, (number, move) in self.at.items():
            if need in self.returning:
                sizes = (4, 3) if need[0] == TURN else (1, 1)
                numbers += range(number, number + sizes[0])
                moves += range(move, move + sizes[1])
        return np.array(numbers, dtype=np.intp), np.array(moves, dtype=np.intp)

    def check_start(self, x: Array) -> None:
        self.system.check_start(self.own(x))

    def idle_directions(self, x: Array) -> Array | None:
        own = self.system.idle_directions(self.own(x))
        return None if own is None else self._above(own)

    def unknowns_along(self, dx: Array) -> list[str] | None:
        return self.system.unknowns_along(dx[: self.d_own])

    def _above(self, rows: Array) -> Array:
        """Return directions (ndx, n), given the system's own."""
        return np.vstack([rows, np.zeros((self.memory.ndx, rows.shape[1]))])

    # ---- Parameters -------------------------------------------------------------------------------

    @property
    def parameters(self) -> Mapping[str, float]:  # type: ignore[override]
        """Those of the system."""
        return self.system.parameters

    def with_parameters(self, values: Mapping[str, float]) -> DiscreteSystem:
        return RememberingSystem(with_parameters(self.system, values), self.needs, self.returning, self.before)

    def with_parameters_near(self, values: Mapping[str, float]) -> DiscreteSystem:
        near = with_parameters(self.system, values, near=True)
        return RememberingSystem(near, self.needs, self.returning, self.before)

    def conditions_of(self, names: Sequence[str]) -> list[Quantity] | None:
        return self.system.conditions_of(names)

    def differentiate_by(self, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array:
        own = derivatives_by(self.system, self.own(x), u, names, start)
        return np.concatenate([own, np.zeros((len(own), self.memory.ndx, own.shape[2]))], axis=1)

    def curvature_by_parameters(
        self, x: Array, u: Array, z: Array, names: Sequence[str], start: int = 0
    ) -> Array | None:
        weights = np.ascontiguousarray(z[:, : self.d_own])
        own = self.system.curvature_by_parameters(self.own(x), u, weights, names, start)
        if own is None:
            return None
        nothing = np.zeros((*own.shape[:2], self.memory.ndx))
        return np.concatenate([own[:, :, : self.d_own], nothing, own[:, :, self.d_own :]], axis=2)

    def curvature_by_final_time(self, x: Array, u: Array, z: Array, start: int = 0) -> Array | None:
        weights = np.ascontiguousarray(z[:, : self.d_own])
        own = self.system.curvature_by_final_time(self.own(x), u, weights, start)
        return None if own is None else self._bent(own, 1)

    def start_by_parameters(self, x: Array, names: Sequence[str], free: bool | Sequence[str]) -> Array | None:
        own = self.system.start_by_parameters(self.own(x), names, free)
        return None if own is None else self._above(own)

    # ---- Names and quantities -------------------------------------------------------------------------

    def own_when(self, k: int) -> str:
        return self.system.when(k)

    def own_time(self, k: int) -> float:
        return self.system.time(k)

    def own_input_name(self, i: int) -> str:
        return self.system.input_name(i)

    def resolved_rates(self) -> tuple[tuple[str, ...], Array] | None:
        return self.system.resolved_rates()

    def returning_entries(self, names: Sequence[str], what: str) -> list[int]:
        """Return those of the system's own state, and of what returns with them."""
        return [*returning_entries(self.system, names, what), *(self.n_own + self._returning()[0]).tolist()]

    def returning_name(self, place: int) -> str:
        if place < self.n_own:
            return returning_name(self.system, place)
        place -= self.n_own
        (kind, i), (first, _) = max((each for each in self.at.items() if each[1][0] <= place), key=lambda each: each[1])
        i += place - first
        return (self.system.input_name(i) if kind == "input" else returning_name(self.system, i)) + BEFORE

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:  # noqa: ARG002 - time goes in steps
        return self.looking(self.system.quantity(kind))

    def looking(self, whole: Quantity) -> Quantity:
        """Return a quantity of the system as one of the states with a memory."""
        if isinstance(whole, LookingBack):
            nx, ndx = self.memory.nx, self.memory.ndx
            places = {need: (number - nx, move - ndx) for need, (number, move) in self.at.items()}
            given = frozenset(need for need in self.needs if need[0] == "input" and self.before is not None)
            return whole.remembering(Recalled(places, self.returning, given))
        if needs_of(whole):  # a view of one
            other: Any = copy(whole)
            other.whole = self.looking(other.whole)
            return cast(Quantity, other)
        return whole if isinstance(whole, Entries) else OwnQuantity(whole, (self.n_own, self.d_own, self.nu))
