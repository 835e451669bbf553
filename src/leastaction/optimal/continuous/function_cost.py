"""Costs in continuous time from plain functions of one instant: numbers, or residuals whose squares count."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import ArrayLike

from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.public import public
from leastaction.optimal.continuous.cost import ContinuousCost, RateGradient, RateHessian
from leastaction.optimal.continuous.final_term import FinalTerm
from leastaction.optimal.cost import clipped
from leastaction.optimal.prices import CostDerivatives, FunctionPrice, Price, ResidualPrice, parts


class PricedCost(ContinuousCost):
    """A cost by a `Price` of every instant and of the last state. ``jumps``: times (s) where the price jumps."""

    def __init__(self, price: Price, jumps: Sequence[float]) -> None:
        self.price, self.jumps = price, tuple(as_array(list(jumps), "jumps").ravel().tolist())
        self.final_term = PricedFinalTerm(price)

    def rate(self, x: Array, u: Array, t: float) -> float:
        return float(self.price.values(x[None], u[None], [t])[0])

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        return self.price.values(x, u, t.tolist())

    def gradient(self, x: Array, u: Array, t: Array) -> RateGradient:
        nx, gradients = x.shape[1], self.price.gradients(x, u, t.tolist())
        return RateGradient(gradients[:, :nx].copy(), gradients[:, nx:].copy())

    def hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        return RateHessian(*parts(self.price.hessians(x, u, t.tolist()), x.shape[1]))


@public
class ContinuousFunctionCost(PricedCost):
    """A cost in continuous time given by functions of one instant; as fit for several threads as they are.

    Parameters
    ----------
    rate : callable
        ``rate(x, u, t) -> number``: what an instant costs by the second.
    final : callable, optional
        ``final(x) -> number``: what the last state costs; nothing if left out.
    derivatives, final_derivatives : callable or "jax" or "complex-step"
        How the derivatives by ``[x; u]`` are obtained, as of a `FunctionCost`, with the time in the place of the stage.
    nonnegative : bool, optional
        Whether no instant costs less than zero: trials are then given up earlier.
    jumps : sequence of float, optional
        Times (s) where the rate or its slope jumps.

    Raises
    ------
    ArgumentError
        Unknown ways to differentiate, or functions that return what is no number (found at the first call).

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction.costs import ContinuousFunctionCost
    >>> cost = ContinuousFunctionCost(lambda x, u, t: 1.0 - np.cos(x[0]) + u[0] ** 2, derivatives="complex-step")
    >>> cost.rate(np.array([np.pi]), np.array([1.0]), 0.0)
    3.0
    """

    def __init__(
        self,
        rate: Callable[[Any, Any, float], Any],
        final: Callable[[Any], Any] | None = None,
        *,
        derivatives: CostDerivatives,
        final_derivatives: Callable[[Any], tuple[Any, Any]] | None = None,
        nonnegative: bool = False,
        jumps: Sequence[float] = (),
    ) -> None:
        super().__init__(FunctionPrice(rate, final, derivatives, final_derivatives, "rate"), jumps)
        self.nonnegative = nonnegative


@public
class ContinuousGaussNewton(PricedCost):
    """Half the integral of the square of residuals, ``1/2 int |r(x, u, t)|^2 dt + 1/2 |r_f(x(tf))|^2``.

    Its second derivative is that of Gauss and Newton, as of a `GaussNewton`. As fit for several threads as the
    functions.

    Parameters
    ----------
    residual : callable
        ``residual(x, u, t) -> (m,)``, of as many entries at every instant.
    final : callable, optional
        ``final(x) -> (n,)`` of the last state; nothing if left out.
    derivatives : {"complex-step", "finite-differences"}, optional
        How they are differentiated: exactly, where they are analytic and take complex arrays, or by differences.
    jumps : sequence of float, optional
        Times (s) where the residual or its slope jumps.

    Raises
    ------
    ArgumentError
        What is no function, or residuals that are not finite.
    """

    nonnegative = True

    def __init__(
        self,
        residual: Callable[[Array, Array, float], ArrayLike],
        final: Callable[[Array], ArrayLike] | None = None,
        *,
        derivatives: str = "complex-step",
        jumps: Sequence[float] = (),
    ) -> None:
        super().__init__(ResidualPrice(residual, final, derivatives), jumps)


class PricedFinalTerm(FinalTerm):
    """What the last state costs by a `Price`."""

    def __init__(self, price: Price) -> None:
        self.price = price

    def value(self, x: Array, t: float) -> float:  # noqa: ARG002 - as of every final term
        return self.price.end(x)

    def gradient(self, x: Array, t: float) -> Array:  # noqa: ARG002
        return self.price.end_gradient(x)

    def hessian(self, x: Array, t: float) -> Array:  # noqa: ARG002
        return self.price.end_hessian(x)

    def convex_hessian(self, x: Array, t: float) -> Array:
        return clipped(self.hessian(x, t))
