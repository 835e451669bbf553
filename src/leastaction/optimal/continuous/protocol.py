"""The continuous system ``x' = f(x, u, t)``: all that the optimiser knows of what it steers.

Symbols: ``x`` (nx,), ``u`` (nu,), ``A = df/dx`` (nx, nx), ``B = df/du`` (nx, nu), ``K`` (nu, nx) with
the feedback ``u = ubar - K (x - xbar)``; along a trajectory, with time first.

Steepest descent and quasi-Newton need `f` and `derivatives`, Newton's method `curvature` too. Three
methods at one time are enough to define a system; a system with a faster way for many times at once
overrides those over samples.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.protocol import Linearization

__all__ = ["ContinuousSystem"]


class ContinuousSystem(ABC):
    """A system in continuous time.

    Subclasses set `nx` and `nu` (before they are used) and implement `f`, `derivatives` and, for
    Newton's method, `curvature`. All must be pure: the same arguments give the same result.
    """

    nx: int
    """Number of states."""
    nu: int
    """Number of inputs."""

    has_curvature: bool = True
    """Whether `curvature` is available; without it Newton's method is not offered."""

    jumps: Sequence[float] = ()
    """Times (s) where f jumps with time, if it does: integrators start anew there."""

    @abstractmethod
    def f(self, x: Array, u: Array, t: float) -> Array:
        """Return the rate of the state (nx,). A state without one raises `StepError`."""

    @abstractmethod
    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:
        """Return ``A = df/dx`` (nx, nx) and ``B = df/du`` (nx, nu)."""

    def curvature(self, x: Array, u: Array, t: float, z: Array) -> Array:
        """Return ``z . D2f``, the symmetric (nx+nu, nx+nu) Hessian of ``z'f`` over ``(x, u)``."""
        raise NotImplementedError(
            f"{type(self).__name__} has no second derivative: implement `curvature`, or set "
            "`has_curvature = False` and use a method other than 'newton'."
        )

    def linearize(self, x: Array, u: Array, t: Array) -> Linearization:
        """Return A (n, nx, nx) and B (n, nx, nu) at samples ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""
        A, B = np.empty((len(t), self.nx, self.nx)), np.empty((len(t), self.nx, self.nu))
        for i in range(len(t)):
            A[i], B[i] = self.derivatives(x[i], u[i], float(t[i]))
        return Linearization(A, B)

    def curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array:
        """Return ``z . D2f`` (n, nx+nu, nx+nu) at samples; z (n, nx) like the others."""
        n = self.nx + self.nu
        H = np.empty((len(t), n, n))
        for i in range(len(t)):
            H[i] = self.curvature(x[i], u[i], float(t[i]), z[i])
        return H
