"""Exact derivatives of whole trajectories, and of how they may start, by the named parameters of the mechanism.

`sensitivity` is a method of `MidpointVI`, which is ``vi`` here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.configuration.null_space import free_variables
from leastaction.mechanics.discrete.derivatives import linearize
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.prescribed import held
from leastaction.mechanics.discrete.step_sensitivity import momentum_by, steps_by
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import momentum_derivatives, rates_turned
from leastaction.numerics.arrays import Array, Row, as_array
from leastaction.numerics.differences import fourth_order
from leastaction.numerics.public import public

_ROUNDING = 1e-9  # of a constraint's derivative, relative to its terms
_STEP = 1e-3  # of a parameter, relative to its size
_SMALL = 10  # states up to which derivatives are accumulated for all steps at once


@public
@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of a whole trajectory by parameters, its inputs held. Threads may share it.

    Attributes
    ----------
    names : tuple of str
        The parameters.
    x : ndarray, shape (N+1, ndx, len(names))
        Of the states ``[q; rho; p; v_rho]``, of rotations that are quaternions by turns in their own axes.
    lam : ndarray, shape (N, nc, len(names))
        Of the multipliers.
    """

    names: tuple[str, ...]
    x: Array
    lam: Array


def sensitivity(
    vi: Integrator,
    trajectory: Trajectory,
    names: Sequence[str],
    *,
    v: Row | None = None,
    dx0: ArrayLike | None = None,
    hold: Sequence[str] | None = None,
) -> Sensitivity:
    """Return the exact derivatives of a trajectory by some parameters, its inputs held.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism.
    names : sequence of str
        Parameters, among the names of `Mechanism.parameters`.
    v : array_like, shape (nv,), optional
        The velocity that the trajectory started from: the momentum there depends on the masses. Without
        it (and without `dx0`) the start is a state of its own, which depends on nothing.
    dx0 : array_like, shape (ndx, len(names)), optional
        Derivatives of the initial state, instead of `v` and `hold`.
    hold : sequence of str, optional
        Variables that keep their values and velocities at the start where a parameter changes the constraints
        there, such as the length of a rod in a closed loop. The others follow, as `project_configuration` and
        `project_velocity` would have them: by the least change that is needed.

    Raises
    ------
    ArgumentError, StepError
        As in `differentiate_by`; if both dx0 and v or hold are given; or if a parameter changes the
        constraints at the start and nothing says how that follows.
    """
    m = vi.mechanism
    if dx0 is not None and (v is not None or hold is not None):
        raise ArgumentError(f"sensitivity: got both {'hold' if v is None else 'v'} and dx0; give one of them")
    d = linearize(vi, trajectory, multipliers=True)
    steps = steps_by(vi, trajectory.t, trajectory.x, trajectory.u, names)
    x = np.zeros((trajectory.steps + 1, m.ndx, len(steps.names)))
    if dx0 is not None:
        x[0] = as_array(dx0, "dx0", (m.ndx, len(steps.names)))
    else:
        m = m.at_time(trajectory.t[0])
        x[0, : m.nd] = dq = start_by(vi.like(m), trajectory.q[0], steps.names, hold)
        if v is not None:
            q, v0 = trajectory.q[0], as_array(v, "v", (m.nv,), names=m.variables)
            dv = velocity_by(m, q, v0, steps.names, dq, hold)
            by_q, by_v = momentum_derivatives(m, q, v0)
            x[0, m.nv : m.nv + m.nd] = momentum_by(m, q, v0, names) + by_q[:, : m.nd] @ dq + by_v[:, : m.nd] @ dv
    _accumulate(d.A, steps.x, x)
    return Sensitivity(steps.names, x, d.lam_dx @ x[:-1] + steps.lam)


