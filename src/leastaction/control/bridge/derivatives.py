"""Roll-outs and their exact derivatives over batches, as the bridges ask for them: plain arrays in and out.

Other programs differentiate by all numbers of a state. Where these are no plain vectors, a step is taken as a function
of numbers near the states too, which does not depend on what is normal to the states, as the length of a quaternion:
its derivative is ``dplus(x+) A ddifference(x)``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from leastaction.control.many import linearize_many, simulate_many
from leastaction.errors import StepError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.discrete.system import DiscreteSystem, derivatives_by, linearized
from leastaction.optimal.space import StateSpace, Vectors, bent_by_numbers, by_numbers
from leastaction.systems.midpoint import MidpointSystem


class BatchedSystem:
    """A system whose steps are asked for many motions at once; it has no state of its own.

    Arrays may have any number of axes in front: those of a batch.
    """

    def __init__(self, system: DiscreteSystem) -> None:
        self.system = system
        self.space: StateSpace = system.charts() or Vectors(system.nx)
        self.N, self.nx, self.nu = system.N, system.nx, system.nu
        self._integrator = None
        if type(system) is MidpointSystem and not system.multipliers and system.first_share == 1.0:
            self._integrator = system.integrator  # its steps are the system's, so many are made at once

    def states(self, x0: Array, u: Array) -> Array:
        """Return the states (..., N+1, nx) from x0 (..., nx) under inputs u (..., N, nu).

        The first is x0 as it is; a quaternion in it may have any length, the others are unit quaternions.

        Raises `StepError`: some step has no solution.
        """
        starts, inputs = np.array(x0, dtype=np.float64), np.array(u, dtype=np.float64)
        batch = starts.shape[:-1]
        starts, inputs = starts.reshape(-1, self.nx), inputs.reshape(-1, self.N, self.nu)
        found = self._moved(self._on(starts), inputs)
        found[:, 0] = starts
        return found.reshape(*batch, self.N + 1, self.nx)

    def _moved(self, starts: Array, inputs: Array) -> Array:
        """Return the states (B, N+1, nx)."""
        system = self.system
        if self._integrator is not None:
            runs = simulate_many(self._integrator, starts, system.times, inputs)
            if runs.failures:
                i, why = next(iter(runs.failures.items()))
                raise StepError(f"instance {i}: {why}", t=float(system.times[0]), residuals={}, iteration=0)
            return np.array(runs.x)
        K = np.zeros((self.N, self.nu, self.space.ndx))
        found = np.empty((len(starts), self.N + 1, self.nx))
        for i, (start, row) in enumerate(zip(starts, inputs, strict=True)):
            out = system.rollout(start, np.zeros((self.N + 1, self.nx)), row, K, 0, self.N)
            if not out.complete:
                raise StepError(f"instance {i}: {out.failure}", t=0.0, residuals={}, iteration=0)
            found[i] = out.x
        return found

    def slopes(self, x: Array, u: Array) -> Array:
        """Return ``[A B]`` of every step (..., N, nx, nx+nu) along motions x (..., N+1, nx), u (..., N, nu)."""
        system, n = self.system, self.nx + self.nu
        if self._integrator is not None and isinstance(self.space, Vectors):
            batch = x.shape[:-2]
            states, inputs = np.reshape(x, (-1, self.N + 1, self.nx)), np.reshape(u, (-1, self.N, self.nu))
            both = np.concatenate(linearize_many(self._integrator, system.times, states, inputs), axis=3)
            return both.reshape(*batch, self.N, self.nx, n)

        def one(states: Array, inputs: Array) -> Array:
            on = self._on(states)
            A, B = system.linearize(read_only(on), read_only(inputs))
            moved = by_numbers(self.space, states[:-1], np.concatenate([A, B], axis=2))
            return np.asarray(self.space.plus_derivative(on[1:]) @ moved)

        return self._each(one, x, u, (self.N, self.nx, n))

    def by_parameters(self, x: Array, u: Array, names: Sequence[str]) -> Array:
        """Return the derivatives of every step by parameters, (..., N, nx, P)."""

        def one(states: Array, inputs: Array) -> Array:
            on = self._on(states)
            by = derivatives_by(self.system, read_only(on), read_only(inputs), names)
            return np.asarray(self.space.plus_derivative(on[1:]) @ by)

        return self._each(one, x, u, (self.N, self.nx, len(names)))

    def bends(self, x: Array, u: Array) -> Array:
        """Return the second derivatives of every step (..., N, nx, nx+nu, nx+nu): those of each next state."""
        n, space, N = self.nx + self.nu, self.space, self.N

        def one(states: Array, inputs: Array) -> Array:
            on = self._on(states)
            linear = linearized(self.system, read_only(on), read_only(inputs))
            moved = np.concatenate([linear.A, linear.B], axis=2)
            along = space.plus_derivative(on[1:])
            bent = np.stack([linear.curvature(np.tile(w, (N, 1))) for w in np.eye(space.ndx)], axis=1)
            found = np.empty((N, self.nx, n, n))
            for i, w in enumerate(np.eye(self.nx)):
                own = np.swapaxes(moved, 1, 2) @ space.plus_curvature(on[1:], np.tile(w, (N, 1))) @ moved
                own += np.einsum("ka,kaij->kij", along[:, i], bent)
                slope = np.einsum("ka,kaj->kj", along[:, i], moved)
                found[:, i] = bent_by_numbers(space, states[:-1], slope, own)
            return found

        return self._each(one, x, u, (N, self.nx, n, n))

    def _on(self, x: Array) -> Array:
        """Return the states that numbers (..., nx) stand for, such as with quaternions of length one."""
        return self.space.plus(x, np.zeros((*x.shape[:-1], self.space.ndx)))

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
