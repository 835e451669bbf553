"""Roll-outs and their exact derivatives over batches, as the bridges ask for them: plain arrays in and out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction.control.many import linearize_many, simulate_many
from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.systems.midpoint import MidpointSystem


class BatchedSystem:
    """A system whose steps are asked for many motions at once; it has no state of its own.

    Arrays may have any number of axes in front: those of a batch.
    """

    def __init__(self, system: DiscreteSystem) -> None:
        if system.charts() is not None:
            raise ArgumentError("system: its states are no plain vectors, expected some that are")
        self.system = system
        self.N, self.nx, self.nu = system.N, system.nx, system.nu

    def states(self, x0: Array, u: Array) -> Array:
        """Return the states (..., N+1, nx) from x0 (..., nx) under inputs u (..., N, nu).

        Raises
        ------
        StepError
            Some step has no solution.
        """
        system = self.system
        starts, inputs = np.array(x0, dtype=np.float64), np.array(u, dtype=np.float64)
        batch = starts.shape[:-1]
        starts, inputs = starts.reshape(-1, self.nx), inputs.reshape(-1, self.N, self.nu)
        if type(system) is MidpointSystem and not system.multipliers and system.first_share == 1.0:
            runs = simulate_many(system.integrator, starts, system.t, inputs)
            if runs.failures:
                i, why = next(iter(runs.failures.items()))
                raise StepError(f"instance {i}: {why}", t=float(system.t[0]), residuals={}, iteration=0)
            return runs.x.reshape(*batch, self.N + 1, self.nx)
        K = np.zeros((self.N, self.nu, self.nx))
        found = np.empty((len(starts), self.N + 1, self.nx))
        for i, (start, row) in enumerate(zip(starts, inputs, strict=True)):
            out = system.rollout(start, np.zeros((self.N + 1, self.nx)), row, K, 0, self.N)
            if not out.complete:
                raise StepError(f"instance {i}: {out.failure}", t=0.0, residuals={}, iteration=0)
            found[i] = out.x
        return found.reshape(*batch, self.N + 1, self.nx)

    def slopes(self, x: Array, u: Array) -> Array:
        """Return ``[A B]`` of every step (..., N, nx, nx+nu) along motions x (..., N+1, nx), u (..., N, nu)."""
        system = self.system
        if type(system) is MidpointSystem and not system.multipliers and system.first_share == 1.0:
            batch = x.shape[:-2]
            states, inputs = np.reshape(x, (-1, self.N + 1, self.nx)), np.reshape(u, (-1, self.N, self.nu))
            both = np.concatenate(linearize_many(system.integrator, system.t, states, inputs), axis=3)
            return both.reshape(*batch, self.N, self.nx, self.nx + self.nu)

        def one(states: Array, inputs: Array) -> Array:
            A, B = system.linearize(read_only(states), read_only(inputs))
            return np.concatenate([A, B], axis=2)

        return self._each(one, x, u, (self.N, self.nx, self.nx + self.nu))

    def bends(self, x: Array, u: Array) -> Array:
        """Return the second derivatives of every step (..., N, nx, nx+nu, nx+nu): those of each next state."""
        n = self.nx + self.nu

        def one(states: Array, inputs: Array) -> Array:
            linear = self.system.linearize(read_only(states), read_only(inputs))
            found = np.empty((self.N, self.nx, n, n))
            for i in range(self.nx):
                weights = np.zeros((self.N, self.nx))
                weights[:, i] = 1.0
                found[:, i] = (
                    linear.curvature(weights)
                    if linear.second is not None
                    else self.system.curvatures(states, inputs, np.concatenate([weights[:1], weights]))
                )
            return found

        return self._each(one, x, u, (self.N, self.nx, n, n))

    def _each(self, one: Callable[[Array, Array], Array], x: Array, u: Array, shape: tuple[int, ...]) -> Array:
        states, inputs = np.array(x, dtype=np.float64), np.array(u, dtype=np.float64)
        batch = states.shape[:-2]
        states, inputs = states.reshape(-1, self.N + 1, self.nx), inputs.reshape(-1, self.N, self.nu)
        found = [one(np.ascontiguousarray(a), np.ascontiguousarray(b)) for a, b in zip(states, inputs, strict=True)]
        return np.array(found).reshape(*batch, *shape)

    def pull_back(self, slopes: Array, w: Array) -> tuple[Array, Array]:
        """Return the gradients by x0 (..., nx) and u (..., N, nu) of ``sum w . x``, w (..., N+1, nx)."""
        z = np.array(w[..., self.N, :])
        by_u = np.empty((*w.shape[:-2], self.N, self.nu))
        for k in range(self.N - 1, -1, -1):
            both = np.einsum("...ij,...i->...j", slopes[..., k, :, :], z)
            by_u[..., k, :] = both[..., self.nx :]
            z = both[..., : self.nx] + w[..., k, :]
        return z, by_u
