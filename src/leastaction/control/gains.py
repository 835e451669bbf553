"""Gains that do not change: of a regulator, and of an observer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.optimal.continuous.linear_quadratic import steady_state_regulator
from leastaction.optimal.cost import matrix_of


class SteadyGain(NamedTuple):
    """A gain over an endless horizon, and the solution of the Riccati equation that it is by.

    ``gain``: K (nu, nx) with ``u = -K x``, or L (nx, ny) by which an observer is corrected. ``P`` (nx, nx): the cost,
    or the covariance. ``poles`` (nx,): of the closed loop, or of the observer's error; in discrete time within the unit
    circle, in continuous time left of the imaginary axis.
    """

    gain: Array
    P: Array
    poles: np.ndarray[tuple[int], np.dtype[np.complex128]]


def lqr(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, *, dt: float | None = None, S: ArrayLike | None = None
) -> SteadyGain:
    """Return the linear-quadratic regulator ``u = -K x`` over an endless horizon.

    Parameters
    ----------
    A, B : array_like (nx, nx), (nx, nu)
        ``dx/dt = A x + B u`` in continuous time, ``x+ = A x + B u`` of steps where `dt` is given.
    Q, R : array_like (n,) or (n, n)
        Weights of state and input, of the integral or of the sum over steps.
    dt : float, optional
        Length of the steps that A and B are of (s); they are of continuous time if left out.
    S : array_like (nx, nu), optional
        Cross weight.

    Returns
    -------
    SteadyGain
        ``gain`` is K (nu, nx).

    Raises
    ------
    ArgumentError
        Wrong shapes, values that are not finite, or a system that cannot be stabilised, or whose instability the
        weights do not see.
    """
    K, P = steady_state_regulator(A, B, Q=Q, R=R, S=S, dt=dt)
    return SteadyGain(K, P, np.linalg.eigvals(np.asarray(A) - np.asarray(B) @ K).astype(np.complex128))


def lqe(A: ArrayLike, C: ArrayLike, W: ArrayLike, V: ArrayLike, *, dt: float | None = None) -> SteadyGain:
    """Return the steady observer (Kalman's) of a linear system under noise.

    In continuous time ``dx^/dt = A x^ + L (y - C x^)``; of steps ``x^+ = A x^ + L (y - C x^)``, which predicts the next
    state by the reading of this one.

    Parameters
    ----------
    A, C : array_like (nx, nx), (ny, nx)
        Dynamics as of `lqr`, and readings ``y = C x``.
    W, V : array_like (n,) or (n, n)
        Covariances of what disturbs the state, and of the readings: of white noise by unit of time, or of each step.
    dt : float, optional
        Length of the steps that A is of (s); continuous time if left out.

    Returns
    -------
    SteadyGain
        ``gain`` is L (nx, ny); P is the covariance of the prediction's error.

    Raises
    ------
    ArgumentError
        Wrong shapes, values that are not finite, or a system whose instability the readings do not show.
    """
    A = as_array(A, "A", (None, None), meaning="(nx, nx)")
    nx = len(A)
    C = as_array(C, "C", (None, nx), meaning="(ny, nx)")
    W = matrix_of(as_array(W, "W", (nx,), (nx, nx)))
    V = matrix_of(as_array(V, "V", (len(C),), (len(C), len(C))))
    try:
        K, P = steady_state_regulator(A.T, C.T, Q=W, R=V, dt=dt)
    except ArgumentError as error:
        raise ArgumentError(f"lqe, by its dual regulator: {error}") from None
    return SteadyGain(np.ascontiguousarray(K.T), P, np.linalg.eigvals(A - K.T @ C).astype(np.complex128))
