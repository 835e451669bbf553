"""Curves to begin with: a wanted motion brought onto the constraints, and one that stays where that begins."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.mechanics.configuration.assembly import project_velocity
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.legendre import to_momentum
from leastaction.mechanics.discrete.prescribed import inputs_along
from leastaction.mechanics.discrete.trajectory import State
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import differences, middles, moved_by, rates_along
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants
from leastaction.systems.following.kinds import WantedKind, kind_of, quaternion_of, turns_of
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.warm_starts import configurations_onto_constraints, velocities_onto_constraints

_RIDGE = 1e-10  # of the least squares of inputs, in parts of their normal matrix
# Of the search for a pose whose frames are where they are wanted: steps, what is close (rad or m), what is there (m).
_STEPS, _CLOSE, _THERE, _NEARER, _DAMPING = 100, 1e-8, 1e-7, 1e-3, 1e-6


def through(t: Array, values: Array) -> Array:
    """Return values (N+1, ...), smooth curves through the known in the place of NaN where anything is known."""
    from scipy.interpolate import PchipInterpolator  # slow to import, and not needed by most

    if kind_of(values) in (WantedKind.TURN, WantedKind.ORIENTATION):
        return _through_rotations(t, values)
    columns = values.reshape(len(t), -1).copy()
    for column in columns.T:
        known = np.flatnonzero(~np.isnan(column))
        if len(known) == 1:
            column[:] = column[known[0]]
        elif 0 < len(known) < len(t):
            column[:] = PchipInterpolator(t[known], column[known])(np.clip(t, t[known[0]], t[known[-1]]))
    return columns.reshape(values.shape)


def _through_rotations(t: Array, values: Array) -> Array:
    """Return the same of matrices (N+1, 3, 3) or quaternions (N+1, 4)."""
    from scipy.spatial.transform import Rotation, RotationSpline

    known = np.flatnonzero(~np.isnan(values).reshape(len(t), -1).any(axis=1))
    if len(known) == len(t):
        return values
    q = values[known] if values.ndim == 2 else rotations.of_matrix(values[known])
    if len(known) == 1:
        q = np.tile(q, (len(t), 1))
    else:
        curve = RotationSpline(t[known], Rotation.from_quat(np.roll(q, -1, axis=1)))
        q = rotations.continued(np.roll(curve(np.clip(t, t[known[0]], t[known[-1]])).as_quat(), 1, axis=1))
    return q if values.ndim == 2 else rotations.matrix(q)


def wanted_curve(system: MidpointSystem, wanted: Mapping[str, Array], start: State | None) -> tuple[Array, Array]:
    """Return states and inputs of the wanted motion, brought onto the constraints, without inputs."""
    m, t = system.mechanism, system.t
    q = np.tile(m.configuration() if start is None else start.q, (len(t), 1))
    known = np.zeros(m.nv, dtype=np.bool_)
    places = {}
    for name, values in wanted.items():
        kind = kind_of(values)
        if kind is WantedKind.VALUE:
            known[m.variables.index(name)] = True
            q[:, m.coordinates.index(name)] = values
        elif kind is WantedKind.TURN:
            known[turns_of(m, name)] = True
            q[:, quaternion_of(m, name)] = values
        else:
            places[name] = values
    free = np.flatnonzero(~known[: m.nd])

    def reach(k: int, at: Array) -> None:
        _reach(m, at, free, {name: values[k] for name, values in places.items()})

    configurations_onto_constraints(m, t, q, known, start, reach if places else None)
    v = rates_along(m, q, t)
    if places:
        known[: m.nd] = True
    v[:, ~known] = 0.0
    velocities_onto_constraints(m, t, q, v, known)
    x = system.states_along(q, to_momentum(m, q, v))
    if start is None:
        at_rest = project_velocity(m.at_time(t[0]), q[0], np.zeros(m.nv)).v  # or as the constraints move
        start = system.integrator.start(q[0], at_rest, t=float(t[0]))
    x[0, : m.nx] = start.x
    return x, np.hstack([np.zeros((system.N, m.n_inputs)), inputs_along(m, q[:, m.first_rho :])])


def held_still(system: MidpointSystem, x: Array) -> tuple[Array, Array]:
    """Return the motion that stays where a curve begins, with the inputs that hold it there as nearly as they can."""
    m, still = system.mechanism, np.zeros_like(x)
    still[:, : m.nq] = x[0, : m.nq]
    still[0] = x[0]
    u = np.hstack([np.zeros((system.N, m.n_inputs)), inputs_along(m, still[:, m.first_rho : m.nq])])
    return still, with_inputs(system, still, u) if m.n_inputs else u


def with_inputs(system: MidpointSystem, x: Array, u: Array) -> Array:
    """Return inputs with those that make a motion as nearly as inputs can, by inverse dynamics between the instants."""
    m, dt = system.mechanism, np.diff(system.t)[:, None]
    q = x[:, : m.nq]
    v = rates_along(m, q, system.t)
    middle, speed, change = middles(m, q), differences(m, q[1:], q[:-1]) / dt, np.diff(v, axis=0) / dt
    dynamics = ContinuousDynamics(m)

    def missing(inputs: Array, multipliers: Array) -> Array:
        shape = (system.N, 1)
        given = np.tile(multipliers, shape), np.tile(inputs, shape)
        return dynamics.inverse_dynamics(middle, speed, change, given[0], u=given[1])[:, : m.nd]

    still, none = np.zeros(m.n_inputs), np.zeros(m.nc)
    needed = missing(still, none)
    each = [needed - missing(one, none) for one in np.eye(m.n_inputs)]
    each += [needed - missing(still, one) for one in np.eye(m.nc)]
    effect = np.stack(each, axis=2)
    square = np.swapaxes(effect, 1, 2) @ effect
    size = np.trace(square, axis1=1, axis2=2)[:, None, None]
    square += (_RIDGE * size + np.finfo(np.float64).tiny) * np.eye(square.shape[-1])
    found = np.linalg.solve(square, np.swapaxes(effect, 1, 2) @ needed[:, :, None])[:, :, 0]
    result = u.copy()
    result[:, : m.n_inputs] = found[:, : m.n_inputs]
    return result


def _reach(m: Mechanism, q: Array, free: Instants, wanted: Mapping[str, Array]) -> None:
    """Move variables of a configuration, in place, until frames are as near to their places and turned as they come.

    A coordinate of a place may be NaN: it is as good anywhere. ``wanted``: places (3,) and rotations (3, 3).
    """
    goal = np.concatenate([values if values.ndim == 1 else np.zeros(3) for values in wanted.values()])
    matters = ~np.isnan(goal)

    def away(q: Array) -> Array:
        off = [
            m.positions(q, [name])[0] - values if values.ndim == 1 else _turned_off(m, q, name, values)
            for name, values in wanted.items()
        ]
        return np.asarray(np.concatenate(off)[matters])

    def moving(q: Array, name: str, values: Array) -> Array:
        J = m.frame_jacobian(q, name, axes="world" if values.ndim == 1 else "frame")[:, free]
        if values.ndim == 1:
            return np.asarray(J[:3])
        return np.asarray(rotations.logarithm_derivative(_turned_off(m, q, name, values)) @ J[3:])

    damping, off = _DAMPING, away(q)
    for _ in range(_STEPS):
        J = np.vstack([moving(q, name, values) for name, values in wanted.items()])[matters]
        step = np.linalg.solve(J.T @ J + damping * np.eye(len(free)), -J.T @ off)
        if np.abs(step).max() < _CLOSE:
            return
        move = np.zeros(m.nv)
        move[free] = step
        trial = moved_by(m, q, move)
        found = away(trial)
        before, after = off @ off, found @ found
        if after <= before:
            q[:], off, damping = trial, found, max(_DAMPING, 0.1 * damping)
            # What is out of reach comes hardly nearer any more; what just is in reach is so very slowly.
            if after > (1.0 - _NEARER) * before or after <= _THERE**2:
                return
        else:
            damping *= 10.0


def _turned_off(m: Mechanism, q: Array, name: str, wanted: Array) -> Array:
    """Return the rotation (3,) that is missing of a frame, in its own axes."""
    return rotations.logarithm(rotations.of_matrix(wanted.T @ m.frame_pose(q, name)[:3, :3]))
