"""Rotations as unit quaternions ``[w, x, y, z]``, and their vectors: exponential, logarithm, and what these derive to.

``exp(phi)`` turns by ``|phi|`` about phi. A rotation q is moved in its own axes, ``q exp(phi)``, and two of them differ
by ``log(qbar^-1 q)``: the shorter way round, less than half a turn. All functions take any number of rows at once.

With ``phi = log q`` and the right Jacobian of the exponential, whose inverse is ``J = 1 + [phi]/2 + c [phi]^2``
(G. Chirikjian, Stochastic Models, Information Theory, and Lie Groups 2, 2012, 10.86), ``c = (1 - g) / |phi|^2``,
``g = |phi|/2 cot(|phi|/2)``: ``log(q exp(d)) = phi + J d + O(d^2)``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from leastaction.numerics.arrays import Array

_SMALL = 0.05  # rad, below which series are more exact than closed forms


def product(p: Array, q: Array) -> Array:
    """Return the products (..., 4) of quaternions: first q, then p."""
    w, x, y, z = np.moveaxis(np.asarray(p), -1, 0)
    W, X, Y, Z = np.moveaxis(np.asarray(q), -1, 0)
    parts = (
        w * W - x * X - y * Y - z * Z,
        w * X + x * W + y * Z - z * Y,
        w * Y - x * Z + y * W + z * X,
        w * Z + x * Y - y * X + z * W,
    )
    return np.stack(parts, axis=-1)


def inverse(q: Array) -> Array:
    """Return the inverse (..., 4) of unit quaternions."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def continued(q: Array) -> Array:
    """Return quaternions (n, 4) of rotations, each the nearer of both to the one before."""
    flips = np.where(np.sum(q[1:] * q[:-1], axis=-1) < 0.0, -1.0, 1.0)
    return np.asarray(q * np.cumprod(np.concatenate([[1.0], flips]))[:, None])


def body_rates(q: Array, rate: Array) -> Array:
    """Return the angular velocities (..., 3) in the axes of the body of quaternions of any length that change."""
    return np.asarray(2.0 * product(inverse(q), rate)[..., 1:] / np.sum(q * q, axis=-1, keepdims=True))


def body_accelerations(q: Array, rate: Array, bent: Array) -> Array:
    """Return how `body_rates` change (..., 3), given first and second derivatives of the quaternions by time."""
    growth = np.sum(q * rate, axis=-1, keepdims=True) / np.sum(q * q, axis=-1, keepdims=True)
    return np.asarray(body_rates(q, bent) - 2.0 * growth * body_rates(q, rate))


def exponential(phi: Array) -> Array:
    """Return the rotations (..., 4) by vectors (..., 3) in rad."""
    half = 0.5 * np.sqrt(np.sum(phi * phi, axis=-1, keepdims=True))
    return np.concatenate([np.cos(half), 0.5 * phi * np.sinc(half / np.pi)], axis=-1)


def logarithm(q: Array) -> Array:
    """Return the vectors (..., 3) of rotations, at most half a turn long (rad)."""
    w, v = q[..., :1], q[..., 1:]
    sine = np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    # The quaternion and its negative are the same rotation.
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    tiny = np.finfo(np.float64).tiny
    factor = np.where(sine > 1e-150, angle / np.maximum(sine, tiny), 2.0 / np.maximum(np.abs(w), tiny))
    return np.asarray(np.where(w < 0.0, -factor, factor) * v)


