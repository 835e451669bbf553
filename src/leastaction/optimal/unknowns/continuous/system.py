"""A system in continuous time whose state also holds what is found beside its inputs.

With a final time T that is found, the horizon stays as it was given, ``s`` in ``[t0, t0 + D]``, and the motion goes
through it at another pace::

    dy/ds = g f(x, u, t0 + g (s - t0)),   g = (T - t0) / D

so that a motion which takes longer is one of a larger g. States and inputs are those of the system: a rate among the
states is one by the true time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import fourth_order
from leastaction.optimal.collocation.mesh import STAGES, NodeLayout
from leastaction.optimal.continuous.system import ContinuousSystem, with_parameters
from leastaction.optimal.quantity import Quantity
from leastaction.optimal.space import ProductSpace, Vectors
from leastaction.optimal.system import FINAL_TIME, Linearization
from leastaction.optimal.unknowns.extended import Extended, by_differences

_BY_TIME = 1e-4  # step of differences by time, in parts of the horizon
_KEPT = 64  # number of systems with other parameters that are kept, as differences and roll-outs use them again


class ExtendedContinuousSystem(Extended, ContinuousSystem):
    """A system with parameters, a final time, and entries of its first state, as constant states.

    Parameters are those of the first sample throughout: samples are of one motion. Derivatives by the final time are
    exact where the system does not depend on time; by parameters they are differences of fourth order, good to about
    eleven digits, second ones to about ten.

    ``horizon``: (t0, t0 + D), on which everything over time is stated.

    Raises `ArgumentError`: a final time of a system that jumps with time.
    """

    system: ContinuousSystem

    def __init__(
        self,
        system: ContinuousSystem,
        parameters: Sequence[str],
        copied: Sequence[int],
        free_start: bool | Sequence[str],
        horizon: tuple[float, float],
    ) -> None:
        super().__init__(system.starting_at(horizon[0]), parameters, copied, free_start)
        self.t0, self.lasts = horizon[0], horizon[1] - horizon[0]
        self.jumps, own = system.jumps, system.state_names
        self.state_names = (*own, *self.names, *(f"{own[i]} at the start" for i in self.copied))
        space = system.charts()
        # Rotations that return count from the first state: these are numbers.
        if space is not None and not space.curved[space.pattern[self.copied].any(axis=0)].any():
            self.space = ProductSpace(space, Vectors(self.nx - self.n_own))
        self.time_at = None if self.final_time is None else self.final_time - self.n_own
        if self.time_at is not None and len(system.jumps):
            raise ArgumentError(
                f"unknowns: got FinalTime for a {type(system).__name__} that jumps with time, at "
                f"{float(system.jumps[0]):.6g} s, expected one that is smooth in time"
            )
        self.numbers = tuple(name for name in self.names if name != FINAL_TIME)
        self._columns = [j for j, name in enumerate(self.names) if name != FINAL_TIME]
        self._made = lru_cache(_KEPT)(self._make)

    def at(self, values: Array) -> ContinuousSystem:
        return self._made(tuple(values[self._columns].tolist()), False)

    def near(self, values: Array) -> ContinuousSystem:
        return self._made(tuple(values[self._columns].tolist()), True)

    def _make(self, values: tuple[float, ...], near: bool) -> ContinuousSystem:
        if not values:
            return self.system
        named = dict(zip(self.numbers, values, strict=True))
        return with_parameters(self.system, named, near=near)

    def start_time(self) -> float:
        return self.t0

    # ---- Time -------------------------------------------------------------------------------------

    def pace(self, values: Array) -> float:
        """Return how much true time passes in a second of the horizon, at values of the parameters (P,)."""
        return 1.0 if self.time_at is None else float((values[self.time_at] - self.t0) / self.lasts)

    def true_time(self, t: Array, values: Array) -> Array:
        """Return the true times of times on the horizon."""
        return t if self.time_at is None else np.asarray(self.t0 + self.pace(values) * (t - self.t0))

    # ---- Rates ------------------------------------------------------------------------------------

    def f(self, x: Array, u: Array, t: float) -> Array:
        return np.asarray(self.rates(x[None], u[None], np.array([t]))[0])

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        values, out = self.values(x[0]), np.zeros((len(x), self.nx))
        times = self.true_time(t, values)
        out[:, : self.n_own] = self.pace(values) * self.at(values).rates(self.own(x), u, times)
        return out

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:
        A, B = self.linearize(x[None], u[None], np.array([t]))
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, t: float, z: Array) -> Array:
        return np.asarray(self.linearize(x[None], u[None], np.array([t])).curvature(z[None])[0])

    def own_curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array:
        return self.linearize(x, u, t).curvature(z)

    def own_linearize(self, x: Array, u: Array, t: Array) -> Linearization:
        own, u, t, values = self.own(x), u.copy(), t.copy(), self.values(x[0]).copy()
        n, end, count = self.n_own, self.layout.at_copies, len(x)
        lin, pace = _linearized(self.at(values), own, u, self.true_time(t, values)), self.pace(values)
        A, B = np.zeros((count, self.nx, self.nx)), np.zeros((count, self.nx, self.nu))
        A[:, :n, :n], B[:, :n] = pace * lin.A, pace * lin.B
        A[:, :n, n:end] = self._by(values, own, u, t)
        A[:, :n, end:] = pace * lin.A[:, :, self.layout.kept]

        def slopes(moved: Array, z: Array) -> Array:
            """Return ``z . Df`` (n, nx of the system + nu + P) at other values."""
            there = _linearized(self.near(moved), own, u, self.true_time(t, moved))
            by = self._by(moved, own, u, t)
            parts = self.pace(moved) * there.A, self.pace(moved) * there.B, by
            return np.concatenate([np.einsum("ki,kij->kj", z, part) for part in parts], axis=1)

        def second(z: Array) -> Array:
            weights = np.ascontiguousarray(z[:, :n])
            H = pace * (
                self.at(values).curvatures(own, u, self.true_time(t, values), weights)
                if lin.second is None
                else lin.curvature(weights)
            )
            if not self.names:
                return self._by_extended(H)
            mixed = np.empty((count, n + self.nu + len(self.names), len(self.names)))
            for j in range(len(self.names)):
                mixed[:, :, j] = self._slope_by(j, values, weights, slopes)
            return self._joined(H, mixed[:, : -len(self.names)], mixed[:, -len(self.names) :])

        return Linearization(A, B, second)

    def own_slopes(self, x: Array, u: Array, t: Array) -> Array:
        """Return derivatives by the system's own states: what is constant does not move on the way."""
        values, whole = self.values(x[0]), np.zeros((len(x), self.nx, self.nx))
        A = self.at(values).slopes(self.own(x), u, self.true_time(t, values))
        whole[:, : self.n_own, : self.n_own] = self.pace(values) * A
        return whole

    def _slope_by(self, j: int, values: Array, z: Array, slopes: Any) -> Array:
        """Return the derivative of slopes by a parameter."""
        if j != self.time_at:
            return by_differences(lambda moved: np.asarray(slopes(moved, z)), values, j)

        def moved_by(by: float) -> Array:
            moved = values.copy()
            moved[j] += by
            return np.asarray(slopes(moved, z))

        if not self.system.autonomous:
            return fourth_order(moved_by, _BY_TIME * self.lasts)
        # All are proportional to the pace, but that by the final time itself, which does not depend on it.
        found: Array = moved_by(0.0) / (values[j] - self.t0)
        found[:, self.n_own + self.nu + j] = 0.0
        return found

    def _by(self, values: Array, own: Array, u: Array, t: Array) -> Array:
        """Return the derivatives (n, nx of the system, P) of the rates by the parameters, at values of these."""
        out = np.empty((len(own), self.n_own, len(self.names)))
        system, pace, times = self.near(values), self.pace(values), self.true_time(t, values)
        if self.numbers:
            out[:, :, self._columns] = pace * system.rates_by(own, u, times, self.numbers)
        if self.time_at is None:
            return out
        by_time = system.rates(own, u, times) / self.lasts
        if not system.autonomous:
            since = (t - self.t0)[:, None] / self.lasts
            step = _BY_TIME * self.lasts
            by_time = by_time + pace * since * fourth_order(lambda by: system.rates(own, u, times + by), step)
        out[:, :, self.time_at] = by_time
        return out

    # ---- Pieces -----------------------------------------------------------------------------------

    def roll_out_pieces(
        self, h: Array, t: Array, matrix: Array, reference: tuple[Array, Array], K: Array, z: Array, u: Array
    ) -> int | None:
        """Let the system do it, where it does not depend on time: of constants the feedback is known beforehand."""
        n, constants, space = self.n_own, z[0, self.n_own : self.nx], self.system.charts()
        d, kept = n, self.layout.kept
        if space is not None:
            d, kept = space.ndx, np.argmax(space.pattern[self.copied], axis=1)
        ndx = d + self.nx - n
        by_other_numbers = space is not None and self.space is None
        depends = self.time_at is not None and not self.system.autonomous
        if by_other_numbers or depends or K[:, :, ndx:].any():
            return None
        zbar, ubar = reference
        values = self.values(z[0])
        off = constants - zbar[:-1, n : self.nx]
        own_gain, gain = K[:, :, :d], K[:, :, d:ndx].copy()
        gain[:, :, len(self.names) :] -= own_gain[:, :, kept]
        layout, whole = NodeLayout(n, self.nu), NodeLayout(self.nx, self.nu)

        def taken(states: Array) -> Array:
            x, inputs = whole.points(states)
            return np.ascontiguousarray(layout.joined(self.own(x), inputs))

        own_K = np.zeros((len(K), K.shape[1], STAGES * (d + self.nu)))
        own_K[:, :, :d] = own_gain
        own_z, own_u = np.empty((len(z), layout.nz)), np.empty_like(u)
        own_z[0] = taken(z[:1])[0]
        moved = ubar - np.einsum("kij,kj->ki", gain, off)
        done = self.at(values).roll_out_pieces(
            h * self.pace(values), t, matrix, (taken(zbar), np.ascontiguousarray(moved)), own_K, own_z, own_u
        )
        if not done:
            return None
        x, inputs = layout.points(own_z[1 : done + 1])
        full = np.empty((done, STAGES, self.nx))
        full[:, :, :n], full[:, :, n:] = x, constants
        full[:, :, self.layout.kept] -= z[0, self.layout.at_copies : self.nx]
        z[1 : done + 1], u[:done] = whole.joined(full, inputs), own_u[:done]
        return done

    # ---- Names and quantities -------------------------------------------------------------------------

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:
        return self.unknown_quantity() if kind == "unknown" else self.system.quantity(kind, t)


def _linearized(system: ContinuousSystem, x: Array, u: Array, t: Array) -> Linearization:
    found: Any = system.linearize(x, u, t)  # a user's may be a bare pair
    return found if isinstance(found, Linearization) else Linearization(*found)
