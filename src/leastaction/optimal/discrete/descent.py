"""Descent directions: the minimum of a quadratic model over the tangent trajectories (6.3.2, 6.5).

Every method solves a linear-quadratic problem along the current trajectory, with the gradient of the
cost as its linear part. They differ in the quadratic part:

=============  ===========================================================================
steepest       the identity
quasi-newton   ``D2l``: the cost's own Hessian
newton         ``D2l + z_{k+1} . D2f``: the exact second derivative of the projected cost
newton-damped  ``D2l + s z_{k+1} . D2f`` with 0 < s < 1, where the exact one has no minimum
=============  ===========================================================================

with the adjoint ``z_k = l_x - K'l_u + (A - BK)'z_{k+1}`` of the loop closed with the projection's
gains (Prop. 6 and 7).

Far from a minimum the exact model is often indefinite. Damping goes back towards quasi-Newton, whose
model always has a minimum, only as far as necessary: s = 1, 1/2, 1/4, ... Making the model convex stage
by stage (``regularize="stage"`` of the linear-quadratic solver) was measured against it on swing-ups of
a cart-pendulum from rest: its directions could seldom be followed far, and took up to twice the
iterations and three times the roll-outs.
"""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import CostGradient, CostHessian
from leastaction.optimal.discrete.linear_quadratic import (
    LinearQuadraticSolution,
    Workspace,
    solve_linear_quadratic,
)
from leastaction.optimal.system import Linearization

__all__ = ["minimise_model"]


def minimise_model(
    method: str,
    linearization: Linearization,
    gradient: CostGradient,
    hessian: CostHessian,
    curvature: Array | None,
    workspace: Workspace,
    scale: float = 1.0,
) -> LinearQuadraticSolution:
    """Solve the linear-quadratic problem of a method.

    Parameters
    ----------
    method : {"steepest", "quasi-newton", "newton"}
        Which model.
    linearization, gradient, hessian
        Of dynamics and cost along the current trajectory.
    curvature : ndarray (N, nx+nu, nx+nu) or None
        ``z_{k+1} . D2f``, for "newton".
    workspace : Workspace
        Where the solution is written.
    scale : float
        Factor of the curvature.
    """
    A, B = linearization
    q, r, q_final = gradient
    Q, R, S, Q_final = hessian
    if method == "steepest":
        nx, nu = B.shape[1:]
        Q, R, S, Q_final = np.ones(nx), np.ones(nu), None, np.ones(nx)
    return solve_linear_quadratic(
        A,
        B,
        Q=Q,
        R=R,
        S=S,
        H=curvature if method == "newton" else None,
        H_scale=scale,
        q=q,
        r=r,
        Q_final=Q_final,
        q_final=q_final,
        workspace=workspace,
    )
