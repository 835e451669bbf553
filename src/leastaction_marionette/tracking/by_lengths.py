"""A motion by tensions as one of the puppet on strings of prescribed lengths, and the same the other way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.mechanics import Trajectory
from leastaction.models.marionette import string_lengths
from leastaction.numerics import Array
from leastaction.optimal import OptimizationResult, Status, regulate
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.settle import NotTiedError, settled

_SAME = 1e-6  # m or rad, by which the same motion may differ, by tensions and by lengths
_NEARLY = 1e-3  # of limits, by which a motion that keeps to them may be off


def by_lengths(plan: TrackingPlan, result: OptimizationResult) -> OptimizationResult:
    """Return a result of this system as one of the puppet on strings of prescribed lengths: the same motion.

    With strings on bars it is one near it on which their lengths are exact and limits are kept. Raises `NotTiedError`
    where there is none.
    """
    problem = plan.problem
    N, nq, system = len(plan.t) - 1, problem.mechanism.nq, problem.system
    if plan.ties is None:
        x, u = _said_by_lengths(plan, result.x, result.u)
    else:
        x, u = _tied(plan, result)
        result = _qualified(plan, result, x, u)
    try:
        A, B = system.linearize(x, u)
        cost = problem.cost(plan.weights.tension).hessian(x, u)
        K = regulate(A, B, Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
    except LeastActionError:  # where strings have lost their grip there is no regulator; the motion stands
        K = np.zeros((N, system.nu, system.ndx))
    done = system.rollout(x[0], x, u, K, 0, N)
    # Rods push where strings lose their grip: what has gone another way there is another motion.
    if done.complete and np.abs(done.x[:, :nq] - x[:, :nq]).max() < _SAME:
        x, u = done.x, done.u
    return replace(result, x=x, u=u, K=K, projection_gain=K, state=None)


def _said_by_lengths(plan: TrackingPlan, x: Array, u: Array) -> tuple[Array, Array]:
    """Return states and inputs by lengths of what is said by tensions."""
    m, whole = plan.mechanism, plan.problem.mechanism
    N, nq, first = len(u), whole.nq, whole.first_rho
    q = np.zeros((N + 1, nq))
    q[:, plan.columns] = x[:, : m.nq]
    lengths = string_lengths(whole, q)
    q[:, first + plan.lengths] = lengths[:, plan.held]
    made = plan.problem.system.states_along(q, x[:, m.nq : m.nq + m.nd])
    share = np.full((N, 1), plan.dt)
    share[0] *= 0.5
    made[1:, whole.nx :] = share * u[:, : len(plan.strings)] / (2.0 * lengths[:-1])
    made[0, whole.nx :] = 2.0 * made[1, whole.nx :]
    return made, q[1:, first:]


def _tied(plan: TrackingPlan, result: OptimizationResult) -> tuple[Array, Array]:
    """Return a motion by lengths near a result, with strings on bars as long as they are tied.

    Raises `NotTiedError` where none is found.
    """
    found = settled(plan.problem, plan.limits, *_said_by_lengths(plan, result.x, result.u))
    if found is None:
        raise NotTiedError(
            "strings on bars: no motion is found in which all of them pull. Lower the least tension, allow bars "
            "more reach, or let hands hold more strings"
        )
    return found


def _qualified(plan: TrackingPlan, result: OptimizationResult, x: Array, u: Array) -> OptimizationResult:
    """Return a result that does not say it converged where the motion by lengths breaks limits."""
    problem, limits = plan.problem, plan.limits
    broken = limits.loosened(_NEARLY).broken(problem.mechanism, problem.t, problem.pelvis, x)
    pulls = np.stack(list(problem.system.trajectory(x, u).tensions().values()))
    if not limits.keep(pulls[:, 1:], _NEARLY):
        broken |= {"tension"}
    if not (broken and result.success):
        return result
    kinds = ", ".join(sorted(broken))
    said = f"Where strings on bars keep their lengths it breaks limits of {kinds}, by as little as was found."
    return replace(result, status=Status.INFEASIBLE, message=said)


def by_tensions(
    plan: TrackingPlan, trajectory: Trajectory, tension: Array, result: OptimizationResult
) -> OptimizationResult:
    """Return a motion on strings of prescribed lengths, and its result, as one of this system: the same motion."""
    m = plan.mechanism
    x = plan.system.states_along(trajectory.q[:, plan.columns], trajectory.p)
    u = np.hstack([tension, x[1:, m.first_rho : m.nq]])
    K = next(plan.regulators(x, u), np.zeros((plan.system.N, plan.system.nu, plan.system.ndx)))
    return replace(result, x=x, u=u, K=K, projection_gain=K, limits=None, state=None)
