"""The projection operator: from any curve to a trajectory of the system (dissertation 6.2.2).

``(x, u) = P(xbar, ubar)`` with ``x_0 = xbar_0``, ``x+ = f(x, u, k)``, ``u = ubar - K difference(x, xbar)``.
A trajectory is its own projection, so the dynamics drop out of the optimisation: instead of h over
trajectories, ``g = h o P`` is minimised over curves.

Any bounded K defines a projection, and any two of them differ by terms of second order about a
trajectory. Newton's method therefore keeps its quadratic tail whichever gains are used, as long as
its model is that of one of them; the gains decide how far a step may reach.
"""

from __future__ import annotations

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.public import public
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.system import Linearization


@public
class ProjectionOperator:
    """The projection operator of a system with given gains; as fit for several threads as the system is.

    Parameters
    ----------
    system : DiscreteSystem
    K : ndarray (N, nu, ndx)
        Gains, such as those of `leastaction.optimal.regulate`.
    """

    def __init__(self, system: DiscreteSystem, K: Array) -> None:
        expected = (system.N, system.nu, system.ndx)
        self.system = system
        self.K = as_array(K, "K", expected, meaning="(N, nu, nx)")

    def __call__(self, xbar: Array, ubar: Array) -> Rollout:
        """Return the trajectory, or the part of it up to the step that failed."""
        return self.system.rollout(xbar[0], xbar, ubar, self.K, 0, self.system.N)

    def derivative(self, linearization: Linearization, dxbar: Array, dubar: Array) -> tuple[Array, Array]:
        """Return ``DP . (dxbar, dubar)`` (N+1, ndx), (N, nu) at a trajectory with this linearisation (6.11)."""
        A, B = linearization
        dx, du = np.empty_like(dxbar), np.empty_like(dubar)
        dx[0] = dxbar[0]
        for k in range(self.system.N):
            du[k] = dubar[k] - self.K[k] @ (dx[k] - dxbar[k])
            dx[k + 1] = A[k] @ dx[k] + B[k] @ du[k]
        return dx, du

    def second_derivative(
        self, linearization: Linearization, one: tuple[Array, Array], other: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Return ``D2P . (one, other)`` at a trajectory: how `derivative` along one direction changes along another.

        It solves ``ddx+ = A ddx + B ddu + D2f (dx, du)_1 (dx, du)_2`` with ``ddu = -K ddx`` and ``ddx_0 = 0``, whose
        (dx, du) are the derivatives along the two.

        Parameters
        ----------
        linearization : Linearization
            Along the trajectory, with its second order.
        one, other : pair of ndarray (N+1, nx), (N, nu)
            Directions among curves.

        Returns
        -------
        ddx, ddu : ndarray (N+1, nx), (N, nu)

        Raises
        ------
        ArgumentError
            For a system whose states are no plain vectors.
        NotImplementedError
            If there is no second order.
        """
        if self.system.charts() is not None:
            raise ArgumentError(
                f"second_derivative: got a {type(self.system).__name__} whose states are no plain vectors, expected "
                "plain ones: of others it depends on charts"
            )
        A, B = linearization
        N, n = A.shape[:2]
        along = [self.derivative(linearization, *direction) for direction in (one, other)]
        first, second = (np.hstack([dx[:-1], du]) for dx, du in along)
        bent = np.empty((N, n))
        for i in range(n):
            weights = np.zeros((N, n))
            weights[:, i] = 1.0
            bent[:, i] = np.einsum("ki,kij,kj->k", first, linearization.curvature(weights), second)
        ddx, ddu = np.zeros_like(one[0]), np.zeros_like(one[1])
        for k in range(N):
            ddu[k] = -self.K[k] @ ddx[k]
            ddx[k + 1] = A[k] @ ddx[k] + B[k] @ ddu[k] + bent[k]
        return ddx, ddu


@public
def linearize_along_curve(system: DiscreteSystem, x: Array, u: Array) -> Linearization:
    """Return A and B of every step from the states and inputs of a curve that is no trajectory.

    The end of each step is its own, not the curve's next state. A step that cannot be made takes what the one
    before it has, for gains that are good enough to follow the curve somehow.
    """
    N, ndx, nu = system.N, system.ndx, system.nu
    A, B = np.empty((N, ndx, ndx)), np.empty((N, ndx, nu))
    made = np.zeros(N, dtype=bool)
    for k in range(N):
        try:
            A[k], B[k] = system.derivatives(x[k], u[k], k)
            made[k] = np.isfinite(A[k]).all() and np.isfinite(B[k]).all()
        except (LeastActionError, ArithmeticError):
            continue
    if not made.any():
        A[:], B[:] = np.eye(ndx), 0.0
    else:
        # The last step that could be made, or the first one for those before it.
        source = np.maximum.accumulate(np.where(made, np.arange(N), -1))
        source[source < 0] = int(np.argmax(made))
        A, B = A[source], B[source]
    return Linearization(A, B)
