"""Costs that are squares of residuals, by Gauss and Newton."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array, as_array, as_choice, read_only
from leastaction.numerics.calls import called
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian


@public
class GaussNewton(Cost):
    """Half the sum of squares of residuals, ``1/2 sum_k |r(x_k, u_k, k)|^2 + 1/2 |r_N(x_N)|^2``.

    Its second derivative is that of Gauss and Newton, ``J'J``: right where residuals are small, and never indefinite.
    As fit for several threads as the functions. Of states that are plain vectors.

    Parameters
    ----------
    residual : callable
        ``residual(x, u, k) -> (m,)``, of as many entries at every stage.
    final : callable, optional
        ``final(x) -> (n,)`` of the last state; nothing if left out.
    derivatives : {"complex-step", "finite-differences"}, optional
        How they are differentiated: exactly, where they are analytic and take complex arrays, or by differences.

    Raises
    ------
    ArgumentError
        What is no function, or residuals that are not finite.
    """

    nonnegative = True

    def __init__(
        self,
        residual: Callable[[Array, Array, int], ArrayLike],
        final: Callable[[Array], ArrayLike] | None = None,
        *,
        derivatives: str = "complex-step",
    ) -> None:
        as_choice(derivatives, "derivatives", ("complex-step", "finite-differences"))
        self.residual, self.final, self.derivatives = residual, final, derivatives

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        squares = [self._residual(x[i], u[i], start + i) for i in range(len(u))]
        return np.array([0.5 * float(r @ r) for r in squares])

    def final_value(self, x: Array) -> float:
        r = self._last(x)
        return 0.5 * float(r @ r)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        nx = x.shape[1]
        slopes = np.empty((len(u), nx + u.shape[1]))
        for k in range(len(u)):
            slopes[k] = self._residual(x[k], u[k], k) @ self._jacobian(x[k], u[k], k)
        last = self._last(x[-1]) @ self._of_last(x[-1])
        return CostGradient(slopes[:, :nx].copy(), slopes[:, nx:].copy(), last)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        nx = x.shape[1]
        J = np.array([self._jacobian(x[k], u[k], k) for k in range(len(u))])
        H = J.swapaxes(1, 2) @ J
        last = self._of_last(x[-1])
        Q, R, S = (np.ascontiguousarray(part) for part in (H[:, :nx, :nx], H[:, nx:, nx:], H[:, :nx, nx:]))
        return CostHessian(Q, R, S, last.T @ last)

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return all of it, which is convex; see `Cost`."""
        return self.hessian(x, u)

    def _residual(self, x: Array, u: Array, k: int) -> Array:
        found = called(self.residual, "residual", read_only(x), read_only(u), k)
        return as_array(found, f"residual(x, u, {k})", (None,), meaning="(m,)")

    def _jacobian(self, x: Array, u: Array, k: int) -> Array:
        nx = len(x)
        return self._slopes(lambda z: self.residual(z[:nx], z[nx:], k), np.concatenate([x, u]))

    def _last(self, x: Array) -> Array:
        if self.final is None:
            return np.zeros(0)
        return as_array(called(self.final, "final", read_only(x)), "final(x)", (None,), meaning="(n,)")

    def _of_last(self, x: Array) -> Array:
        return np.zeros((0, len(x))) if self.final is None else self._slopes(self.final, x)

    def _slopes(self, function: Callable[[Any], Any], at: Array) -> Array:
        if self.derivatives == "complex-step":
            return complex_step(lambda y: np.asarray(function(y)), at)
        return np.asarray(central_differences(lambda y: np.asarray(function(y)), at))
