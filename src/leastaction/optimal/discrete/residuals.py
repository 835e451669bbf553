"""Costs that are squares of residuals, by Gauss and Newton."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.function_cost import stage_gradient, stage_hessian
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.prices import ResidualPrice


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
        self.residual, self.final, self.derivatives = residual, final, derivatives
        self._price = ResidualPrice(residual, final, derivatives)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self._price.values(x[: len(u)], u, range(start, start + len(u)))

    def final_value(self, x: Array) -> float:
        return self._price.end(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        return stage_gradient(self._price, x, u)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return stage_hessian(self._price, x, u)

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return all of it, which is convex; see `Cost`."""
        return self.hessian(x, u)
