"""Exact derivatives of the discrete step by the named parameters of the mechanism.

`differentiate_by` and `sensitivity` are methods of `MidpointVI`, which is ``vi`` here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.configuration.null_space import free_variables
from leastaction.mechanics.description.tree import WORLD
from leastaction.mechanics.discrete.derivatives import linearize, linearize_arrays
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.parameters import (
    BodyNumber,
    ElementNumber,
    JointNumber,
    Length,
    Place,
    Prescribed,
    inertia_slope,
)
from leastaction.numerics.arrays import Array, as_array

_ROUNDING = 1e-9  # of a constraint's derivative, relative to its terms
_STEP = 1e-3  # of a parameter, relative to its size
_SMALL = 10  # states up to which derivatives are accumulated for all steps at once


@dataclass(frozen=True)
class StepSensitivity:
    """Derivatives of every step by parameters, its start and its inputs held. Threads may share it.

    Attributes
    ----------
    names : tuple of str
        The parameters.
    x : ndarray, shape (N, nx, len(names))
        Of the state at the end of each step.
    lam : ndarray, shape (N, nc, len(names))
        Of its multipliers.
    """

    names: tuple[str, ...]
    x: Array
    lam: Array


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of a whole trajectory by parameters, its inputs held. Threads may share it.

    Attributes
    ----------
    names : tuple of str
        The parameters.
    x : ndarray, shape (N+1, nx, len(names))
        Of the states ``[q; rho; p; v_rho]``.
    lam : ndarray, shape (N, nc, len(names))
        Of the multipliers.
    """

    names: tuple[str, ...]
    x: Array
    lam: Array


def differentiate_by(vi: Integrator, trajectory: Trajectory, names: Sequence[str]) -> StepSensitivity:
    """Return the exact first derivatives of every step by some parameters.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism.
    names : sequence of str
        Parameters, among the names of `Mechanism.parameters`.

    Raises
    ------
    ArgumentError
        For an unknown parameter, or a trajectory of a mechanism with other variables.
    StepError
        Where the arrays are not a trajectory of the mechanism.
    """
    linearize(vi, trajectory, multipliers=False)  # its checks
    return steps_by(vi, trajectory.t, trajectory.x, trajectory.u, names)


