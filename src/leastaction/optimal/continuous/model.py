"""The linear-quadratic problem along a trajectory: linearisation and cost, sampled finely enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array, require_finite
from leastaction.numerics.piecewise import Mesh, approximate
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.riccati import ModelSamples
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory


@dataclass(frozen=True)
class TangentModel:
    """A linear-quadratic problem at the points of a mesh.

    ``Q_final``, ``q_final`` (nx, nx), (nx,): final weight and gradient.
    """

    mesh: Mesh
    samples: ModelSamples
    Q_final: Array
    q_final: Array


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


def with_identities(samples: ModelSamples) -> ModelSamples:
    """Return the problem with identities for weights."""
    n, nx, nu = samples.B.shape
    return samples._replace(
        Q=np.broadcast_to(np.eye(nx), (n, nx, nx)), R=np.broadcast_to(np.eye(nu), (n, nu, nu)), S=np.zeros((n, nx, nu))
    )


def with_curvature(samples: ModelSamples, H: Array) -> ModelSamples:
    """Return the problem with a Hessian (n, nx+nu, nx+nu) beside the weights: a part of the dynamics' curvature."""
    nx = samples.A.shape[1]
    return samples._replace(Q=samples.Q + H[:, :nx, :nx], R=samples.R + H[:, nx:, nx:], S=samples.S + H[:, :nx, nx:])


def _united(breaks: Array, jumps: ArrayLike) -> Array:
    """Return the ends of pieces with the jumps among them."""
    times = np.asarray(jumps, dtype=np.float64)
    span = breaks[-1] - breaks[0]
    inside = times[(times > breaks[0]) & (times < breaks[-1])]
    near = np.abs(inside[:, None] - breaks).min(axis=1, initial=np.inf) < 1e-12 * span
    return np.unique(np.concatenate([breaks, inside[~near]]))
