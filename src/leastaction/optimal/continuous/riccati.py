"""The Riccati equation of a linear-quadratic problem that is given by its samples.

Elimination of the input leaves, with ``Ab = A - B R^-1 S'``, ``Qb = Q - S R^-1 S'``, ``W = B R^-1 B'``,
``qb = q - S R^-1 r`` and ``cb = c - B R^-1 r``::

    -P' = Qb + X + X',  X = P (Ab - W P / 2)          -b' = qb + Ab'b + P (cb - W b)

which is integrated backwards, P by its upper triangle alone. If the problem has no minimum, P leaves all
bounds at some time before tf, the finite escape time (the conjugate point of the calculus of variations).
Beside it stands the adjoint of a closed loop, which is integrated backwards along the same samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial, approximate
from leastaction.numerics.public import public
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.integrate import integrate
from leastaction.optimal.continuous.model import ModelSamples, TangentModel


@public
@dataclass(frozen=True)
class ContinuousLinearQuadraticSolution:
    """Solution of a linear-quadratic problem, or the time at which there is none.

    Attributes
    ----------
    feedback : PiecewisePolynomial
        Gains and feedforward in one vector, ``[K (row by row); C]``. Constant NaN without a minimum.
    value : PiecewisePolynomial
        Upper triangle of P (row by row) and b in one vector.
    nx, nu : int
        Numbers of states and inputs.
    constant : float
        Optimal cost for ``dx(t0) = 0``. For ``c = 0`` twice this is the derivative of the cost along the solution.
    definite : bool
        Whether the problem has a unique minimum. If not, do not use the rest.
    escape_time : float or None
        The time (s) at which P escapes, or R is not positive definite; None if there is a minimum.
    steps : int
        Steps of the integrator.
    message : str
        All this in one sentence.
    """

    feedback: PiecewisePolynomial
    value: PiecewisePolynomial
    nx: int
    nu: int
    constant: float
    definite: bool
    escape_time: float | None
    steps: int
    message: str

    @cached_property
    def K(self) -> PiecewisePolynomial:
        """Gains (nu, nx) as a function of time."""
        return self.feedback.part(np.arange(self.nu * self.nx), (self.nu, self.nx))

    @cached_property
    def C(self) -> PiecewisePolynomial:
        """Feedforward (nu,) as a function of time, ``du = -K dx - C``."""
        return self.feedback.part(self.nu * self.nx + np.arange(self.nu), (self.nu,))

    @cached_property
    def P(self) -> PiecewisePolynomial:
        """Quadratic term (nx, nx) of the optimal cost to go, symmetric to the last bit."""
        return self.value.part(_full(self.nx), (self.nx, self.nx))

    @cached_property
    def b(self) -> PiecewisePolynomial:
        """Linear term (nx,) of the optimal cost to go; for ``c = 0`` the adjoint of the closed loop."""
        triangle = self.nx * (self.nx + 1) // 2
        return self.value.part(triangle + np.arange(self.nx), (self.nx,))


def solve_samples(
    model: TangentModel, *, accuracy: Accuracy, jumps: Sequence[float], escape: float = 1e8
) -> ContinuousLinearQuadraticSolution:
    """Solve a linear-quadratic problem that is given by its samples on a mesh, which is fine enough for them.

    ``jumps``: times where the samples jump; ends of pieces. ``escape``: P is taken to escape when an entry of its
    diagonal is below minus this times the size of the weights.
    """
    mesh, samples, Q_final, q_final = model.mesh, model.samples, model.Q_final, model.q_final
    nx, nu = samples.B.shape[1:]
    t0, tf = float(mesh.breaks[0]), float(mesh.breaks[-1])
    smallest = np.linalg.eigvalsh(samples.R)[:, 0]
    if not smallest.min() > 0.0:
        # The last time at which it fails: the recursion runs backwards.
        i = int(np.flatnonzero(~(smallest > 0.0))[-1])
        why = f"R is not positive definite at t = {mesh.t[i]:.6g} s (smallest eigenvalue {smallest[i]:.3g})"
        return _without_minimum(nx, nu, mesh, float(mesh.t[i]), 0, why)
    law = _Law(mesh, samples)
    size_P = max(largest(Q_final), largest(samples.Q) * min(tf - t0, 1.0)) or 1.0
    size_b = max(largest(q_final), largest(samples.q) * min(tf - t0, 1.0)) or 1.0
    upper = np.flatnonzero(np.triu(np.ones((nx, nx))).ravel())
    atol = np.full(upper.size + nx, 0.01 * accuracy.rtol * size_P)
    atol[upper.size :] = 0.01 * accuracy.rtol * size_b
    diagonal = np.flatnonzero(upper % (nx + 1) == 0)
    lowest = -escape * size_P

    def check(t: float, y: Array) -> str | None:  # noqa: ARG001
        return "P escapes" if y[diagonal].min() < lowest else None

    last = np.concatenate([Q_final.ravel()[upper], q_final])
    equation = _Riccati(law.equation(), nx)
    done = integrate(equation, tf, t0, last, accuracy=accuracy, atol=atol, jumps=jumps, check=check)
    if done.failure is not None:
        why = f"the Riccati equation has no solution before t = {done.t:.6g} s ({done.failure})"
        return _without_minimum(nx, nu, mesh, done.t, done.steps, why)
    value = done.curve((upper.size + nx,))
    feedback, constant = law.feedback(value, done.mesh, accuracy.sampling)
    return ContinuousLinearQuadraticSolution(
        feedback=feedback,
        value=value,
        nx=nx,
        nu=nu,
        constant=constant,
        definite=True,
        escape_time=None,
        steps=done.steps,
        message="The problem has a unique minimum.",
    )


class _Law:
    """The input that minimises, by P and b: ``K = E + G P`` and ``C = g + G b``, at the points of a mesh.

    With ``E = R^-1 S'``, ``G = R^-1 B'`` and ``g = R^-1 r``.
    """

    def __init__(self, mesh: Mesh, samples: ModelSamples) -> None:
        self.mesh, self.samples = mesh, samples
        nx = samples.B.shape[1]
        transposed = (np.swapaxes(each, 1, 2) for each in (samples.B, samples.S))
        solved = np.linalg.solve(samples.R, np.concatenate([*transposed, samples.r[..., None]], axis=2))
        self.G, self.E, self.g = solved[..., :nx], solved[..., nx : 2 * nx], solved[..., -1]

    def equation(self) -> PiecewisePolynomial:
        """Return what `_Riccati` takes: Ab, Qb/2, W/2, qb and cb in one vector."""
        A, B, Q, _, S, q, _, c = self.samples
        E, G, g = self.E, self.G, self.g
        matrices = (A - B @ E, 0.5 * (Q - S @ E), 0.5 * (B @ G))
        vectors = (q - np.einsum("nij,nj->ni", S, g), c - np.einsum("nij,nj->ni", B, g))
        return self._fitted(*matrices, *vectors)

    def feedback(self, value: PiecewisePolynomial, mesh: Mesh, sampling: float) -> tuple[PiecewisePolynomial, float]:
        """Return gains and feedforward as functions of time, and the optimal cost for a deviation of zero at t0."""
        nu, nx = self.E.shape[1:]
        triangle, full, gains = nx * (nx + 1) // 2, _full(nx), nu * nx
        law = self._fitted(self.E, self.G, self.g, self.samples.R, self.samples.c)

        def at(t: Array) -> Array:
            V, L = value(t), law(t)
            P, b = V[:, full].reshape(-1, nx, nx), V[:, triangle:]
            E, G = L[:, :gains], L[:, gains : 2 * gains].reshape(-1, nu, nx)
            K = E + (G @ P).reshape(len(t), -1)
            C = L[:, 2 * gains : 2 * gains + nu] + np.einsum("nij,nj->ni", G, b)
            return np.hstack([K, C])

        # C is a difference of larger terms near an optimum: its last digits are not worth resolving.
        least = np.zeros(gains + nu)
        least[gains:] = np.abs(self.g).max(axis=0)
        fine, found = approximate(at, mesh, sampling, least)
        tail = law(fine.t)[:, 2 * gains + nu :]
        weights, drift = tail[:, : nu * nu].reshape(-1, nu, nu), tail[:, nu * nu :]
        C = found[:, gains:]
        rate = -0.5 * np.einsum("ni,nij,nj->n", C, weights, C)
        rate += np.einsum("ni,ni->n", value(fine.t)[:, triangle:], drift)
        return fine.fit(found, (found.shape[1],)), float(fine.weights @ rate)

    def _fitted(self, *parts: Array) -> PiecewisePolynomial:
        """Return samples of matrices and vectors as one vector over time."""
        rows = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
        return self.mesh.fit(rows, (rows.shape[1],))


def continuous_adjoint(
    model: TangentModel, K: Array, *, accuracy: Accuracy, jumps: Sequence[float]
) -> PiecewisePolynomial:
    """Return the adjoint z(t) (nx,) of the loop closed with K (dissertation Prop. 5).

    ``-z' = (A - BK)'z + q - K'r``, ``z(tf) = q_final``: the derivative of the cost to go by the state
    while the feedback holds on.

    ``model``: linearisation and gradients along the trajectory. ``K`` (n, nu, nx): gains at the points of its mesh.
    ``jumps``: times where the samples jump. Raises `ArgumentError`: an equation that cannot be integrated.
    """
    mesh, samples, q_final = model.mesh, model.samples, model.q_final
    nx = q_final.size
    closed = samples.A - samples.B @ K
    source = samples.q - np.einsum("nji,nj->ni", K, samples.r)
    packed = np.concatenate([np.swapaxes(closed, 1, 2).reshape(len(K), -1), source], axis=1)
    data = mesh.fit(packed, (packed.shape[1],)).flat

    def fun(t: float, z: Array) -> Array:
        d = data(t)
        rate: Array = d[: nx * nx].reshape(nx, nx) @ z
        rate += d[nx * nx :]
        return np.negative(rate, out=rate)

    t0, tf = float(mesh.breaks[0]), float(mesh.breaks[-1])
    size = max(largest(q_final), largest(source) * min(tf - t0, 1.0)) or 1.0
    atol = np.full(nx, 0.01 * accuracy.rtol * size)
    done = integrate(fun, tf, t0, q_final, accuracy=accuracy, atol=atol, jumps=jumps)
    if done.failure is not None:
        raise ArgumentError(f"adjoint: {done.failure}. Look at the gains of the projection.")
    return done.curve((nx,))


class _Riccati:
    """The right-hand side of the Riccati equation for P (its upper triangle) and b."""

    def __init__(self, data: PiecewisePolynomial, nx: int) -> None:
        self._data = data.flat
        self._nx = nx
        self._triangle = nx * (nx + 1) // 2
        self._upper = np.flatnonzero(np.triu(np.ones((nx, nx))).ravel())
        self._full = _full(nx)

    def __call__(self, t: float, y: Array) -> Array:
        nx, triangle, square = self._nx, self._triangle, self._nx * self._nx
        d = self._data(t)
        A, half_Q = d[:square].reshape(nx, nx), d[square : 2 * square].reshape(nx, nx)
        half_W = d[2 * square : 3 * square].reshape(nx, nx)
        q, c = d[3 * square : 3 * square + nx], d[3 * square + nx :]
        P, b = y.take(self._full).reshape(nx, nx), y[triangle:]
        X = P @ (A - half_W @ P)
        X += half_Q
        rate = np.empty_like(y)
        rate[:triangle] = (X + X.T).take(self._upper)
        rate[triangle:] = q + b @ A + P @ (c - 2.0 * (half_W @ b))
        return np.negative(rate, out=rate)


def largest(array: Array) -> float:
    """Return the largest magnitude."""
    return float(np.abs(array).max(initial=0.0))


def _full(nx: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return where each entry of a symmetric matrix stands in its upper triangle."""
    rows, columns = np.triu_indices(nx)
    where = np.empty((nx, nx), dtype=np.intp)
    where[rows, columns] = where[columns, rows] = np.arange(rows.size)
    return where.ravel()


def _without_minimum(
    nx: int, nu: int, mesh: Mesh, time: float, steps: int, why: str
) -> ContinuousLinearQuadraticSolution:
    t0, tf = float(mesh.breaks[0]), float(mesh.breaks[-1])
    nothing = np.full(nu * nx + nu, np.nan)
    value = np.full(nx * (nx + 1) // 2 + nx, np.nan)
    return ContinuousLinearQuadraticSolution(
        feedback=PiecewisePolynomial(np.array([t0, tf]), nothing.reshape(1, 1, -1), nothing.shape),
        value=PiecewisePolynomial(np.array([t0, tf]), value.reshape(1, 1, -1), value.shape),
        nx=nx,
        nu=nu,
        constant=np.nan,
        definite=False,
        escape_time=time,
        steps=steps,
        message=f"{why}: this linear-quadratic problem has no minimum.",
    )
