"""Costs from plain functions of one stage: numbers, or residuals whose squares count."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.prices import CostDerivatives, FunctionPrice, Price, ResidualPrice, parts


class StagePricedCost(Cost):
    """A cost by a `Price` of every stage and of the last state."""

    def __init__(self, price: Price) -> None:
        self.price = price

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self.price.values(x[: len(u)], u, range(start, start + len(u)))

    def final_value(self, x: Array) -> float:
        return self.price.end(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        nx, gradients = x.shape[1], self.price.gradients(x[:-1], u, range(len(u)))
        return CostGradient(gradients[:, :nx].copy(), gradients[:, nx:].copy(), self.price.end_gradient(x[-1]))

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return CostHessian(
            *parts(self.price.hessians(x[:-1], u, range(len(u))), x.shape[1]), self.price.end_hessian(x[-1])
        )


@public
class FunctionCost(StagePricedCost):
    """A cost given by functions of one stage; as fit for several threads as they are.

    Parameters
    ----------
    stage : callable
        ``stage(x, u, k) -> number``: what stage k costs.
    final : callable, optional
        ``final(x) -> number``: what the last state costs; nothing if left out.
    derivatives : callable or "jax" or "complex-step"
        How the derivatives by ``[x; u]`` are obtained. "jax": of functions of JAX's NumPy, exact and compiled (extra
        ``jax``). "complex-step": of functions that accept complex arrays and are analytic; first derivatives are
        exact to rounding, second ones to about ten digits. A function ``derivatives(x, u, k) -> (gradient, hessian)``
        of shapes (nx+nu,) and (nx+nu, nx+nu) gives them, and then ``final_derivatives(x) -> (gradient, hessian)``
        those of the end.
    final_derivatives : callable, optional
        With functions for derivatives and a `final`.
    nonnegative : bool, optional
        Whether no stage costs less than zero: trials are then given up earlier.

    Raises
    ------
    ArgumentError
        Unknown ways to differentiate, or functions that return what is no number (found at the first call).

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction.costs import FunctionCost
    >>> cost = FunctionCost(lambda x, u, k: 1.0 - np.cos(x[0]) + 0.1 * u[0] ** 2, derivatives="complex-step")
    >>> cost.gradient(np.zeros((2, 1)), np.ones((1, 1))).r
    array([[0.2]])
    """

    def __init__(
        self,
        stage: Callable[[Any, Any, int], Any],
        final: Callable[[Any], Any] | None = None,
        *,
        derivatives: CostDerivatives,
        final_derivatives: Callable[[Any], tuple[Any, Any]] | None = None,
        nonnegative: bool = False,
    ) -> None:
        self.nonnegative = nonnegative
        super().__init__(FunctionPrice(stage, final, derivatives, final_derivatives, "stage"))


@public
class GaussNewton(StagePricedCost):
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
        super().__init__(ResidualPrice(residual, final, derivatives))

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return all of it, which is convex; see `Cost`."""
        return self.hessian(x, u)
