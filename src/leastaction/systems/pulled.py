"""Strings whose tensions are inputs: the bridge in discrete time with forces that act as those of constraints do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.quality import quality_of
from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.discrete.system import DiscreteSystem, Rollout
from leastaction.optimal.system import Linearization
from leastaction.systems.midpoint import MidpointSystem


class PulledSystem(MidpointSystem):
    """A `MidpointSystem` in which the forces of some inputs act at the instants, as those of constraints do.

    In a step of the midpoint rule an input's force acts at the step's middle, a constraint's at its start:
    ``p_1 + D_1 L_d + f_d^- = Dh(q_1)' lam``. Here some inputs u get the second place, ``dt f(q_1, 0, u)`` in that of
    ``-Dh(q_1)' lam``, and half as much at the first instant, before which nothing acts. So a string whose tension is
    such an input (`TendonForce`) and a string of the same length as a constraint (`Distance`) make the same motion
    to the last bits: ``lam = dt T / (2 L)``. But with the tension as the input no equation has to be solved for it,
    nothing loses rank where strings cannot act on what they hold, and a string pulls if its input has a bound.

    State and input are those of `MidpointSystem`; any number of threads may share one system.

    Parameters
    ----------
    integrator : MidpointVI
        Of a mechanism without constraints.
    t : array_like, shape (N+1,)
        Times (s), increasing.
    at_instants : sequence of str
        The inputs that act at the instants.

    Raises
    ------
    ArgumentError
        For a mechanism with constraints, an unknown input, or times that do not increase.
    """

    def __init__(self, integrator: MidpointVI, t: npt.ArrayLike, *, at_instants: Sequence[str]) -> None:
        super().__init__(integrator, t)
        m = integrator.mechanism
        if m.nc:
            raise ArgumentError(
                f"PulledSystem: the mechanism has {m.nc} constraints, expected none: leave them out, and put a force "
                "in the place of each"
            )
        for name in at_instants:
            if name not in m.inputs:
                raise ArgumentError(f"at_instants: got {name!r}; {closest(name, m.inputs, what='inputs')}")
        self.at_instants = tuple(at_instants)
        self._late = np.array([m.inputs.index(name) for name in at_instants], dtype=np.intp)
        self._p = slice(m.nq, m.nq + m.nd)
        self._share = np.diff(self.t)
        self._share[0] *= 0.5

    def window(self, start: int, stop: int) -> DiscreteSystem:
        """Return the steps ``start .. stop-1`` as a system of their own."""
        return DiscreteSystem.window(self, start, stop)

    def f(self, x: Array, u: Array, k: int) -> Array:
        """Return the next state (nx,); `StepError` where the step has no solution."""
        kicked, rest = self._kick(x, u, k)
        return super().f(kicked, rest, k)

    def rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
        """Simulate steps ``start .. stop-1`` under ``u = ubar - K (x - xbar)``; see `DiscreteSystem`."""
        m, core = self.integrator.mechanism, self.integrator.core
        x, u = np.empty((stop - start + 1, self.nx)), np.empty((stop - start, self.nu))
        x[0] = x0
        worst: StepQuality | None = None
        worst_at, failure = None, None
        for i, k in enumerate(range(start, stop)):
            u[i] = ubar[k] - K[k] @ (x[i] - xbar[k])
            kicked, rest = self._kick(x[i], u[i], k)
            times = self.t[k : k + 2]
            step = core.roll_out(times, kicked, None, rest[None, :], None) if np.isfinite(kicked).all() else None
            quality = None if step is None else quality_of(m, step, times)
            if quality is not None and (worst is None or quality.coarseness > worst.coarseness):
                worst, worst_at = quality, k
            if step is None or step.steps < 1:
                failure = f"{self.when(k)} could not be solved"
                return Rollout(x[: i + 1], u[:i], i, failure, worst, worst_at)
            x[i + 1] = step.x[1]
        return Rollout(x, u, stop - start, None, worst, worst_at)

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        """Return A (nx, nx) and B (nx, nu) of step k."""
        kicked, rest = self._kick(x, u, k)
        A, B = super().derivatives(kicked, rest, k)
        A, B = self._chained(A[None], B[None], self._slopes(x[None], u[None], [k]))
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        """Return the Hessian (nx + nu, nx + nu) of ``z . f`` of step k."""
        kicked, rest = self._kick(x, u, k)
        A, _ = super().derivatives(kicked, rest, k)
        H = super().curvature(kicked, rest, k, z)
        found = self._chained_second(H[None], A[None], z[None], x[None], u[None], [k])
        return np.asarray(found[0])

    def linearize(self, x: Array, u: Array, out: Linearization | None = None) -> Linearization:
        """Return the derivatives along a trajectory; see `DiscreteSystem`."""
        x, u = x.copy(), u.copy()
        kicked, rest = x.copy(), u.copy()
        for k in range(self.N):
            kicked[k], rest[k] = self._kick(x[k], u[k], k)
        free = super().linearize(kicked, rest, out)
        steps = range(self.N)
        A, B = self._chained(free.A, free.B, self._slopes(x, u, steps))

        def second(z: Array) -> Array:
            return self._chained_second(free.curvature(z), free.A, z, x, u, steps)

        return Linearization(A, B, second, free.memory)

    def _late_inputs(self, u: Array) -> Array:
        """Return all inputs (n_inputs,) of the mechanism, zero but for those that act at the instants."""
        late = np.zeros(self.integrator.mechanism.n_inputs)
        late[self._late] = u[self._late]
        return late

    def _kick(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        """Return the state with the momentum that the forces at instant k leave, and the inputs without them."""
        m = self.integrator.mechanism
        q = np.ascontiguousarray(x[: m.nq])
        kicked, rest = np.array(x), np.array(u)
        kicked[self._p] += self._share[k] * m.core.force(q, np.zeros(m.nq), self._late_inputs(u))[: m.nd]
        rest[self._late] = 0.0
        return kicked, rest

    def _slopes(self, x: Array, u: Array, steps: Sequence[int]) -> tuple[Array, Array]:
        """Return the derivatives of the momenta left (n, nd, nq), (n, nd, late) by variables and late inputs."""
        m = self.integrator.mechanism
        by_q, by_u = np.empty((len(steps), m.nd, m.nq)), np.empty((len(steps), m.nd, len(self._late)))
        for i, k in enumerate(steps):
            q = np.ascontiguousarray(x[i, : m.nq])
            fq, _, fu = m.core.force_jacobians(q, np.zeros(m.nq), self._late_inputs(u[i]))
            by_q[i], by_u[i] = self._share[k] * fq[: m.nd], self._share[k] * fu[: m.nd, self._late]
        return by_q, by_u

    def _chained(self, A: Array, B: Array, slopes: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return the derivatives of whole steps, from those of the steps without the forces at the instants."""
        nq = self.integrator.mechanism.nq
        by_q, by_u = slopes
        A, B = A.copy(), B.copy()
        by_p = A[:, :, self._p]
        A[:, :, :nq] += by_p @ by_q
        B[:, :, self._late] = by_p @ by_u
        return A, B

    def _chained_second(self, H: Array, A: Array, z: Array, x: Array, u: Array, steps: Sequence[int]) -> Array:
        """Return the Hessians of ``z . f`` of whole steps, from those of the steps without the forces."""
        m = self.integrator.mechanism
        by_q, by_u = self._slopes(x, u, steps)
        n, late = self.nx + self.nu, self.nx + self._late
        J = np.zeros((len(steps), n, n))
        J[:] = np.eye(n)
        J[:, late, late] = 0.0
        J[:, self._p, : m.nq] += by_q
        J[:, self._p, late] = by_u
        result = J.swapaxes(1, 2) @ H @ J
        places = np.concatenate([np.arange(m.nq), late])
        own = np.concatenate([np.arange(m.nq), 2 * m.nq + self._late])
        weights = np.zeros(m.nq)
        for i, k in enumerate(steps):
            q = np.ascontiguousarray(x[i, : m.nq])
            weights[: m.nd] = self._share[k] * (z[i] @ A[i, :, self._p])
            C = m.core.force_curvature(q, np.zeros(m.nq), self._late_inputs(u[i]), weights)
            result[i][np.ix_(places, places)] += C[np.ix_(own, own)]
        return np.asarray(result)
