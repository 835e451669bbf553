"""What a stage, or an instant by the second, and the end cost by plain functions of theirs, in either kind of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, brief
from leastaction.numerics.arrays import Array, as_array, as_choice, read_only
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.tracing import TracedFunction
from leastaction.optimal.functions import as_complex, called, sized

CostDerivatives = Callable[..., tuple[Any, Any]] | Literal["jax", "complex-step"]


class Price(ABC):
    """What points cost, and the end: ``x`` (n, nx), ``u`` (n, nu), ``when`` (n,), the stages' numbers or the times.

    Derivatives are by ``[x; u]``, m numbers.
    """

    @abstractmethod
    def values(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        """Return what each point costs (n,)."""

    @abstractmethod
    def gradients(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        """Return its first derivatives (n, m)."""

    @abstractmethod
    def hessians(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        """Return its second derivatives (n, m, m), symmetric."""

    @abstractmethod
    def end(self, x: Array) -> float:
        """Return what the last state (nx,) costs."""

    @abstractmethod
    def end_gradient(self, x: Array) -> Array:
        """Return its gradient (nx,)."""

    @abstractmethod
    def end_hessian(self, x: Array) -> Array:
        """Return its second derivatives (nx, nx), symmetric."""


class FunctionPrice(Price):
    """By functions that return numbers; see `FunctionCost`. ``what``: the name of the first, for messages."""

    def __init__(
        self,
        function: Callable[[Any, Any, Any], Any],
        final: Callable[[Any], Any] | None,
        derivatives: CostDerivatives,
        final_derivatives: Callable[[Any], tuple[Any, Any]] | None,
        what: str,
    ) -> None:
        if isinstance(derivatives, str) and derivatives not in ("jax", "complex-step"):
            raise ArgumentError(f"derivatives: got {derivatives!r}, expected a function, 'jax' or 'complex-step'")
        given = not isinstance(derivatives, str)
        if (final_derivatives is not None) != (given and final is not None):
            raise ArgumentError(
                "final_derivatives: expected a function where `derivatives` is one and there is a `final`, else none"
            )
        self.function, self.final, self.what = function, final, what
        self.derivatives, self.final_derivatives = derivatives, final_derivatives
        self._compiled: dict[int, TracedFunction] = {}  # by the number of states
        self._end_compiled = TracedFunction(final) if final is not None and derivatives == "jax" else None

    def values(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        if self.derivatives == "jax":
            return self._traced(x.shape[1]).derivative(0, np.hstack([x, u]), np.asarray(when))
        return np.array([_number(self.what, called(self.function, self.what, *at)) for at in _points(x, u, when)])

    def gradients(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        n = x.shape[1] + u.shape[1]
        if self.derivatives == "jax":
            found = self._traced(x.shape[1]).derivative(1, np.hstack([x, u]), np.asarray(when))
            return sized(f"{self.what}: gradient", found, (len(u), n))
        if callable(self.derivatives):
            return np.stack([self._given(*at)[0] for at in _points(x, u, when)])
        return np.stack([_stepped(value, y, self.what) for value, y in self._joined(x, u, when)])

    def hessians(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        if self.derivatives == "jax":
            H = self._traced(x.shape[1]).derivative(2, np.hstack([x, u]), np.asarray(when))
        elif callable(self.derivatives):
            H = np.stack([self._given(*at)[1] for at in _points(x, u, when)])
        else:
            H = np.stack([
                central_differences(partial(_stepped, value, what=self.what), y)
                for value, y in self._joined(x, u, when)
            ])  # fmt: skip
        return np.asarray(0.5 * (H + H.transpose(0, 2, 1)))

    def end(self, x: Array) -> float:
        if self.final is None:
            return 0.0
        if self._end_compiled is not None:
            return float(self._end_compiled.derivative(0, x))
        return _number("final", called(self.final, "final", x))

    def end_gradient(self, x: Array) -> Array:
        if self.final is None:
            return np.zeros(len(x))
        if self._end_compiled is not None:
            return self._end_compiled.derivative(1, x)
        if self.final_derivatives is not None:
            return _pair(called(self.final_derivatives, "final_derivatives", x), "final_derivatives", len(x))[0]
        return _stepped(self.final, x, "final")

    def end_hessian(self, x: Array) -> Array:
        if self.final is None:
            return np.zeros((len(x), len(x)))
        if self._end_compiled is not None:
            H = self._end_compiled.derivative(2, x)
        elif self.final_derivatives is not None:
            H = _pair(called(self.final_derivatives, "final_derivatives", x), "final_derivatives", len(x))[1]
        else:
            H = central_differences(partial(_stepped, self.final, what="final"), x)
        return np.asarray(0.5 * (H + H.T))

    def _traced(self, nx: int) -> TracedFunction:
        if nx not in self._compiled:
            self._compiled[nx] = TracedFunction(partial(_at_point, self.function, nx, self.what), rows=True)
        return self._compiled[nx]

    def _given(self, x: Array, u: Array, when: Any) -> tuple[Array, Array]:
        assert callable(self.derivatives)
        return _pair(called(self.derivatives, "derivatives", x, u, when), "derivatives", len(x) + len(u))

    def _joined(self, x: Array, u: Array, when: Sequence[float]) -> Iterator[tuple[Callable[[Any], Any], Array]]:
        for y, at in zip(np.hstack([x, u]), when, strict=True):
            yield partial(_at_point, self.function, x.shape[1], self.what, when=at), y


class ResidualPrice(Price):
    """Half the squares of residuals, with second derivatives as Gauss and Newton's; see `GaussNewton`."""

    def __init__(
        self,
        residual: Callable[[Array, Array, Any], ArrayLike],
        final: Callable[[Array], ArrayLike] | None,
        derivatives: str,
    ) -> None:
        as_choice(derivatives, "derivatives", ("complex-step", "finite-differences"))
        self.residual, self.final, self.derivatives = residual, final, derivatives

    def values(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        residuals = [self._at(*at) for at in _points(x, u, when)]
        return np.array([0.5 * float(r @ r) for r in residuals])

    def gradients(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        return np.stack([self._at(*at) @ self._jacobian(*at) for at in _points(x, u, when)])

    def hessians(self, x: Array, u: Array, when: Sequence[float]) -> Array:
        J = np.array([self._jacobian(*at) for at in _points(x, u, when)])
        return np.asarray(J.swapaxes(1, 2) @ J)

    def end(self, x: Array) -> float:
        r = self._last(x)
        return 0.5 * float(r @ r)

    def end_gradient(self, x: Array) -> Array:
        return np.asarray(self._last(x) @ self._of_last(x))

    def end_hessian(self, x: Array) -> Array:
        J = self._of_last(x)
        return np.asarray(J.T @ J)

    def _at(self, x: Array, u: Array, when: Any) -> Array:
        found = called(self.residual, "residual", read_only(x), read_only(u), when)
        return as_array(found, f"residual(x, u, {when:g})", (None,), meaning="(m,)")

    def _jacobian(self, x: Array, u: Array, when: Any) -> Array:
        nx = len(x)
        return self._differentiated(lambda z: self.residual(z[:nx], z[nx:], when), np.concatenate([x, u]))

    def _last(self, x: Array) -> Array:
        if self.final is None:
            return np.zeros(0)
        return as_array(called(self.final, "final", read_only(x)), "final(x)", (None,), meaning="(n,)")

    def _of_last(self, x: Array) -> Array:
        return np.zeros((0, len(x))) if self.final is None else self._differentiated(self.final, x)

    def _differentiated(self, function: Callable[[Any], Any], at: Array) -> Array:
        if self.derivatives == "complex-step":
            return complex_step(lambda y: np.asarray(function(y)), at)
        return np.asarray(central_differences(lambda y: np.asarray(function(y)), at))


def parts(H: Array, nx: int) -> tuple[Array, Array, Array]:
    """Return second derivatives (n, m, m) by states, by inputs, and by both: Q, R and S."""
    Q, R, S = (np.ascontiguousarray(part) for part in (H[:, :nx, :nx], H[:, nx:, nx:], H[:, :nx, nx:]))
    return Q, R, S


def _at_point(function: Callable[[Any, Any, Any], Any], nx: int, what: str, y: Any, when: Any) -> Any:
    return called(function, what, y[:nx], y[nx:], when)


def _points(x: Array, u: Array, when: Sequence[float]) -> Iterator[tuple[Array, Array, Any]]:
    return zip(x, u, when, strict=True)


def _number(what: str, value: Any) -> float:
    return float(sized(what, value, ()))


def _pair(found: Any, what: str, n: int) -> tuple[Array, Array]:
    if not isinstance(found, Sequence) or len(found) != 2:
        raise ArgumentError(f"{what}: the function returned {brief(repr(found))}, expected a gradient and a Hessian")
    return sized(f"{what}: gradient", found[0], (n,)), sized(f"{what}: Hessian", found[1], (n, n))


def _stepped(value: Callable[[Any], Any], y: Array, what: str) -> Array:
    """Return a gradient by the complex step."""

    def at(moved: Any) -> Any:
        found = as_complex(what, called(value, what, moved), "derivatives")
        _number(what, found.real)
        return found

    return complex_step(at, y)
