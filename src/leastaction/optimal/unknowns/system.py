"""A system whose state also holds what is found beside its inputs: constants, whose first values are free.

``y = [x of the system, less c where that is kept; parameters p; entries c of the first state]`` with ``p+ = p`` and
``c+ = c``: its linear-quadratic problems, duals and limits are then those of any system with a free initial state.
What returns is stated as a change from c, so that what depends little on c, such as on the place of a walker, is not
lost in the rounding of stiff equations ``x_N - c = 0``. Rotations do not count from c, as there is no rotation less
another: of them c is a rotation as well, and ``log(c^-1 q_N) = 0``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.system import DiscreteSystem, derivatives_by, with_parameters
from leastaction.optimal.quantity import Quantity
from leastaction.optimal.space import ProductSpace, Rotations, Vectors, apart
from leastaction.optimal.system import FINAL_TIME, Linearization, second_derivative
from leastaction.optimal.unknowns.extended import Extended, by_differences
from leastaction.optimal.unknowns.returning import Returning

Along = Callable[[Array], tuple[Array, Array, Array]]
"""Returns a system's A, B and derivatives by parameters at values of these."""


class ExtendedSystem(Extended, DiscreteSystem):
    """A system with parameters, and entries of its first state, as constant states; those entries count from there.

    Its first derivatives are those of the system, and so are its second ones by the final time, and by the parameters,
    where the system has them. Second ones by other parameters are differences of fourth order of the exact first ones,
    over a thousandth of the parameter: good to about ten digits. It holds settings and no state; any number of threads
    may share it, as far as they may share the system.
    """

    system: DiscreteSystem

    def __init__(
        self, system: DiscreteSystem, parameters: Sequence[str], copied: Sequence[int], free_start: bool | Sequence[str]
    ) -> None:
        kept = Returning.of(system, copied, "Periodic")
        super().__init__(
            system, parameters, kept.numbers.tolist(), free_start, moves=kept.moves.tolist(), turns=kept.turns
        )
        self.N = system.N
        own = np.eye(self.d_own)
        nothing = np.zeros((self.d_own, len(self.names))), np.zeros((self.d_own, len(self.layout.turned_moves)))
        self.moves = np.hstack([own, nothing[0], own[:, self.layout.copied_moves], nothing[1]])
        charts, self._constants = system.charts(), None
        if charts is not None:
            self._constants = ProductSpace(
                Vectors(len(self.names) + len(self.copied)), *(Rotations() for _ in self.layout.turns)
            )
            self.space = ProductSpace(charts, self._constants)

    def at(self, values: Array) -> DiscreteSystem:
        return with_parameters(self.system, self.named(values)) if self.names else self.system

    def near(self, values: Array) -> DiscreteSystem:
        return with_parameters(self.system, self.named(values), near=True) if self.names else self.system

    def start_time(self) -> float:
        return self.system.time(0)

    # ---- Steps ------------------------------------------------------------------------------------

    def f(self, x: Array, u: Array, k: int) -> Array:
        own = self.at(self.values(x)).f(self.own(x), u, k)
        own[self.layout.kept] -= x[self.layout.at_copies : self.layout.at_turns]
        return np.concatenate([own, x[self.n_own :]])

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        A, B = self._extended(*self._of_step(self.values(x), self.own(x), u, k))
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        own, values = self.own(x), self.values(x)
        system, weights = self.at(values), np.ascontiguousarray(z[None, : self.d_own])
        step = np.stack([own, system.f(own, u, k)])
        H, by_time = self._by_final_time(system, step, u[None], weights, k)
        if H is None:
            H = second_derivative(system, own, u, k, weights[0])[None]
        along = self._read_at(step[1:], partial(self._of_step, x=own, u=u, k=k), lambda s: s.f(own, u, k)[None])
        exact = self._by_parameters(system, step, u[None], weights, k)
        return np.asarray(self._second(H, by_time, values, along, weights, exact)[0])

    def _of_step(self, values: Array, x: Array, u: Array, k: int) -> tuple[Array, Array, Array]:
        """Return the system's A, B and derivatives by parameters (1, ...) of a step at values of these."""
        system = self.near(values)
        A, B = system.derivatives(x, u, k)
        by = np.empty((1, self.d_own, 0))
        if self.names:
            by = derivatives_by(system, np.stack([x, system.f(x, u, k)]), u[None], self.names, k)
        return A[None], B[None], by

    def own_rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
        n, d, constants = self.n_own, self.d_own, x0[self.n_own :]
        try:
            system = self.at(self.values(x0))
        except LeastActionError as error:
            return Rollout(x0[None, :].copy(), ubar[:0], 0, f"{self.when(start)}: {error}")
        part = slice(start, stop)
        # Constants stay, so their feedback is known beforehand.
        u, gain = ubar.copy(), K[part, :, d:].copy()
        copies = slice(len(self.names), len(self.names) + len(self.copied))
        gain[:, :, copies] -= K[part][:, :, self.layout.kept_moves]
        u[part] -= np.einsum("kij,kj->ki", gain, apart(self._constants, constants[None], xbar[part, n:]))
        out = system.rollout(self.own(x0), self.own(xbar), u, K[:, :, :d], start, stop)
        x = np.empty((len(out.x), self.nx))
        x[:, :n], x[:, n:] = out.x, constants
        x[:, self.layout.kept] -= x0[self.layout.at_copies : self.layout.at_turns]
        return Rollout(x, out.u, out.steps_done, out.failure, out.worst_step, out.worst_at)

    def own_step_each(self, x: Array, u: Array) -> Rollout:
        """Make every step of a curve, whose parameters and kept entries are those of its first state throughout."""
        try:
            system = self.at(self.values(x[0]))
        except LeastActionError as error:
            return Rollout(x[:0], u[:0], 0, f"{self.when(0)}: {error}")
        made = system.step_each(self.own(x), u)
        ends = np.hstack([made.x, x[: len(made.x), self.n_own :]])
        ends[:, self.layout.kept] -= ends[:, self.layout.at_copies : self.layout.at_turns]
        return replace(made, x=ends)

    # ---- Derivatives ------------------------------------------------------------------------------

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization:
        own, values, u = self.own(x), self.values(x[0]).copy(), u.copy()
        system = self.at(values)
        # A system with other parameters is another one, which cannot use the memory of the last.
        lin, by = system.linearize_by(own, u, self.names, None if out is None or self.names else out.memory)
        A, B = self._extended(lin.A, lin.B, by)

        def along(moved: Array) -> tuple[Array, Array, Array]:
            (A, B), by = self.near(moved).linearize_by(own, u, self.names)
            return A, B, by

        def second(z: Array) -> Array:
            weights = np.ascontiguousarray(z[:, : self.d_own])
            H, by_time = self._by_final_time(system, own, u, weights)
            exact = self._by_parameters(system, own, u, weights)
            H = lin.curvature(weights) if H is None else H
            ends = None if self.space is None else system.step_each(own, u).x
            read = self._read_at(ends, along, lambda other: other.step_each(own, u).x)
            return self._second(H, by_time, values, read, weights, exact)

        return Linearization(A, B, second, lin, self._pattern(lin, out))

    def own_linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization:
        """Return the same of a curve, whose parameters and kept entries are those of its first state throughout."""
        own, values, u = self.own(x), self.values(x[0]).copy(), u.copy()
        system = self.at(values)
        steps = np.stack([own[:-1], self.own(ends)], axis=1)
        lin = system.linearize_each(own, u, steps[:, 1])
        A, B = self._extended(lin.A, lin.B, self._by_each(system, steps, u))

        def along(moved: Array) -> tuple[Array, Array, Array]:
            near = self.near(moved)
            moved_steps = np.stack([own[:-1], ends_of(near)], axis=1)
            A, B = near.linearize_each(own, u, moved_steps[:, 1])
            return A, B, self._by_each(near, moved_steps, u)

        def ends_of(other: DiscreteSystem) -> Array:
            return np.array([other.f(own[k], u[k], k) for k in range(self.N)])

        def second(z: Array) -> Array:
            weights = np.ascontiguousarray(z[:, : self.d_own])
            exact, H, by_time = [], [], []
            for k, (step, each) in enumerate(zip(steps, weights, strict=True)):
                part = u[k : k + 1], each[None], k
                exact.append(self._by_parameters(system, step, part[0], part[1], k))
                found = self._by_final_time(system, step, *part)
                H.append(found[0])
                by_time.append(found[1])
            whole = _together(H)
            whole = lin.curvature(weights) if whole is None else whole
            read = self._read_at(steps[:, 1], along, ends_of)
            return self._second(whole, _together(by_time), values, read, weights, _together(exact))

        return Linearization(A, B, second)

    def _by_each(self, system: DiscreteSystem, steps: Array, u: Array) -> Array:
        """Return derivatives (N, nx of the system, P) by the parameters of steps, given by both ends (N, 2, nx)."""
        if not self.names:
            return np.empty((len(u), self.d_own, 0))
        found = [derivatives_by(system, step, u[k : k + 1], self.names, k) for k, step in enumerate(steps)]
        return np.concatenate(found)

    def _pattern(self, own: Linearization, last: Linearization | None) -> npt.NDArray[np.bool_] | None:
        """Return which entries of ``[A B]`` may differ from zero, given the system's own, and the last one of this."""
        if own.pattern is None:
            return None
        if last is not None and isinstance(last.memory, Linearization) and last.memory.pattern is own.pattern:
            return last.pattern
        n, ones = self.d_own, np.ones((1, self.d_own, len(self.names)))
        A, B = self._extended(own.pattern[None, :, :n].astype(float), own.pattern[None, :, n:].astype(float), ones)
        copies = slice(self.layout.at_copied_moves, self.layout.at_copied_moves + len(self.copied))
        A[0, :n, copies] = own.pattern[:, self.layout.copied_moves] | np.eye(n, dtype=bool)[:, self.layout.copied_moves]
        return np.asarray(np.concatenate([A[0], B[0]], axis=1) != 0.0)

    def _by_parameters(self, system: DiscreteSystem, x: Array, u: Array, z: Array, start: int = 0) -> Array | None:
        """Return what the system has of second derivatives of steps by the parameters."""
        return system.curvature_by_parameters(x, u, z, self.names, start) if self.names else None

    def _by_final_time(
        self, system: DiscreteSystem, x: Array, u: Array, z: Array, start: int = 0
    ) -> tuple[Array | None, Array | None]:
        """Return second derivatives of steps by (x, u), and by the final time and (x, u, that); None if not known."""
        found = system.curvature_by_final_time(x, u, z, start) if FINAL_TIME in self.names else None
        return (None, None) if found is None else (found[:, :-1, :-1], found[:, -1])

    def _extended(self, A: Array, B: Array, by: Array) -> tuple[Array, Array]:
        """Return A and B of steps of the system, and their derivatives by parameters, as those of extended states."""
        n, end = self.d_own, self.d_own + len(self.names)
        whole, inputs = np.zeros((len(A), self.ndx, self.ndx)), np.zeros((len(A), self.ndx, self.nu))
        whole[:, :n, :n], whole[:, :n, n:end], inputs[:, :n] = A, by, B
        np.einsum("kii->ki", whole)[:, n:] = 1.0
        if len(self.copied):
            copies = np.arange(end, end + len(self.copied))
            whole[:, :n, copies] = A[:, :, self.layout.kept_moves]
            whole[:, self.layout.copied_moves, copies] -= 1.0
        return whole, inputs

    def _read_at(self, ends: Array | None, along: Along, steps: Callable[[DiscreteSystem], Array]) -> Along:
        """Return derivatives at other parameters in the charts about the ends (n, nx) of steps, which these move.

        ``along``: in the charts about their own ends. ``steps``: returns these ends, of a system.
        """
        space = self.system.charts()
        if space is None or ends is None:
            return along

        def read(values: Array) -> tuple[Array, Array, Array]:
            J = space.difference_derivative(steps(self.near(values)), ends)
            A, B, by = along(values)
            return J @ A, J @ B, J @ by

        return read

    def _second(
        self, H: Array, by_time: Array | None, values: Array, along: Along, z: Array, exact: Array | None
    ) -> Array:
        """Return ``z . D2f`` (n, nx+nu, nx+nu) of steps.

        ``H``: its part without parameters. ``by_time``: that by the final time, where it is one and the system has
        that. ``along``: returns the system's A, B and derivatives by parameters at values of these. ``z`` (n, nx of the
        system). ``exact``: all that is by parameters, (n, P, nx of the system + nu + P), where the system has it.
        """
        if not self.names:
            return self._by_extended(H)
        count = len(self.names)

        def slope(moved: Array) -> Array:
            return np.concatenate([np.einsum("ki,kij->kj", z, part) for part in along(moved)], axis=1)

        mixed = np.zeros((len(H), self.d_own + self.nu + count, count))
        once, twice = mixed[:, :-count], mixed[:, -count:]
        known = [] if by_time is None else [self.names.index(FINAL_TIME)]
        if exact is not None:
            mixed[:] = exact.transpose(0, 2, 1)
        for j in range(count):
            if exact is None and j not in known:
                mixed[:, :, j] = by_differences(slope, values, j)
        for j in known:
            assert by_time is not None
            # With the other parameters by their differences.
            once[:, :, j], twice[:, :, j] = by_time[:, :-1], twice[:, j]
            twice[:, j, j] = by_time[:, -1]
        return self._joined(H, once, twice)

    # ---- Names and quantities -------------------------------------------------------------------------

    def own_when(self, k: int) -> str:
        return self.system.when(k)

    def own_time(self, k: int) -> float:
        return self.system.time(k)

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:  # noqa: ARG002 - time goes in steps
        return self.unknown_quantity() if kind == "unknown" else self.system.quantity(kind)


def _together(parts: list[Array | None]) -> Array | None:
    """Return arrays of steps as one; None where there are none."""
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None
