"""A cost from plain functions of one stage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.prices import CostDerivatives, FunctionPrice, Price, parts


@public
class FunctionCost(Cost):
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
        self._price = FunctionPrice(stage, final, derivatives, final_derivatives, "stage")

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self._price.values(x[: len(u)], u, range(start, start + len(u)))

    def final_value(self, x: Array) -> float:
        return self._price.end(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        return stage_gradient(self._price, x, u)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return stage_hessian(self._price, x, u)


def stage_gradient(price: Price, x: Array, u: Array) -> CostGradient:
    """Return the first derivatives of a cost whose stages and end have a price."""
    nx, slopes = x.shape[1], price.slopes(x[:-1], u, range(len(u)))
    return CostGradient(slopes[:, :nx].copy(), slopes[:, nx:].copy(), price.end_slope(x[-1]))


def stage_hessian(price: Price, x: Array, u: Array) -> CostHessian:
    """Return its second derivatives."""
    return CostHessian(*parts(price.bends(x[:-1], u, range(len(u))), x.shape[1]), price.end_bend(x[-1]))