def sensitivity(
    vi: Integrator,
    trajectory: Trajectory,
    names: Sequence[str],
    *,
    v: ArrayLike | None = None,
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
    v : array_like, shape (nq,), optional
        The velocity that the trajectory started from: the momentum there depends on the masses. Without
        it (and without `dx0`) the start is a state of its own, which depends on nothing.
    dx0 : array_like, shape (nx, len(names)), optional
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
    x = np.zeros((trajectory.steps + 1, m.nx, len(steps.names)))
    if dx0 is not None:
        x[0] = as_array(dx0, "dx0", (m.nx, len(steps.names)))
    else:
        x[0, : m.nd] = dq = start_by(vi, trajectory.q[0], steps.names, hold)
        if v is not None:
            q, v0 = trajectory.q[0], as_array(v, "v", (m.nq,), names=m.variables)
            dv = _velocity_by(m, q, v0, steps.names, dq, hold)
            _, by_q, by_v = m.core.hessian(q, v0)
            x[0, m.nq : m.nq + m.nd] = momentum_by(m, q, v0, names) + by_q[: m.nd, : m.nd] @ dq
            x[0, m.nq : m.nq + m.nd] += by_v[: m.nd, : m.nd] @ dv
    _accumulate(d.A, steps.x, x)
    return Sensitivity(steps.names, x, d.lam_dx @ x[:-1] + steps.lam)


def steps_by(
    vi: Integrator, t: Array, x: Array, u: Array, names: Sequence[str], *, first_share: float = 1.0
) -> StepSensitivity:
    """Differentiate every step along arrays of a trajectory, which are not checked, by parameters.

    Numbers of elements are differentiated by one dual evaluation each, inertias through the linearity of
    the Lagrangian in them, lengths as what they are: prescribed variables that do not move, and numbers of joints as
    prescribed motions. ``first_share``: the part of the first step for which forces at the instants act at its start.
    """
    m = vi.mechanism
    places = m.parameter_places(names)
    by_x = np.zeros((len(u), m.nx, len(places)))
    by_lam = np.zeros((len(u), m.nc, len(places)))
    lengths = {name: place for name, place in places.items() if isinstance(place, Prescribed)}
    columns = {name: column for column, name in enumerate(places)}
    if lengths:
        chosen = [columns[name] for name in lengths]
        by_x[:, :, chosen], by_lam[:, :, chosen] = _by_lengths(vi, t, x, u, lengths, first_share)
    others = {name: place for name, place in places.items() if name not in lengths}
    if others:
        directions, inertias = _directions(m, others)
        out = vi.core.by_parameters(t, x, u, directions, inertias, threads=vi.threads, first_share=first_share)
        chosen = [columns[name] for name in others]
        by_x[:, :, chosen], by_lam[:, :, chosen] = out.x, out.lam
    return StepSensitivity(tuple(places), by_x, by_lam)


def by_time_step(vi: Integrator, t: Array, x: Array, u: Array, *, first_share: float = 1.0) -> StepSensitivity:
    """Differentiate every step along arrays by its length, its start, its inputs and its prescribed end held."""
    nothing = np.zeros((1, len(vi.mechanism.core.numbers)))
    out = vi.core.by_parameters(t, x, u, nothing, [], time_step=0, threads=vi.threads, first_share=first_share)
    return StepSensitivity(("dt",), out.x, out.lam)


def start_by(vi: Integrator, q: Array, names: Sequence[str], hold: Sequence[str] | None) -> Array:
    """Return derivatives (nd, len(names)) of a start at q that stays on the constraints, some variables held."""
    m = vi.mechanism
    free = free_variables(m, hold or ())
    # A step of a mechanism at rest ends where the constraints are, whatever they depend on.
    dt, none = 1e-2, np.zeros(m.n_inputs)
    p, _ = vi.core.momenta(q, q, none, dt, dt)
    still = np.tile(np.concatenate([q, p[: m.nd], np.zeros(m.nrho)]), (2, 1))
    inputs = np.concatenate([none, q[m.nd :]])[None, :]
    dq = steps_by(vi, np.array([0.0, dt]), still, inputs, names).x[0, : m.nd]
    C = m.constraint_jacobian(q)[:, : m.nd]
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


def _velocity_by(
    m: Mechanism, q: Array, v: Array, names: Sequence[str], dq: Array, hold: Sequence[str] | None
) -> Array:
    """Return derivatives (nd, len(names)) of a velocity that keeps the constraints as they change.

    ``Dh v = 0`` at the start, whose configuration changes by dq; the velocities of held variables stay.
    """
    dv = np.zeros_like(dq)
    if not names or not m.nc or not np.any(v):
        return dv
    C = m.constraint_jacobian(q)
    bends = np.stack([m.core.constraint_hessian(q, row) for row in np.eye(m.nc)])
    turned = np.einsum("cij,i->cj", bends, v)[:, : m.nd] @ dq
    turned += np.stack([_rates_by(m, q, v, name) for name in names], axis=1)
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


def _rates_by(m: Mechanism, q: Array, v: Array, name: str) -> Array:
    """Return the derivative (nc,) of ``Dh v`` by a parameter, q and v held.

    By differences of fourth order; constraints are polynomials in most of their numbers, so it is exact to rounding.
    """
    value = m.parameters[name]
    step = _STEP * (abs(value) or 1.0)

    def rates(by: float) -> Array:
        changed = m.with_parameters({name: value + by})
        return changed.constraint_jacobian(q) @ v

    near, far = rates(step) - rates(-step), rates(2.0 * step) - rates(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


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


def momentum_by(mechanism: Mechanism, q: ArrayLike, v: ArrayLike, names: Sequence[str]) -> Array:
    """Return the derivatives (nd, len(names)) of the momentum dL/dv by parameters, q and v held.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like, shape (nq,)
    names : sequence of str
        Parameters, among the names of `Mechanism.parameters`.
    """
    places = mechanism.parameter_places(names)
    q0 = as_array(q, "q", (mechanism.nq,), names=mechanism.variables)
    v0 = as_array(v, "v", (mechanism.nq,), names=mechanism.variables)
    out = np.zeros((mechanism.nd, len(places)))
    lengths = {name: place for name, place in places.items() if isinstance(place, Prescribed)}
    if lengths:
        nq = mechanism.nq
        freed = mechanism.with_free_lengths(_as_variables(mechanism, lengths))
        q, v = np.append(q0, _held(mechanism, lengths)), np.append(v0, np.zeros(len(lengths)))
        _, by_q, by_v = freed.core.hessian(q, v)
        factors, constant = _growth(mechanism, lengths)
        by = by_q[:nq, nq:] * (factors @ q0 + constant) + by_v[:nq, nq:] * (factors @ v0)
        by += factors.T * freed.momentum(q, v)[nq:]
    for column, (name, place) in enumerate(places.items()):
        if isinstance(place, BodyNumber):
            joint, slope = inertia_slope(mechanism.tree, place)
            if joint != WORLD:
                out[:, column] = mechanism.core.inertia_slope(q0, v0, joint, list(slope))[1][: mechanism.nd]
        elif isinstance(place, Prescribed):
            out[:, column] = by[: mechanism.nd, list(lengths).index(name)]
    return out


def _directions(m: Mechanism, places: dict[str, Place]) -> tuple[Array, list[tuple[int, int, list[float]]]]:
    """Return what the core takes: directions of the elements' numbers, and slopes of inertias."""
    directions = np.zeros((len(places), len(m.core.numbers)))
    inertias = []
    for row, (name, place) in enumerate(places.items()):
        if isinstance(place, ElementNumber):
            directions[row, place.slot] = 1.0
        elif isinstance(place, BodyNumber):
            _refuse_partial_gravity(m, name, place)
            joint, slope = inertia_slope(m.tree, place)
            if joint != WORLD:
                inertias.append((row, joint, slope.tolist()))
    return directions, inertias


def _refuse_partial_gravity(m: Mechanism, name: str, place: BodyNumber) -> None:
    if place.field.startswith("inertia"):
        return
    frame = m.tree.frames[place.frame].name
    for label, element in m.elements.items():
        if frame in element.weighed:
            raise ArgumentError(
                f"the parameter {name!r} also sets the weight that {label!r} gives to {frame!r} alone; "
                "derivatives by it are for gravity on all masses, or for none"
            )


def _as_variables(m: Mechanism, lengths: dict[str, Prescribed]) -> dict[str, Prescribed]:
    """Return the places of numbers by names that are no variables of the mechanism yet."""
    renamed = {}
    for name, place in lengths.items():
        while name in m.variables:
            name += "'"
        renamed[name] = place
    return renamed


def _by_lengths(
    vi: Integrator, t: Array, X: Array, U: Array, lengths: dict[str, Prescribed], first_share: float
) -> tuple[Array, Array]:
    """Derivatives of the steps by numbers that a prescribed variable w stands for.

    A length is a variable that stands still. What another number changes is a motion w(q) that is zero and grows with
    the number as c(q) = c_k q_k + c_0: beside what w moves at both ends, its own equation is added to those of the
    variables, c_k times.
    """
    m = vi.mechanism
    freed = vi.like(m.with_free_lengths(_as_variables(m, lengths)))
    count, steps = len(lengths), len(U)
    held = np.tile(_held(m, lengths), (steps + 1, 1))
    x = np.concatenate([X[:, : m.nq], held, X[:, m.nq :], np.zeros_like(held)], axis=1)
    u = np.concatenate([U, held[1:]], axis=1)
    d = linearize_arrays(freed, t, x, u, multipliers=True, first_share=first_share)
    factors, constant = _growth(m, lengths)
    grown = X[:, : m.nq] @ factors.T + constant
    at_start, at_end = (slice(m.nq, m.nq + count), slice(m.n_inputs + m.nrho, m.n_inputs + m.nrho + count))
    by = d.A_all[:, :, at_start] * grown[:-1, None] + d.B_all[:, :, at_end] * grown[1:, None]
    own = factors[:, : m.nd].T  # (nd, count)
    if own.any():
        momenta = slice(m.nq + count, m.nq + count + m.nd)
        at_first, at_second = _momenta_of(freed, t, x, u, d.lam, first_share)
        by += d.A_all[:, :, momenta] @ (own * at_first[:, None, at_start])
        by[:, momenta] += own * at_second[:, None, at_start]
    rows = [*range(m.nq), *range(m.nq + count, m.nq + count + m.nq)]
    out = by[:, rows]
    out[:, [*range(m.nd, m.nq), *range(m.nq + m.nd, m.nx)]] = 0.0
    return out, by[:, freed.mechanism.nx :]


def _held(m: Mechanism, lengths: dict[str, Prescribed]) -> Array:
    """Return the values (len(lengths),) of the variables that stand for numbers."""
    return np.array([m.parameters[name] if isinstance(place, Length) else 0.0 for name, place in lengths.items()])


def _growth(m: Mechanism, lengths: dict[str, Prescribed]) -> tuple[Array, Array]:
    """Return how the variables that stand for numbers grow with those: factors (len(lengths), nq), and constants."""
    column = {name: i for i, name in enumerate(m.variables)}
    factors, constant = np.zeros((len(lengths), m.nq)), np.ones(len(lengths))
    for row, place in enumerate(lengths.values()):
        if isinstance(place, JointNumber):
            growth = place.growth(m.tree)
            constant[row] = growth.offset
            for name, factor in growth.terms:
                factors[row, column[name]] = factor
    return factors, constant


def _momenta_of(vi: Integrator, t: Array, x: Array, u: Array, lam: Array, first_share: float) -> tuple[Array, Array]:
    """Return what the equations of all variables have beside the momentum at the start, and the momenta at the end.

    Both (N, nq), of prescribed variables too.
    """
    m = vi.mechanism
    start, end = np.empty((len(u), m.nq)), np.empty((len(u), m.nq))
    for k in range(len(u)):
        dt = t[k + 1] - t[k]
        share = dt * (first_share if k == 0 else 1.0)
        q = np.ascontiguousarray(x[k, : m.nq])
        p, end[k] = vi.core.momenta(q, np.ascontiguousarray(x[k + 1, : m.nq]), u[k, : m.n_inputs].copy(), dt, share)
        start[k] = -p - lam[k] @ m.constraint_jacobian(q)
    return start, end
