"""The linear-quadratic problem along a trajectory: linearisation and cost, sampled finely enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array, require_finite
from leastaction.numerics.piecewise import Mesh, approximate
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory


class ModelSamples(NamedTuple):
    """A linear-quadratic problem sampled at the points of a mesh; n is their number.

    ``A``, ``B`` (n, nx, nx), (n, nx, nu): dynamics. ``Q``, ``R``, ``S`` (n, nx, nx), (n, nu, nu), (n, nx, nu): weights.
    ``q``, ``r``, ``c`` (n, nx), (n, nu), (n, nx): gradients of the cost, and drift.
    """

    A: Array
    B: Array
    Q: Array
    R: Array
    S: Array
    q: Array
    r: Array
    c: Array

    @classmethod
    def unpack(cls, packed: Array, nx: int, nu: int) -> ModelSamples:
        """Return the samples from rows of A, B, Q, R, S, q, r, c, in this order."""
        shapes = [(nx, nx), (nx, nu), (nx, nx), (nu, nu), (nx, nu), (nx,), (nu,), (nx,)]
        parts, begin = [], 0
        for shape in shapes:
            end = begin + int(np.prod(shape))
            parts.append(packed[:, begin:end].reshape(len(packed), *shape))
            begin = end
        return cls(*parts)


@dataclass(frozen=True)
class TangentModel:
    """A linear-quadratic problem at the points of a mesh.

    ``Q_final``, ``q_final`` (nx, nx), (nx,): final weight and gradient.
    """

    mesh: Mesh
    samples: ModelSamples
    Q_final: Array
    q_final: Array

    def with_identities(self) -> TangentModel:
        """Return the problem with identities for weights."""
        n, nx, nu = self.samples.B.shape
        Q, R = (np.broadcast_to(np.eye(m), (n, m, m)) for m in (nx, nu))
        return replace(self, samples=self.samples._replace(Q=Q, R=R, S=np.zeros((n, nx, nu))), Q_final=np.eye(nx))

    def with_curvature(self, H: Array) -> TangentModel:
        """Return it with a Hessian (n, nx+nu, nx+nu) beside the weights: a part of the dynamics' curvature."""
        own, nx = self.samples, len(self.q_final)
        Q, R, S = own.Q + H[:, :nx, :nx], own.R + H[:, nx:, nx:], own.S + H[:, :nx, nx:]
        return replace(self, samples=own._replace(Q=Q, R=R, S=S))

    def driven_by(self, r: Array) -> TangentModel:
        """Return it with no other gradient than one by the inputs (n, nu)."""
        nothing = np.zeros_like(self.samples.q)
        return replace(self, samples=self.samples._replace(q=nothing, r=r), q_final=np.zeros_like(self.q_final))


def sample_model(
    system: ContinuousSystem, cost: ContinuousCost, curve: DenseTrajectory, jumps: Sequence[float], accuracy: Accuracy
) -> TangentModel:
    """Return linearisation and derivatives of the cost along a curve.

    ``system``, ``cost``: what is differentiated. ``curve``: where. ``jumps``: times (s) at which pieces of the mesh
    have to end. Raises `ArgumentError`: derivatives that are not finite.
    """
    nx, nu = system.nx, system.nu

    # The Hessian of the cost varies no faster than its gradient, which is a tenth of the size.
    def sample(t: Array) -> Array:
        x, u = curve.sample(t)
        parts = (*system.linearize(x, u, t), *cost.gradient(x, u, t))
        return np.hstack([part.reshape(len(t), -1) for part in parts])

    mesh, packed = approximate(sample, Mesh(_united(curve.t, jumps)), accuracy.sampling)
    require_finite(packed, "derivatives of the system and the cost")
    n = len(mesh.t)
    A, B, q, r = np.split(packed, np.cumsum([nx * nx, nx * nu, nx]), axis=1)
    Q, R, S = cost.hessian(*curve.sample(mesh.t), mesh.t)
    samples = ModelSamples(
        A=A.reshape(n, nx, nx),
        B=B.reshape(n, nx, nu),
        Q=Q,
        R=R,
        S=np.zeros((n, nx, nu)) if S is None else S,
        q=q,
        r=r,
        c=np.zeros((n, nx)),
    )
    x_final = curve.xu.flat(curve.tf)[:nx]
    return TangentModel(mesh, samples, cost.final_hessian(x_final, curve.tf), cost.final_gradient(x_final, curve.tf))


class SampledSystem(ContinuousSystem):
    """The linear system ``dx' = A dx + B du`` of samples along a trajectory."""

    def __init__(self, mesh: Mesh, samples: ModelSamples) -> None:
        n, self.nx, self.nu = samples.B.shape
        packed = np.concatenate([samples.A.reshape(n, -1), samples.B.reshape(n, -1)], axis=1)
        self._AB = mesh.fit(packed, packed.shape[1:]).flat

    def f(self, x: Array, u: Array, t: float) -> Array:
        A, B = self.derivatives(x, u, t)
        return np.asarray(A @ x + B @ u)

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:  # noqa: ARG002
        nx, nu = self.nx, self.nu
        AB = self._AB(t)
        return AB[: nx * nx].reshape(nx, nx), AB[nx * nx :].reshape(nx, nu)


def _united(breaks: Array, jumps: ArrayLike) -> Array:
    """Return the ends of pieces with the jumps among them."""
    times = np.asarray(jumps, dtype=np.float64)
    span = breaks[-1] - breaks[0]
    inside = times[(times > breaks[0]) & (times < breaks[-1])]
    near = np.abs(inside[:, None] - breaks).min(axis=1, initial=np.inf) < 1e-12 * span
    return np.unique(np.concatenate([breaks, inside[~near]]))