def start_by(vi: Integrator, q: Array, names: Sequence[str], hold: Sequence[str] | None) -> Array:
    """Return derivatives (nd, len(names)) of a start at q that stays on the constraints, some variables held."""
    m = vi.mechanism
    free = free_variables(m, hold or ())
    # A step of a mechanism at rest ends where the constraints are, whatever they depend on.
    dt, none = 1e-2, np.zeros(m.n_inputs)
    p, _ = vi.core.momenta(q, q, none, dt, dt)
    still = np.tile(np.concatenate([q, p[: m.nd], np.zeros(m.nrho)]), (2, 1))
    inputs = np.concatenate([none, held(m, q[m.first_rho :])])[None, :]
    C = m.constraint_jacobian(q)[:, : m.nd]
    if m.core.timed:  # its constraints do not stay where they are
        by = _by_numbers(m, names, lambda changed: changed.constraint_values(q))
        dq = np.linalg.lstsq(C, -by, rcond=_ROUNDING)[0]
    else:
        dq = steps_by(vi, np.array([0.0, dt]), still, inputs, names).x[0, : m.nd]
    needed, size = C @ dq, np.abs(C) @ np.abs(dq)
    moved = np.abs(needed) > _ROUNDING * np.maximum(1.0, size)
    if not moved.any():
        return np.zeros_like(dq)
    row, column = np.argwhere(moved)[0]
    what = f"the parameter {names[column]!r} changes the constraint {m.constraints[row]!r}"
    if hold is None:
        raise ArgumentError(
            f"sensitivity: {what}, so that the start would not satisfy it any more. Give hold=, the variables that "
            "keep their values while the others follow, or dx0=, how the start depends on the parameters"
        )
    follow = np.linalg.lstsq(C[:, free], needed, rcond=_ROUNDING)[0]
    missed = np.abs(C[:, free] @ follow - needed) > _ROUNDING * np.maximum(1.0, size)
    if missed.any():
        row, column = np.argwhere(missed)[0]
        raise ArgumentError(
            f"hold: with {', '.join(map(repr, hold))} held nothing keeps the constraint {m.constraints[row]!r} where "
            f"the parameter {names[column]!r} changes; hold fewer variables"
        )
    out = np.zeros_like(dq)
    out[free] = follow
    return out


def velocity_by(m: Mechanism, q: Array, v: Array, names: Sequence[str], dq: Array, hold: Sequence[str] | None) -> Array:
    """Return derivatives (nd, len(names)) of a velocity that keeps the constraints as they change.

    ``Dh v + dh/dt = 0`` at the start, whose configuration changes by dq; the velocities of held variables stay.
    """
    dv = np.zeros_like(dq)
    if not names or not m.nc or not (m.core.timed or np.any(v)):
        return dv
    C = m.constraint_jacobian(q)
    bends = np.stack([m.core.constraint_hessian(q, row) for row in np.eye(m.nc)])
    turned = (np.einsum("cij,i->cj", bends, v) + rates_turned(m, C, v) + m.core.constraint_drift(q)[1])[:, : m.nd] @ dq
    turned += _by_numbers(m, names, lambda changed: changed.constraint_rates(q, v))
    size = np.abs(C) @ np.abs(v)
    moved = np.abs(turned) > _ROUNDING * np.maximum(1.0, size)[:, None]
    if not moved.any():
        return dv
    row, column = np.argwhere(moved)[0]
    what = (
        f"the velocity v does not keep the constraint {m.constraints[row]!r} as the parameter {names[column]!r} changes"
    )
    if hold is None:
        raise ArgumentError(
            f"sensitivity: {what}. Give hold=, the variables that keep their velocities while the others follow, or "
            "dx0=, how the start depends on the parameters"
        )
    free = free_variables(m, hold)
    follow = np.linalg.lstsq(C[:, free], -turned, rcond=_ROUNDING)[0]
    if np.any(np.abs(C[:, free] @ follow + turned) > _ROUNDING * np.maximum(1.0, size)[:, None]):
        raise ArgumentError(f"hold: {what}, with the velocities of {', '.join(map(repr, hold))} held; hold fewer")
    dv[free] = follow
    return dv


def _by_numbers(m: Mechanism, names: Sequence[str], of: Callable[[Mechanism], Array]) -> Array:
    """Return the derivatives (nc, len(names)) of what is asked of constraints by some parameters.

    By differences of fourth order; constraints are polynomials in most of their numbers, so it is exact to rounding.
    """

    def by_one(name: str) -> Array:
        value = m.parameters[name]
        return fourth_order(lambda by: of(m.with_parameters({name: value + by})), _STEP * (abs(value) or 1.0))

    return np.stack([by_one(name) for name in names], axis=1)


def _accumulate(A: Array, added: Array, x: Array) -> None:
    """Fill in ``x_{k+1} = A_k x_k + added_k`` from the first x (nx, columns) on."""
    nx, columns = x.shape[1:]
    if nx > _SMALL or not added.size:
        for Ak, before, after, new in zip(A, x[:-1], x[1:], added, strict=True):
            np.matmul(Ak, before, out=after)
            after += new
        return
    # A loop in Python would take longer than the steps of a small mechanism themselves: substitute forward in
    # the banded matrix of these equations. Imported here, so that to import the package is quick.
    from scipy.linalg import lapack

    steps, entry = len(A), np.arange(nx)
    band = np.zeros((2 * nx, steps * nx), order="F")
    columns_of_steps = nx * np.arange(steps - 1)[:, None, None] + entry
    band[nx + entry[:, None] - entry, columns_of_steps] = -A[1:]
    right = added.copy()
    right[0] += A[0] @ x[0]
    found, _ = lapack.dtbtrs(band, right.reshape(steps * nx, columns), uplo="L", diag="U")
    x[1:] = found.reshape(steps, nx, columns)
