"""A motion by tensions as one of the puppet on strings of prescribed lengths, and the same the other way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from leastaction.apps.marionette.tracking.plan import Plan
from leastaction.apps.marionette.tracking.settle import NotTiedError, settled
from leastaction.errors import LeastActionError
from leastaction.mechanics import Trajectory
from leastaction.models.marionette import string_lengths
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult
from leastaction.optimal.discrete.linear_quadratic import regulate

_SAME = 1e-6  # m or rad, by which the same motion may differ, by tensions and by lengths


def by_lengths(plan: Plan, result: OptimizationResult) -> OptimizationResult:
    """Return a result of this system as one of the puppet on strings of prescribed lengths: the same motion.

    With strings on bars it is the nearest one on which their lengths are exact. Raises `NotTiedError` where there
    is none.
    """
    m, whole, problem, dt = plan.mechanism, plan.problem.mechanism, plan.problem, plan.dt
    N, system = len(plan.t) - 1, problem.system
    if plan.ties is not None:
        x, u = _tied(plan, result)
        result = replace(result, x=x, u=u)
    q = np.zeros((N + 1, whole.nq))
    q[:, plan.columns] = result.x[:, : m.nq]
    lengths = string_lengths(whole, q)
    q[:, whole.nd + plan.lengths] = lengths[:, plan.held]
    x = np.zeros((N + 1, system.nx))
    x[:, : whole.nq] = q
    x[:, whole.nq : whole.nq + whole.nd] = result.x[:, m.nq : m.nq + m.nd]
    x[1:, whole.nq + whole.nd : whole.nx] = np.diff(q[:, whole.nd :], axis=0) / dt
    share = np.full((N, 1), dt)
    share[0] *= 0.5
    x[1:, whole.nx :] = share * result.u[:, : len(plan.strings)] / (2.0 * lengths[:-1])
    x[0, whole.nx :] = 2.0 * x[1, whole.nx :]
    u = q[1:, whole.nd :]
    try:
        A, B = system.linearize(x, u)
        cost = problem.cost(plan.weights.tension).hessian(x, u)
        K = regulate(A, B, Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
    except LeastActionError:  # where strings have lost their grip there is no regulator; the motion stands
        K = np.zeros((N, system.nu, system.nx))
    done = system.rollout(x[0], x, u, K, 0, N)
    # Rods push where strings lose their grip: what has gone another way there is another motion.
    if done.complete and np.abs(done.x[:, : whole.nq] - x[:, : whole.nq]).max() < _SAME:
        x, u = done.x, done.u
    return replace(result, x=x, u=u, K=K, projection_gain=K)


def _tied(plan: Plan, result: OptimizationResult) -> tuple[Array, Array]:
    """Return a motion near a result with strings on bars as long as they are tied.

    Raises `NotTiedError` where none is found.
    """
    assert plan.ties is not None
    found = settled(plan.system, plan.ties, result.x, result.u, inputs=plan.mechanism.inputs, least=plan.limits.tension)
    if found is None:
        raise NotTiedError(
            "strings on bars: no motion is found in which all of them pull. Lower the least tension, allow bars "
            "more reach, or let hands hold more strings"
        )
    return found


def by_tensions(plan: Plan, trajectory: Trajectory, tension: Array, result: OptimizationResult) -> OptimizationResult:
    """Return a motion on strings of prescribed lengths, and its result, as one of this system: the same motion."""
    m = plan.mechanism
    x = np.zeros((len(plan.t), m.nx))
    x[:, : m.nq] = trajectory.q[:, plan.columns]
    x[:, m.nq : m.nq + m.nd] = trajectory.p
    x[1:, m.nq + m.nd :] = np.diff(x[:, m.nd : m.nq], axis=0) / plan.dt
    u = np.hstack([tension, x[1:, m.nd : m.nq]])
    K = next(plan.regulators(x, u), np.zeros((plan.system.N, plan.system.nu, plan.system.nx)))
    return replace(result, x=x, u=u, K=K, projection_gain=K, limits=None)
