"""The bridge: a mechanism as a system that the optimisers can steer, in discrete and in continuous time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, DynamicsError
from leastaction.mechanics.arguments import Array
from leastaction.mechanics.continuous import ContinuousDynamics
from leastaction.mechanics.elements import PythonConstraint
from leastaction.mechanics.mechanism import Mechanism
from leastaction.mechanics.midpoint import MidpointVI
from leastaction.mechanics.signals import check_times
from leastaction.mechanics.step import StepDerivatives
from leastaction.mechanics.trajectory import Trajectory
from leastaction.optimal.continuous import ContinuousSystem
from leastaction.optimal.protocol import DiscreteSystem, Linearization, Rollout


class _Linearized(NamedTuple):
    x: Array
    u: Array
    derivatives: StepDerivatives


class MidpointSystem(DiscreteSystem):
    """``x+ = f(x, u, k)`` of a midpoint integrator over given times.

    State ``x = [q; rho; p; v_rho]``, input ``u = [inputs; rho_next]``. With `multipliers` the multipliers of
    the step that led to a state are appended, ``x = [q; rho; p; v_rho; lam]``, so that a cost can weigh the
    tension of strings and other constraint forces, with exact derivatives like everything else. Whole
    trajectories are rolled out and differentiated in the core.

    Parameters
    ----------
    integrator : MidpointVI
    t : array_like, shape (N+1,)
        Times (s), increasing.
    multipliers : bool, optional
        Append the multipliers to the state.

    Raises
    ------
    ArgumentError
        If the times do not increase.
    """

    def __init__(
        self, integrator: MidpointVI, t: npt.ArrayLike, *, multipliers: bool = False
    ) -> None:
        m = integrator.mechanism
        self.integrator = integrator
        self.t = check_times(t)
        self.multipliers = multipliers
        self.nx = m.nx + (m.nc if multipliers else 0)
        self.nu = m.nu + m.nrho
        self.N = len(self.t) - 1
        # The second order starts from results of the first: those of the last trajectory are kept.
        self._last: _Linearized | None = None

    def f(self, x: Array, u: Array, k: int) -> Array:
        """Return the next state (nx,); `StepError` where the step has no solution."""
        m = self.integrator.mechanism
        full, x = x, np.ascontiguousarray(x[: m.nx])
        out = self.integrator.core.roll_out(self.t[k : k + 2], x, None, u[None, :], None, None)
        if out["steps"] < 1:
            nothing = np.empty((0, m.nc))
            state = self.integrator.trajectory(
                self.t[k : k + 1], x[None, :], u[None, :][:0], nothing
            ).last
            raise self.integrator.step_error(out, state, u[m.nu :])
        return np.asarray(self._states(out["x"], out["lam"], full)[1])

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        """Return A (nx, nx) and B (nx, nu) of step k."""
        d = self._linearize(self.t[k : k + 2], np.stack([x, self.f(x, u, k)]), u[None, :], None)
        return d.A_all[0], d.B_all[0]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        """Return the Hessian (nx + nu, nx + nu) of ``z . f`` of step k."""
        pair, t = np.stack([x, self.f(x, u, k)]), self.t[k : k + 2]
        d = self._linearize(t, pair, u[None, :], None)
        H = self.integrator.curvature_arrays(t, self._bare(pair), u[None, :], d, z[None, :])
        return np.asarray(H[0])

    def rollout(
        self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int
    ) -> Rollout:
        """Simulate steps ``start .. stop-1`` under ``u = ubar - K (x - xbar)``; see `DiscreteSystem`."""
        m = self.integrator.mechanism
        if np.any(K[start:stop, :, m.nx :]):
            # The core feeds back no multipliers. Nothing depends on them, so no optimal gain is lost with
            # theirs; a gain that does have them takes the slow way.
            return super().rollout(x0, xbar, ubar, K, start, stop)
        velocity = None
        if start:
            # The state holds no velocity of the dynamic variables; that of the reference is a good guess.
            dt = self.t[start] - self.t[start - 1]
            velocity = (xbar[start, : m.nd] - xbar[start - 1, : m.nd]) / dt
        out = self.integrator.core.roll_out(
            self.t[start : stop + 1],
            x0[: m.nx],
            self._bare(xbar[start : stop + 1]),
            ubar[start:stop],
            np.ascontiguousarray(K[start:stop, :, : m.nx]),
            velocity,
        )
        done = int(out["steps"])
        failure = None
        if done < stop - start:
            k = start + done
            failure = f"step {k} at t = {self.t[k]:.4g} s could not be solved"
        x = self._states(out["x"][: done + 1], out["lam"][:done], x0)
        return Rollout(x, out["u"][:done], done, failure)

    def linearize(self, x: Array, u: Array, out: Linearization | None = None) -> Linearization:
        """Return A (N, nx, nx) and B (N, nx, nu) along a trajectory."""
        reuse: dict[str, Array] | None = None
        if out is not None:
            reuse = {"A": out.A, "B": out.B}
            if self._last is not None:
                reuse["memo"] = self._last.derivatives.memo
        d = self._linearize(self.t, x, u, reuse)
        self._last = _Linearized(x, u, d)
        return Linearization(d.A_all, d.B_all)

    def curvatures(self, x: Array, u: Array, z: Array, out: Array | None = None) -> Array:
        """Return ``z[k+1] . D2f`` of every step, (N, nx + nu, nx + nu)."""
        if self._last is None or self._last.x is not x or self._last.u is not u:
            self._last = _Linearized(x, u, self._linearize(self.t, x, u, None))
        return self.integrator.curvature_arrays(
            self.t,
            self._bare(x),
            u,
            self._last.derivatives,
            z[1:],
            reuse=None if out is None else {"H": out},
        )

    def trajectory(self, x: Array, u: Array) -> Trajectory:
        """Return states (N+1, nx) and inputs (N, nu) of this system as a `Trajectory`, multipliers and all."""
        x = self._bare(x)
        lam = self.integrator.linearize_arrays(self.t, x, u).lam
        return self.integrator.trajectory(self.t, x, u, lam)

    def _linearize(
        self, t: Array, x: Array, u: Array, reuse: dict[str, Array] | None
    ) -> StepDerivatives:
        return self.integrator.linearize_arrays(
            t, self._bare(x), u, multipliers=self.multipliers, reuse=reuse
        )

    def _bare(self, x: Array) -> Array:
        """Return states without multipliers."""
        return np.ascontiguousarray(x[:, : self.integrator.mechanism.nx])

    def _states(self, x: Array, lam: Array, x0: Array) -> Array:
        """Return states of the core with their multipliers behind them, where they belong to the state."""
        if not self.multipliers:
            return x
        full = np.empty((len(x), self.nx))
        nx = x.shape[1]
        full[:, :nx] = x
        full[0, nx:] = x0[nx:]
        full[1:, nx:] = lam
        return full


class MechanismSystem(ContinuousSystem):
    """``x' = f(x, u, t)`` of a mechanism.

    State ``x = [q; rho; v; v_rho]``, input ``u = [inputs; rho_a]`` with the accelerations of the kinematic
    variables. Samples of whole trajectories are differentiated in the core, on several threads.

    A constrained mechanism starts on its constraints and stays there to the accuracy of the integration;
    `ContinuousDynamics` with Baumgarte's stabilisation holds it there longer.

    Parameters
    ----------
    dynamics : ContinuousDynamics or Mechanism
        The equations of motion; of a mechanism alone, those without stabilisation. With a
        `PythonConstraint` there is no curvature, and Newton's method is not offered.
    """

    def __init__(self, dynamics: ContinuousDynamics | Mechanism) -> None:
        if isinstance(dynamics, Mechanism):
            dynamics = ContinuousDynamics(dynamics)
        m = dynamics.mechanism
        self.dynamics = dynamics
        self.mechanism = m
        self.nx, self.nu = 2 * m.nq, m.nu + m.nrho
        self.has_curvature = not any(
            isinstance(element, PythonConstraint) for element in m.elements.values()
        )

    def f(self, x: Array, u: Array, t: float) -> Array:
        """Return the rate of the state (nx,); `DynamicsError` where the mechanism has none."""
        m = self.mechanism
        nq, nd = m.nq, m.nd
        points = self._split(x[None, :], u[None, :])
        out = self.dynamics.core.accelerations(*points, 1)
        if out["points"] != 1:
            self._explain(points, t)
        rate = np.empty(2 * nq)
        rate[:nq] = x[nq:]
        rate[nq : nq + nd] = out["a"][0]
        rate[nq + nd :] = u[m.nu :]
        return rate

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:
        """Return A (nx, nx) and B (nx, nu)."""
        A, B = self.linearize(x[None, :], u[None, :], np.array([t]))
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, t: float, z: Array) -> Array:
        """Return the Hessian (nx + nu, nx + nu) of ``z . f``."""
        return np.asarray(self.curvatures(x[None, :], u[None, :], np.array([t]), z[None, :])[0])

    def linearize(self, x: Array, u: Array, t: Array) -> Linearization:
        """Return A (n, nx, nx) and B (n, nx, nu) at samples."""
        m = self.mechanism
        nq, nd = m.nq, m.nd
        slopes = self.dynamics.linearize(*self._split(x, u), t).all
        J = np.zeros((len(x), self.nx, self.nx + self.nu))
        rows = np.arange(nq)
        J[:, rows, nq + rows] = 1.0
        J[:, nq : nq + nd] = slopes[:, :nd]
        kinematic = np.arange(m.nrho)
        J[:, nq + nd + kinematic, self.nx + m.nu + kinematic] = 1.0
        return Linearization(J[:, :, : self.nx], J[:, :, self.nx :])

    def curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array:
        """Return ``z . D2f`` (n, nx + nu, nx + nu) at samples."""
        m = self.mechanism
        z_a = np.ascontiguousarray(z[:, m.nq : m.nq + m.nd])
        return self.dynamics.curvature(*self._split(x, u), t, z_a=z_a)

    def _split(self, x: Array, u: Array) -> tuple[Array, Array, Array, Array]:
        """Return q, v, inputs and accelerations of the kinematic variables."""
        m = self.mechanism
        parts = (x[:, : m.nq], x[:, m.nq :], u[:, : m.nu], u[:, m.nu :])
        q, v, inputs, rho_a = (np.ascontiguousarray(part) for part in parts)
        return q, v, inputs, rho_a

    def _explain(self, points: tuple[Array, Array, Array, Array], t: float) -> None:
        """Raise the error that says why there are no accelerations."""
        try:
            self.dynamics.accelerations(*points, t)
        except ArgumentError as error:
            # A diverging roll-out, not an argument that somebody gave.
            raise DynamicsError(
                f"no accelerations at t = {t:.6g} s: {error}", t=t, variable=None
            ) from error
