"""The cost of tracking: distance from a reference motion, and the acceleration of what is prescribed."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal import CostGradient, CostHessian, QuadraticCost


class TrackingCost(QuadraticCost):
    """Quadratic tracking cost with a price on the acceleration of the kinematic variables.

    The acceleration over a step is ``((rho_next - rho)/dt - v_rho)/dt``: linear in state and input, so the
    cost stays quadratic.

    Parameters
    ----------
    x_reference, u_reference, Q, R
        As in `QuadraticCost`; Q and R diagonal.
    dt : float
        Time step (s).
    rho, v_rho, rho_next : slice
        Where these are in the state and in the input.
    acceleration : float
        Weight of half the squared acceleration.
    """

    def __init__(
        self,
        x_reference: Array,
        u_reference: Array,
        *,
        Q: Array,
        R: Array,
        dt: float,
        rho: slice,
        v_rho: slice,
        rho_next: slice,
        acceleration: float,
    ) -> None:
        super().__init__(x_reference, u_reference, Q=Q, R=R)
        nx, nu = len(Q), len(R)
        count = rho.stop - rho.start
        a_x, a_u = np.zeros((count, nx)), np.zeros((count, nu))
        diagonal = np.arange(count)
        a_x[diagonal, rho.start + diagonal] = -1.0 / dt**2
        a_x[diagonal, v_rho.start + diagonal] = -1.0 / dt
        a_u[diagonal, rho_next.start + diagonal] = 1.0 / dt**2
        self._dt, self._rho, self._v_rho, self._rho_next = dt, rho, v_rho, rho_next
        self._weight = acceleration
        self._hessian = CostHessian(
            np.diag(Q) + acceleration * a_x.T @ a_x,
            np.diag(R) + acceleration * a_u.T @ a_u,
            acceleration * a_x.T @ a_u,
            self.Q_final,
        )

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        """Return the costs (n,) of steps from `start` on."""
        squares = np.sum(self._acceleration(x, u) ** 2, axis=1)
        return np.asarray(super().stage_values(x, u, start) + 0.5 * self._weight * squares)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives along a trajectory."""
        tracking = super().gradient(x, u)
        slope = self._weight * self._acceleration(x[:-1], u)
        q, r = tracking.q.copy(), tracking.r.copy()
        q[:, self._rho] -= slope / self._dt**2
        q[:, self._v_rho] -= slope / self._dt
        r[:, self._rho_next] += slope / self._dt**2
        return CostGradient(q, r, tracking.q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:  # noqa: ARG002
        """Return the second derivatives, the same along every trajectory."""
        return self._hessian

    def _acceleration(self, x: Array, u: Array) -> Array:
        velocity = (u[:, self._rho_next] - x[:, self._rho]) / self._dt
        return np.asarray((velocity - x[:, self._v_rho]) / self._dt)
