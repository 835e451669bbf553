"""Gains about a motion on a mesh, as functions of time."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial
from leastaction.optimal.collocation.cost import AnyCollocationCost
from leastaction.optimal.collocation.system import CollocationSystem
from leastaction.optimal.continuous.cost import ContinuousCost, ContinuousQuadraticCost
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic
from leastaction.optimal.system import Linearization


def regulator_along(
    on_mesh: CollocationSystem,
    own_cost: ContinuousCost,
    curve: DenseTrajectory,
    linearization: Linearization,
    x: Array,
    u: Array,
) -> PiecewisePolynomial:
    """Return the gains of the cost's own regulator, without limits, and no feedforward, as functions of time."""
    system, mesh, layout = on_mesh.system, on_mesh.mesh, on_mesh.layout
    nx, nu = system.nx, system.nu
    even = ContinuousQuadraticCost(np.zeros(nx), np.zeros(nu), Q=np.ones(nx), R=np.ones(nu), Q_final=np.ones(nx))
    for cost in (own_cost, even):
        Q, R, S, Q_final = AnyCollocationCost(cost, mesh, layout).hessian(x, u)
        solution = solve_linear_quadratic(*linearization, Q=Q, R=R, S=S, Q_final=Q_final, keep_P=True)
        if solution.definite:
            break
    assert solution.P is not None
    # What the piece before costs is no part of the cost to go.
    P = solution.P[:, :nx, :nx] - np.concatenate([Q, Q_final[None]])[:, :nx, :nx]
    P[-1] += cost.final_hessian(x[-1, :nx], float(mesh.breaks[-1]))

    def gains(t: Array, P: Array) -> tuple[Array, Array]:
        """Return K, and the slope of P."""
        x, u = curve.sample(t)
        A, B = system.linearize(x, u, t)
        Q, R, S = cost.hessian(x, u, t)
        right = B.transpose(0, 2, 1) @ P
        if S is not None:
            right += S.transpose(0, 2, 1)
        K = np.asarray(np.linalg.solve(R, right), dtype=np.float64)
        pull = P @ A
        return K, right.transpose(0, 2, 1) @ K - Q - pull - pull.transpose(0, 2, 1)

    # Between the ends of a piece P is the cubic that has its values and slopes there.
    h, fine = mesh.h[:, None, None, None], Mesh(mesh.breaks)
    begin, end = (gains(t, at)[1][:, None] for t, at in ((mesh.breaks[:-1], P[:-1]), (mesh.t[:, -1], P[1:])))
    s = ((fine.t.reshape(mesh.N, -1) - mesh.breaks[:-1, None]) / mesh.h[:, None])[:, :, None, None]
    step = P[1:, None] - P[:-1, None]
    between = P[:-1, None] + s * s * (3.0 - 2.0 * s) * step
    between = between + h * s * (1.0 - s) * ((1.0 - s) * begin - s * end)
    K = gains(fine.t, between.reshape(-1, nx, nx))[0].reshape(len(fine.t), -1)
    return fine.fit(np.hstack([K, np.zeros((len(K), nu))]), (nu * nx + nu,))
