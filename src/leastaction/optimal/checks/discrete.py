"""Holds discrete systems and costs to their derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.differences import central_differences
from leastaction.optimal.checks.differences import Errors
from leastaction.optimal.discrete.charts import along_charts
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.discrete.system import DiscreteSystem, linearized
from leastaction.optimal.space import StateSpace, moved_by
from leastaction.optimal.system import second_derivative, space_of


def compare_discrete(system: DiscreteSystem, x: ArrayLike, u: ArrayLike, cost: Cost | None, seed: int) -> Errors:
    """Return by how much the derivatives along a curve differ from differences of one order less."""
    N, nx, nu = system.N, system.nx, system.nu
    states = read_only(as_array(x, "x", (N + 1, nx), meaning="(N+1, nx)"))
    inputs = read_only(as_array(u, "u", (N, nu), meaning="(N, nu)"))
    rng = np.random.default_rng(seed)
    errors = Errors()
    for k in sorted({0, N // 3, N - 1}):
        errors.compare(system, states[k], inputs[k], k, rng.standard_normal(system.ndx))
    _compare_rollout(system, states, inputs, rng, errors)
    _compare_whole(system, states, inputs, rng, errors)
    if cost is not None:
        _compare_cost(cost, system.charts(), states, inputs, rng, errors)
    return errors


def compare_cost(cost: Cost, x: ArrayLike, u: ArrayLike, seed: int) -> Errors:
    """Return the same of a cost alone, over states that are what its own `space` says, if it has one."""
    states, inputs = as_array(x, "x", (None, None), meaning="(N+1, nx)"), as_array(u, "u", (None, None))
    N = len(inputs)
    if len(states) != N + 1:
        raise ArgumentError(f"x, u: got {len(states)} states and {N} inputs, expected one state more than inputs")
    cost.check_shapes(N, states.shape[1], inputs.shape[1])
    errors = Errors()
    space = space_of(getattr(cost, "space", None))
    _compare_cost(cost, space, read_only(states.copy()), read_only(inputs.copy()), np.random.default_rng(seed), errors)
    return errors


def _compare_rollout(system: DiscreteSystem, x: Array, u: Array, rng: np.random.Generator, errors: Errors) -> None:
    """Hold the roll-out to single steps from the states that it passed.

    Two roll-outs, each on its own, would part: an unstable system amplifies their rounding at every step.
    """
    N, ndx, nu = system.N, system.ndx, system.nu
    K = 0.1 * rng.standard_normal((N, nu, ndx))
    part = system.rollout(x[0], x, u, K, 0, min(N, 10))
    done = part.steps_done
    states = read_only(part.x)
    if done < min(N, 10):
        deviation = system.difference(states[done], x[done])
        try:
            with np.errstate(all="ignore"):
                goes_on = bool(np.isfinite(system.f(states[done], u[done] - K[done] @ deviation, done)).all())
        except (StepError, ArithmeticError):
            goes_on = False
        if goes_on:
            raise ArgumentError(f"system.rollout: made {done} steps ({part.failure}), where f makes the next one too.")
    for k in range(done):
        law = u[k] - K[k] @ system.difference(states[k], x[k])
        errors.note("rollout", part.u[k], law)
        errors.note("rollout", states[k + 1], system.f(states[k], read_only(part.u[k]), k))


def _compare_whole(system: DiscreteSystem, x: Array, u: Array, rng: np.random.Generator, errors: Errors) -> None:
    """Hold the derivatives over the whole horizon to those of single steps."""
    N, ndx = system.N, system.ndx
    try:
        linearization = linearized(system, x, u)
    except StepError:
        # A step may be looked for near the next state that is given: that of a curve can be far off.
        run = system.rollout(x[0], x, u, np.zeros((N, system.nu, ndx)), 0, N)
        if not run.complete:
            raise
        x, u = read_only(run.x), read_only(run.u)
        linearization = linearized(system, x, u)
    A, B = linearization
    steps = sorted({0, N // 2, N - 1})
    singles = [system.derivatives(x[k], u[k], k) for k in steps]
    errors.note("linearize", A[steps], np.stack([A_k for A_k, _ in singles]))
    errors.note("linearize", B[steps], np.stack([B_k for _, B_k in singles]))
    if system.has_curvature:
        z = read_only(rng.standard_normal((N + 1, ndx)))
        H = linearization.curvature(z)
        single = np.stack([second_derivative(system, x[k], u[k], k, z[k + 1]) for k in steps])
        errors.note("curvatures", H[steps], single)


def _compare_cost(
    cost: Cost, space: StateSpace | None, x: Array, u: Array, rng: np.random.Generator, errors: Errors
) -> None:
    """Along a random direction over the whole curve."""
    dx = rng.standard_normal((len(x), x.shape[1] if space is None else space.ndx))
    du = rng.standard_normal(u.shape)

    def value(s: Array) -> Array:
        return np.array([cost.value(moved_by(space, x, s * dx), u + s * du)])

    def slope(s: Array) -> Array:
        there = moved_by(space, x, s * dx)
        q, r, q_final = cost.gradient(there, u + s * du)
        on = dx if space is None else along_charts(space, x, there, dx)
        return np.array([np.sum(q * on[:-1]) + np.sum(r * du) + q_final @ on[-1]])

    def form(weight: Array, left: Array, right: Array) -> float:
        if weight.ndim == 1 or weight.shape[-1] == 1 != right.shape[-1]:
            return float(np.sum(left * weight.reshape(-1, left.shape[-1]) * right))
        return float(np.sum(left * np.einsum("...ij,...j->...i", weight, right)))

    def bend(hessian: CostHessian) -> Array:
        Q, R, S, Q_final = hessian
        curvature = form(Q, dx[:-1], dx[:-1]) + form(R, du, du) + form(Q_final, dx[-1], dx[-1])
        if S is not None:
            curvature += 2.0 * form(S, dx[:-1], du)
        return np.array([curvature])

    zero, bent = np.zeros(1), bend(cost.hessian(x, u))
    errors.note("cost gradient", slope(zero), central_differences(value, zero)[:, 0])
    errors.note("cost hessian", bent, central_differences(slope, zero)[:, 0])
    errors.note("cost model_hessian", bend(cost.model_hessian(x, u, convex=False).whole()), bent)
