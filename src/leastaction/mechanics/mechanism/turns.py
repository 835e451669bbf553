"""Differences of configurations and states: of rotations that are quaternions the rotation vectors between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from leastaction import _core
from leastaction.mechanics.description.tree import BallRotation
from leastaction.mechanics.mechanism.arguments import Compiled
from leastaction.numerics.arrays import Array
from leastaction.numerics.rotations import logarithm_derivative

Flags = NDArray[np.bool_]


def differences(m: Compiled, q: Array, qbar: Array) -> Array:
    """Return configurations q (N, nq) less others, (N, nv)."""
    if not m.tree.rotations:
        return q - qbar
    still = np.zeros((len(q), m.nv))
    x, xbar = np.hstack([q, still]), np.hstack([qbar, still])
    return np.asarray(_core.difference(m.core, x, xbar))[:, : m.nv]


def difference(m: Compiled, q: Array, qbar: Array) -> Array:
    """Return a configuration q (nq,) less another, (nv,)."""
    return np.asarray(differences(m, q[None], qbar[None])[0])


def moved(m: Compiled, q: Array, dq: Array) -> Array:
    """Return configurations that are dq (N, nv) from others (N, nq), (N, nq): what `differences` undoes."""
    if not m.tree.rotations:
        return q + dq
    still = np.zeros((len(q), m.nv))
    return np.asarray(_core.plus(m.core, np.hstack([q, still]), np.hstack([dq, still])))[:, : m.nq]


def moved_by(m: Compiled, q: Array, dq: Array) -> Array:
    """Return the configuration that is dq (nv,) from another (nq,)."""
    return np.asarray(moved(m, q[None], dq[None])[0])


def moved_state(m: Compiled, x: Array, dx: Array) -> Array:
    """Return the state (nx,) that is dx (ndx,) from another, of momenta or of velocities."""
    if not m.tree.rotations:
        return x + dx
    return np.asarray(_core.plus(m.core, x[None], dx[None])[0])


def middles(m: Compiled, q: Array) -> Array:
    """Return the configurations (N, nq) in the middle of steps between q (N+1, nq)."""
    if not m.tree.rotations:
        return 0.5 * (q[1:] + q[:-1])
    return moved(m, q[:-1], 0.5 * differences(m, q[1:], q[:-1]))


def rates_along(m: Compiled, q: Array, t: Array) -> Array:
    """Return the velocities (N+1, nv) of a motion q (N+1, nq) at its instants t (N+1,), of second order within."""
    if not m.tree.rotations:
        return np.asarray(np.gradient(q, t, axis=0))
    dt = np.diff(t)[:, None]
    steps = differences(m, q[1:], q[:-1]) / dt
    inner = (dt[1:] * steps[:-1] + dt[:-1] * steps[1:]) / (dt[1:] + dt[:-1])
    return np.concatenate([steps[:1], inner, steps[-1:]])


def interpolated(m: Compiled, q: Array, t: Array, times: Array) -> Array:
    """Return configurations q (n, nq) of times t (n,) at others (N,): on the shortest ways, the ends held outside."""
    if not m.tree.rotations:
        return np.stack([np.interp(times, t, column) for column in q.T], axis=1)
    at = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    share = np.clip((times - t[at]) / (t[at + 1] - t[at]), 0.0, 1.0)[:, None]
    return moved(m, q[at], share * differences(m, q[at + 1], q[at]))


def turned(m: Compiled, dq: Array) -> Array:
    """Return the derivative (nv, nv) of where `moved_by` leads by dq (nv,), as a move of the place that it led to."""
    found = np.eye(m.nv)
    for rotation in m.tree.rotations:
        at = slice(first := m.variables.index(rotation.variables[0]), first + 3)
        found[at, at] = np.linalg.inv(logarithm_derivative(dq[at]))
    return found


def momentum_derivatives(m: Compiled, q: Array, v: Array) -> tuple[Array, Array]:
    """Return the derivatives (nd, nv) of the momentum dL/dv of dynamic variables by the configuration and by v (nv,).

    The core's coordinates of a ball are angles (cpp/continuous/turned.hpp): rates and momenta turn with them.
    """
    _, by_q, by_v = m.core.hessian(q, v)
    p, out = by_v @ v, by_q[: m.nd].copy()
    for here in _turns(m):
        out[:, here] -= by_v[: m.nd, here] @ turned_rates(v[here])
        if here.start < m.nd:
            a, b, c = p[here]
            out[here, here] -= np.array([[0.0, c, -b], [0.0, 0.0, a], [0.0, 0.0, 0.0]])  # p . C(d, n) by n and d
    return out, by_v[: m.nd]


def rates_turned(m: Compiled, by: Array, v: Array) -> Array:
    """Return what turns (.., nv) change a rate by that is ``by`` (.., nv) times the velocity v (nv,), less the core's.

    That has the second derivatives by angles of balls, whose rates are others than the velocity away from zero.
    """
    out = np.zeros_like(by)
    for here in _turns(m):
        out[..., here] = -by[..., here] @ turned_rates(v[here])
    return out


def turned_rates(w: Array) -> Array:
    """Return the matrix (3, 3) of turns d in ``C(d, w)`` = (d3 w2, -d3 w1, d2 w1); see cpp/continuous/turned.hpp."""
    return np.array([[0.0, 0.0, w[1]], [0.0, 0.0, -w[0]], [0.0, w[0], 0.0]])


def _turns(m: Compiled) -> list[slice]:
    """Return where the turns of rotations that are quaternions are among the variables."""
    firsts = [m.variables.index(rotation.variables[0]) for rotation in m.tree.rotations]
    return [slice(first, first + 3) for first in firsts]


def plain_values(m: Compiled, q: Array) -> Array:
    """Return the values (..., nv) of variables at configurations (..., nq); zero of turns, which have none."""
    if not m.tree.rotations:
        return q
    values = np.zeros((*q.shape[:-1], m.nv))
    at = {name: i for i, name in enumerate(m.coordinates)}
    plain = [(i, at[name]) for i, name in enumerate(m.variables) if name in at]
    to, of = np.array(plain, dtype=np.intp).reshape(-1, 2).T
    values[..., to] = q[..., of]
    return values


def of_coordinates(m: Compiled, of_variables: Flags) -> Flags:
    """Return for coordinates (nq,) what is said of variables (nv,); of a quaternion what is said of all its turns."""
    said = dict(zip(m.variables, of_variables, strict=True))
    for rotation in m.tree.rotations:
        said.update(dict.fromkeys(rotation.quaternion, all(said[name] for name in rotation.variables)))
    return np.array([said[name] for name in m.coordinates], dtype=np.bool_)


def prescribed_rotations(m: Compiled) -> list[tuple[BallRotation, int, int]]:
    """Return prescribed rotations, where their quaternions begin behind first_rho, and their turns behind nd."""
    if m.nq - m.first_rho == m.nrho:
        return []
    return [
        (each, m.coordinates.index(each.quaternion[0]) - m.first_rho, m.kinematic.index(each.variables[0]))
        for each in m.tree.rotations
        if each.variables[0] in m.kinematic
    ]


def turns_for_quaternions(m: Compiled, places: Array) -> Array:
    """Return prescribed coordinates (..., nq - first_rho) with zero turns for quaternions, (..., nrho)."""
    out = np.array(places)
    for _, place, _ in sorted(prescribed_rotations(m), key=lambda each: -each[1]):  # the last first
        out = np.concatenate([out[..., :place], np.zeros((*out.shape[:-1], 3)), out[..., place + 4 :]], axis=-1)
    return out
