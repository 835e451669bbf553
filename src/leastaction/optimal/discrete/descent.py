"""Descent directions: the minimum of a quadratic model over the tangent trajectories (6.3.2, 6.5).

Every method solves a linear-quadratic problem along the current trajectory, with the gradient of the
cost as its linear part. They differ in the quadratic part:

=============  ===========================================================================
steepest       the identity
quasi-newton   ``C``: the cost's own Hessian ``D2l``, without what of it bends downwards
newton         ``D2l + z_{k+1} . D2f``: the exact second derivative of the projected cost
newton-damped  ``C + s (D2l - C + z_{k+1} . D2f)`` with 0 < s < 1, where the exact one has no minimum
=============  ===========================================================================

with the adjoint ``z_k = l_x - K'l_u + (A - BK)'z_{k+1}`` of the loop closed with the projection's
gains (Prop. 6 and 7).

Far from a minimum the exact model is often indefinite. Damping goes back towards quasi-Newton, whose model always has a
minimum, only as far as necessary, and what was necessary is remembered. Where no direction can be followed far enough,
the identity is added to the weights of all methods, ever more of it: the directions get shorter and turn towards
steepest descent (Levenberg-Marquardt). Making the model convex stage by stage (``regularize="stage"`` of the
linear-quadratic solver) was measured against it on swing-ups of a cart-pendulum from rest: its directions could seldom
be followed far, and took up to twice the iterations and three times the roll-outs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import weigh
from leastaction.optimal.discrete.cost import CostGradient
from leastaction.optimal.discrete.hessians import ModelHessian
from leastaction.optimal.discrete.linear_quadratic import (
    LinearQuadraticSolution,
    Workspace,
    recursion,
    solve_linear_quadratic,
    sweep_forward,
    unpacked,
)
from leastaction.optimal.system import Linearization


def minimise_model(
    method: str,
    linearization: Linearization,
    gradient: CostGradient,
    hessian: ModelHessian,
    curvature: Array | None,
    workspace: Workspace,
    scale: float = 1.0,
    gaps: Array | None = None,
) -> LinearQuadraticSolution:
    """Solve the linear-quadratic problem of a method.

    ``method`` {"steepest", "quasi-newton", "newton"}: which model. ``linearization``, ``gradient``, ``hessian``: of
    dynamics and cost along the current trajectory. ``curvature`` (N, nx+nu, nx+nu), or packed: ``z_{k+1} . D2f``, for
    "newton".
    ``workspace``: where the solution is written. ``scale``: factor of the curvature. ``gaps``
    (N, nx): what the steps of a curve miss its next states by, to be closed; with P of every stage for its costates.
    """
    A, B = linearization
    q, r, q_final = gradient
    if method == "steepest":
        nx, nu = B.shape[1:]
        hessian = ModelHessian(np.ones(nx), np.ones(nu), None, np.ones(nx))
    problem: dict[str, Any] = dict(
        hessian._asdict(), H=curvature if method == "newton" else None, H_scale=scale, q=q, r=r, q_final=q_final,
        c=gaps, pattern=linearization.pattern, keep_P=gaps is not None,
    )  # fmt: skip
    try:
        return recursion(A, B, workspace, **problem)
    except (AttributeError, TypeError, ValueError):
        # A cost of the user's may return what the core does not take: it is made an array, or an error names it.
        return solve_linear_quadratic(A, B, workspace=workspace, **problem)


def escape(
    linearization: Linearization,
    gradient: CostGradient,
    hessian: Callable[[float], ModelHessian],
    curvature: Array,
    workspace: Workspace,
    scale: float,
) -> tuple[Array, Array, float, float] | None:
    """Return a direction of negative curvature, its slope and curvature.

    Between the part of the curvature that leaves the model a minimum and the whole of it there is one at which
    the model is flat along some direction: the exact second derivative is negative along it. It is found by
    inverse iteration with models that come close. ``hessian``: the weights that go with a part of the curvature.
    """
    A, B = linearization
    if B.shape[2] == 0:
        return None
    whole = hessian(1.0)
    full = curvature
    if curvature.ndim == 2:
        assert linearization.pattern is not None
        full = unpacked(curvature, linearization.pattern)

    du = np.random.default_rng(0).normal(size=B.shape[::2])
    low, high = scale, 1.0
    best, clear = None, False
    for solved in range(60):
        if clear and solved >= 8:
            break
        trial = 0.5 * (low + high)
        weights = hessian(trial)
        model = solve_linear_quadratic(
            A, B, H=curvature, H_scale=trial, r=-du, pattern=linearization.pattern, workspace=workspace,
            **weights._asdict(),
        )  # fmt: skip
        if not model.definite:
            high = trial
            continue
        low = trial
        dx, du = sweep_forward(A, B, model, pattern=linearization.pattern)
        size = float(np.sqrt(np.sum(du**2)))
        dx, du = dx / size, du / size
        bend = _along(whole, full, dx, du)
        if bend < 0.0:
            slope = float(np.sum(gradient.q * dx[:-1]) + np.sum(gradient.r * du) + gradient.q_final @ dx[-1])
            sign = -1.0 if slope > 0.0 else 1.0
            best = sign * dx, sign * du, sign * slope, bend
            # As long as the model bends up by more than the whole bends down, most of it is what has nothing to do
            # with that, and on which cost and model may differ by as much.
            clear = -bend > _along(weights, trial * full, dx, du)
    return best


def _along(hessian: ModelHessian, curvature: Array, dx: Array, du: Array) -> float:
    """Return the second derivative of the cost along a direction."""
    dxu = np.hstack([dx[:-1], du])
    total = float(np.einsum("ki,kij,kj->", dxu, curvature, dxu))
    total += float(np.sum(weigh(hessian.Q, dx[:-1]) * dx[:-1]) + np.sum(weigh(hessian.R, du) * du))
    total += float(weigh(hessian.Q_final, dx[-1:])[0] @ dx[-1])
    if hessian.S is not None:
        total += 2.0 * float(np.sum(dx[:-1] * np.einsum("...ij,...j->...i", hessian.S, du)))
    if hessian.part is not None:
        few = dxu[:, hessian.part.columns]
        total += float(np.einsum("ki,kij,kj->", few, hessian.part.matrices, few))
    return total
