"""The adjoint of a closed loop in continuous time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial
from leastaction.optimal.continuous.integrate import Accuracy, integrate
from leastaction.optimal.continuous.riccati import Samples, largest

__all__ = ["continuous_adjoint"]


def continuous_adjoint(
    mesh: Mesh, samples: Samples, K: Array, q_final: Array, *, accuracy: Accuracy, jumps: Sequence[float]
) -> PiecewisePolynomial:
    """Return the adjoint z(t) (nx,) of the loop closed with K (dissertation Prop. 5).

    ``-z' = (A - BK)'z + q - K'r``, ``z(tf) = q_final``: the derivative of the cost to go by the state
    while the feedback holds on.

    ``mesh``, ``samples``: linearisation and gradients along the trajectory. ``K`` (n, nu, nx): gains at the points of
    the mesh. ``q_final`` (nx,): gradient of the final cost. ``jumps``: times where the samples jump. Raises
    `ArgumentError`: an equation that cannot be integrated.
    """
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
