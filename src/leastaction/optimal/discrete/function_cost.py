"""A cost from plain functions of one stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np

from leastaction.errors import ArgumentError, brief
from leastaction.numerics.arrays import Array
from leastaction.numerics.calls import called
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.public import public
from leastaction.numerics.tracing import TracedFunction
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.functions import sized

CostDerivatives = Callable[..., tuple[Any, Any]] | Literal["jax", "complex-step"]


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
        if isinstance(derivatives, str) and derivatives not in ("jax", "complex-step"):
            raise ArgumentError(f"derivatives: got {derivatives!r}, expected a function, 'jax' or 'complex-step'")
        given = not isinstance(derivatives, str)
        if (final_derivatives is not None) != (given and final is not None):
            raise ArgumentError(
                "final_derivatives: expected a function where `derivatives` is one and there is a `final`, else none"
            )
        self.nonnegative = nonnegative
        self._stage, self._final = stage, final
        self._derivatives, self._final_derivatives = derivatives, final_derivatives
        self._compiled: dict[int, TracedFunction] = {}  # by the number of states
        self._end_compiled = TracedFunction(final) if final is not None and derivatives == "jax" else None

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        if self._derivatives == "jax":
            return self._traced(x.shape[1]).derivative(0, np.hstack([x, u]), np.arange(start, start + len(u)))
        return np.array([_number("stage", called(self._stage, "stage", *at)) for at in _stages(x, u, start)])

    def final_value(self, x: Array) -> float:
        if self._final is None:
            return 0.0
        if self._end_compiled is not None:
            return float(self._end_compiled.derivative(0, x))
        return _number("final", called(self._final, "final", x))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        nx = x.shape[1]
        stages = self._stage_derivatives(x, u)[0]
        return CostGradient(stages[:, :nx], stages[:, nx:], self._end(x[-1])[0])

    def hessian(self, x: Array, u: Array) -> CostHessian:
        nx = x.shape[1]
        H = self._stage_derivatives(x, u, second=True)[1]
        H = 0.5 * (H + H.transpose(0, 2, 1))
        final = self._end(x[-1], second=True)[1]
        return CostHessian(H[:, :nx, :nx], H[:, nx:, nx:], H[:, :nx, nx:], 0.5 * (final + final.T))

    def _traced(self, nx: int) -> TracedFunction:
        if nx not in self._compiled:
            self._compiled[nx] = TracedFunction(partial(_joined, self._stage, nx), rows=True)
        return self._compiled[nx]

    def _stage_derivatives(self, x: Array, u: Array, *, second: bool = False) -> tuple[Array, Array]:
        """Return the gradients (N, n) of all stages by ``[x; u]``, and the Hessians (N, n, n) if they are asked for."""
        nx, n = x.shape[1], x.shape[1] + u.shape[1]
        y = np.hstack([x[:-1], u])
        if self._derivatives == "jax":
            traced, k = self._traced(nx), np.arange(len(u))
            found = traced.derivative(1, y, k), traced.derivative(2, y, k) if second else np.empty(0)
            return sized("stage: gradient", found[0], (len(u), n)), found[1]
        if callable(self._derivatives):
            pairs = [
                _pair(called(self._derivatives, "derivatives", *at), "derivatives", n) for at in _stages(x[:-1], u, 0)
            ]
            return np.stack([pair[0] for pair in pairs]), np.stack([pair[1] for pair in pairs])
        values = [partial(_joined, self._stage, nx, k=k) for k in range(len(u))]
        first = np.stack([_stepped(value, at, "stage") for value, at in zip(values, y, strict=True)])
        if not second:
            return first, np.empty(0)
        H = [
            central_differences(partial(_stepped, value, what="stage"), at) for value, at in zip(values, y, strict=True)
        ]
        return first, np.stack(H)

    def _end(self, x: Array, *, second: bool = False) -> tuple[Array, Array]:
        """Return the gradient (nx,) and the Hessian (nx, nx) of the end."""
        nx = len(x)
        if self._final is None:
            return np.zeros(nx), np.zeros((nx, nx))
        if self._end_compiled is not None:
            traced = self._end_compiled
            return traced.derivative(1, x), traced.derivative(2, x) if second else np.empty(0)
        if self._final_derivatives is not None:
            return _pair(called(self._final_derivatives, "final_derivatives", x), "final_derivatives", nx)
        first = partial(_stepped, self._final, what="final")
        return first(x), central_differences(first, x) if second else np.empty(0)


def _joined(stage: Callable[[Any, Any, int], Any], nx: int, y: Any, k: int) -> Any:
    return called(stage, "stage", y[:nx], y[nx:], k)


def _stages(x: Array, u: Array, start: int) -> list[tuple[Array, Array, int]]:
    return [(x[i], u[i], start + i) for i in range(len(u))]


def _number(what: str, value: Any) -> float:
    return float(sized(what, value, ()))


def _pair(found: Any, what: str, n: int) -> tuple[Array, Array]:
    if not isinstance(found, Sequence) or len(found) != 2:
        raise ArgumentError(f"{what}: the function returned {brief(repr(found))}, expected a gradient and a Hessian")
    return sized(f"{what}: gradient", found[0], (n,)), sized(f"{what}: Hessian", found[1], (n, n))


def _stepped(value: Callable[[Any], Any], y: Array, what: str) -> Array:
    """Return a gradient by the complex step."""

    def at(moved: Any) -> Any:
        found = np.asarray(called(value, what, moved))
        if not np.iscomplexobj(found):
            raise ArgumentError(
                f"{what}: got a real result for complex arguments, so the complex step sees no derivative. Build it of "
                "NumPy functions of the arguments, without float(), or give `derivatives`"
            )
        _number(what, found.real)
        return found

    return complex_step(at, y)