def crossing(phi: Array) -> Array:
    """Return the matrices (..., 3, 3) of cross products ``phi x``."""
    matrix = np.zeros((*phi.shape, 3))
    x, y, z = np.moveaxis(phi, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def logarithm_derivative(phi: Array) -> Array:
    """Return J (..., 3, 3) with ``log(exp(phi) exp(d)) = phi + J d + O(d^2)``, up to half a turn."""
    S = crossing(phi)
    c = _coefficients(phi)[0][..., None, None]
    return np.asarray(np.eye(3) + 0.5 * S + c * (S @ S))


def logarithm_curvature(phi: Array, w: Array) -> Array:
    """Return the second derivatives (..., 3, 3) of ``w . log(exp(phi) exp(d))`` by d at zero, up to half a turn."""
    J, eye = logarithm_derivative(phi), np.eye(3)
    bent = np.empty((*phi.shape, 3))
    for j, (odd, even) in enumerate(_changes(phi, J)):
        # The exponential's own Jacobian at d is 1 - [d]/2.
        bent[..., j] = np.einsum("...a,...ai->...i", w, odd + even - 0.5 * J @ crossing(eye[j]))
    return np.asarray(0.5 * (bent + np.swapaxes(bent, -1, -2)))


def logarithm_mixed(phi: Array, w: Array) -> Array:
    """Return the derivatives (..., 3, 3) of ``w . log(exp(-c) exp(phi) exp(d))`` by c, then d, at zero."""
    mixed = np.empty((*phi.shape, 3))
    for j, (odd, even) in enumerate(_changes(phi, logarithm_derivative(phi))):
        # By c it is -J at -phi.
        mixed[..., j] = np.einsum("...a,...ai->...i", w, odd - even)
    return mixed


def _changes(phi: Array, J: Array) -> Iterator[tuple[Array, Array]]:
    """Yield how J changes along each axis of d, as phi does by J d: what is odd in phi of J, and what is even."""
    S = crossing(phi)
    c, slope = (each[..., None] for each in _coefficients(phi))
    for j in range(3):
        along = J[..., j]
        T = crossing(along)
        turn = np.sum(phi * along, axis=-1)[..., None, None]
        yield 0.5 * T, slope[..., None] * turn * (S @ S) + c[..., None] * (T @ S + S @ T)


def _coefficients(phi: Array) -> tuple[Array, Array]:
    """Return c and ``c' / |phi|``, (...), of vectors (..., 3)."""
    square = np.sum(phi * phi, axis=-1)
    near = square < _SMALL**2
    s = np.where(near, 1.0, square)
    half = 0.5 * np.sqrt(s)
    cot = np.cos(half) / np.sin(half)
    c = (1.0 - half * cot) / s
    # g' = (cot h - h / sin^2 h) / 2 with h = |phi| / 2.
    slope = -0.5 * (cot - half / np.sin(half) ** 2) / (s * 2.0 * half) - 2.0 * c / s
    series = 1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1209600.0))
    slope_series = 1.0 / 360.0 + square * (1.0 / 7560.0 + square * (1.0 / 201600.0 + square / 5987520.0))
    return np.where(near, series, c), np.where(near, slope_series, slope)


def matrix(q: Array) -> Array:
    """Return the matrices (..., 3, 3) of unit quaternions."""
    S = crossing(q[..., 1:])
    return np.asarray(np.eye(3) + 2.0 * q[..., :1, None] * S + 2.0 * (S @ S))


def of_matrix(R: Array) -> Array:
    """Return the unit quaternions (..., 4) of rotation matrices (..., 3, 3)."""
    xx, yy, zz = np.moveaxis(np.diagonal(R, axis1=-2, axis2=-1), -1, 0)
    # Four times the squares of w, x, y, z; divided by the root of the largest of them, nothing cancels.
    squares = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    a, b, c = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    d, e, f = R[..., 0, 1] + R[..., 1, 0], R[..., 0, 2] + R[..., 2, 0], R[..., 1, 2] + R[..., 2, 1]
    w, x, y, z = np.moveaxis(squares, -1, 0)
    rows = np.stack(
        [np.stack(row, axis=-1) for row in ((w, a, b, c), (a, x, d, e), (b, d, y, f), (c, e, f, z))], axis=-2
    )
    best = np.argmax(squares, axis=-1)[..., None, None]
    chosen = np.take_along_axis(rows, best, axis=-2)[..., 0, :]
    return np.asarray(chosen / np.linalg.norm(chosen, axis=-1, keepdims=True))
