"""Linear-quadratic problems in continuous time: the affine LQ problem, the LQR, the adjoint.

The problem::

    minimise   int  1/2 dx'Q dx + dx'S du + 1/2 du'R du + q'dx + r'du  dt
               + 1/2 dx(tf)' Q_final dx(tf) + q_final' dx(tf)
    subject to dx' = A dx + B du + c

The optimal input is ``du = -K dx - C`` and the optimal cost to go ``1/2 dx'P dx + b'dx + constant``, with
(dissertation B.1.2 and B.1.3; the cost carries the 1/2)::

    K = R^-1 (S' + B'P)      -P' = Q + A'P + PA - K'RK                P(tf) = Q_final
    C = R^-1 (r + B'b)       -b' = q + A'b + Pc - K'(r + B'b)         b(tf) = q_final
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_number
from leastaction.numerics.piecewise import PiecewisePolynomial, approximate
from leastaction.numerics.public import public
from leastaction.numerics.time_functions import TimeFunction, TimeFunctionLike
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.function_system import as_dynamics
from leastaction.optimal.continuous.horizon import as_horizon, first_mesh
from leastaction.optimal.continuous.model import ModelSamples, TangentModel
from leastaction.optimal.continuous.riccati import ContinuousLinearQuadraticSolution, solve_samples
from leastaction.optimal.cost import matrix_of

# Pieces that a horizon is divided into before anything is known of the functions sampled on it.
_FIRST_PIECES = 12


@public
def solve_continuous_linear_quadratic(
    A: TimeFunctionLike,
    B: TimeFunctionLike,
    *,
    horizon: tuple[float, float],
    Q: TimeFunctionLike | None = None,
    R: TimeFunctionLike,
    S: TimeFunctionLike | None = None,
    q: TimeFunctionLike | None = None,
    r: TimeFunctionLike | None = None,
    c: TimeFunctionLike | None = None,
    Q_final: ArrayLike | None = None,
    q_final: ArrayLike | None = None,
    jumps: Sequence[float] = (),
    accuracy: Accuracy | None = None,
) -> ContinuousLinearQuadraticSolution:
    """Solve the affine linear-quadratic problem stated at the top of this module.

    Parameters
    ----------
    A, B : of shape (nx, nx), (nx, nu)
        Dynamics. Like everything but the final terms: a constant array, a `PiecewisePolynomial`, or a
        function of one time.
    horizon : (t0, tf)
        Times (s), ``t0 < tf``.
    Q, R : of shape (n,) or (n, n)
        Symmetric weights of state and input, a diagonal or a matrix. Q is zero if left out.
    S : of shape (nx, nu), optional
        Cross weight.
    q, r, c : of shape (nx,), (nu,), (nx,), optional
        Gradients of the cost and drift of the dynamics.
    Q_final, q_final : array_like (nx,) or (nx, nx), and (nx,), optional
        Final weight and gradient.
    jumps : sequence of float, optional
        Times (s) where a function that was given jumps, or its slope. Those of a `PiecewisePolynomial` are known.
    accuracy : Accuracy, optional
        Of the integration. Its `atol` is not used: absolute tolerances are a hundredth of the relative
        one times the size of the weights.

    Returns
    -------
    ContinuousLinearQuadraticSolution
        Check `definite` before using it.

    Raises
    ------
    ArgumentError
        Wrong shapes, or a value that is not finite.
    """
    accuracy = accuracy or Accuracy()
    t0, tf = as_horizon(horizon)
    signals = {"A": TimeFunction(A, "A"), "B": TimeFunction(B, "B")}
    nx = _size(signals["A"], t0)
    signals["A"].check(t0, tf, (nx, nx), what="(nx, nx)")
    nu = _size(signals["B"], t0)
    signals["B"].check(t0, tf, (nx, nu), what="(nx, nu), to go with A")
    optional = {"Q": Q, "R": R, "S": S, "q": q, "r": r, "c": c}
    shapes = {"Q": (nx, nx), "R": (nu, nu), "S": (nx, nu), "q": (nx,), "r": (nu,), "c": (nx,)}
    for name, value in optional.items():
        shape = shapes[name]
        signal = signals[name] = TimeFunction(np.zeros(shape) if value is None else value, name)
        allowed = (shape, shape[:1]) if name in ("Q", "R") else (shape,)
        signal.check(t0, tf, *allowed, what=" or ".join(map(str, allowed)))
    final = np.zeros((nx, nx)) if Q_final is None else as_array(Q_final, "Q_final", (nx,), (nx, nx))
    gradient = np.zeros(nx) if q_final is None else as_array(q_final, "q_final", (nx,))
    every = sorted({*jumps, *(t for signal in signals.values() for t in signal.jumps)})

    def sample(t: Array) -> Array:
        parts = []
        for name in ModelSamples._fields:
            value = signals[name].samples(t)
            if name in ("Q", "R") and value.ndim == 2:
                value = value[..., None] * np.eye(value.shape[1])
            parts.append(value.reshape(len(t), -1))
        return np.hstack(parts)

    varying = not all(signal.is_constant for signal in signals.values())
    mesh = first_mesh(t0, tf, every, _FIRST_PIECES if varying else 1)
    mesh, packed = approximate(sample, mesh, accuracy.sampling)
    if not np.isfinite(packed).all():
        time = float(mesh.t[~np.isfinite(packed).all(axis=1)][0])
        raise ArgumentError(
            f"A, B, Q, R, S, q, r, c: got a value that is not finite at t = {time:.6g} s, expected "
            "finite numbers. Look at the functions that were given."
        )
    model = TangentModel(mesh, ModelSamples.unpack(packed, nx, nu), matrix_of(final), gradient)
    return solve_samples(model, accuracy=accuracy, jumps=every)


@public
def regulate_continuous(
    A: TimeFunctionLike,
    B: TimeFunctionLike,
    *,
    horizon: tuple[float, float],
    Q: TimeFunctionLike | None = None,
    R: TimeFunctionLike | None = None,
    Q_final: ArrayLike | None = None,
    jumps: Sequence[float] = (),
    accuracy: Accuracy | None = None,
) -> PiecewisePolynomial:
    """Return the gains K(t) (nu, nx) of the time-varying LQR, ``u = ubar - K (x - xbar)``.

    Parameters
    ----------
    A, B, horizon, jumps, accuracy
        As in `solve_continuous_linear_quadratic`.
    Q, R, Q_final : optional
        Weights; identities if left out.

    Raises
    ------
    ArgumentError
        Wrong shapes, values that are not finite, or weights for which there is no regulator.
    """
    t0 = as_horizon(horizon)[0]
    nx, nu = _size(TimeFunction(A, "A"), t0), _size(TimeFunction(B, "B"), t0)
    solution = solve_continuous_linear_quadratic(
        A,
        B,
        horizon=horizon,
        Q=np.ones(nx) if Q is None else Q,
        R=np.ones(nu) if R is None else R,
        Q_final=np.ones(nx) if Q_final is None else Q_final,
        jumps=jumps,
        accuracy=accuracy,
    )
    if not solution.definite:
        raise ArgumentError(
            f"Q, R: there is no regulator: {solution.message} Give a positive definite R and a positive semidefinite Q."
        )
    return solution.K


@public
def steady_state_regulator(
    A: ArrayLike,
    B: ArrayLike,
    *,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    S: ArrayLike | None = None,
    dt: float | None = None,
) -> tuple[Array, Array]:
    """Return the gains K (nu, nx) and the cost P (nx, nx) of the LQR over an endless horizon.

    Parameters
    ----------
    A, B : array_like (nx, nx), (nx, nu)
        Dynamics that do not change: ``dx/dt = A x + B u`` in continuous time, ``x+ = A x + B u`` of steps where ``dt``
        is given.
    Q, R : array_like (n,) or (n, n), optional
        Weights, of the integral or of the sum over steps; identities if left out.
    S : array_like (nx, nu), optional
        Cross weight.
    dt : float, optional
        Length of the steps that A and B are of (s); they are of continuous time if left out. Matrices of steps, such as
        those of `MidpointSystem.linearize`, need it: taken for continuous ones they give gains without any use.

    Raises
    ------
    ArgumentError
        Wrong shapes, values that are not finite, or a system that cannot be stabilised, or whose
        instability the weights do not see.
    """
    A, B = as_dynamics(A, B)
    nx, nu = B.shape
    Q = matrix_of(np.ones(nx) if Q is None else as_array(Q, "Q", (nx,), (nx, nx)))
    R = matrix_of(np.ones(nu) if R is None else as_array(R, "R", (nu,), (nu, nu)))
    S = np.zeros((nx, nu)) if S is None else as_array(S, "S", (nx, nu))
    from scipy.linalg import solve_continuous_are, solve_discrete_are

    try:
        if dt is None:
            P = solve_continuous_are(A, B, Q, R, s=S)
            K = np.linalg.solve(R, S.T + B.T @ P)
        else:
            as_number(dt, "dt (s)", above=0.0)
            P = solve_discrete_are(A, B, Q, R, s=S)
            K = np.linalg.solve(R + B.T @ P @ B, S.T + B.T @ P @ A)
    except (np.linalg.LinAlgError, ValueError) as error:
        if isinstance(error, ArgumentError):
            raise
        hint = "" if dt is not None else " A and B that are of steps need dt=."
        raise ArgumentError(
            f"A, B, Q, R: there is no steady-state regulator ({str(error).rstrip('.')}). Every unstable mode must be "
            f"within reach of the input and seen by Q, and R positive definite.{_out_of_reach(A, B, dt)}{hint}"
        ) from error
    return K, 0.5 * (P + P.T)


def _out_of_reach(A: Array, B: Array, dt: float | None) -> str:
    """Say which modes neither die away nor are within reach of the input, by Popov, Belevitch and Hautus."""
    said = []
    for value in np.linalg.eigvals(A):
        grows = value.real if dt is None else abs(value) - 1.0
        left, sizes, _ = np.linalg.svd(np.hstack([A - value * np.eye(len(A)), B]))
        if grows > -1e-7 and sizes[-1] < 1e-7 * sizes[0]:
            share = np.abs(left[:, -1])
            states = ", ".join(str(i) for i in np.flatnonzero(share > 0.1 * share.max()))
            said.append(f"{value:.4g} (of the states {states}, counted from 0)")
    return f" Out of reach: the eigenvalue {'; '.join(dict.fromkeys(said))}." if said else ""


def _size(signal: TimeFunction, t0: float) -> int:
    value = signal.at(t0)
    if value.ndim != 2 or 0 in value.shape:
        raise ArgumentError(f"{signal.name}: got shape {value.shape}, expected a matrix.")
    return int(value.shape[1])
