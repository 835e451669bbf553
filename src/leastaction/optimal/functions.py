"""Derivatives of dynamics that are given as plain functions, in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np

from leastaction.errors import ArgumentError, brief
from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.tracing import TracedFunction

Derivatives = Callable[[Array, Array, Any], tuple[Any, Any]] | Literal["jax", "complex-step", "finite-differences"]
Curvature = Callable[[Array, Array, Any, Array], Any] | Literal["jax", "differences"]


def called(function: Callable[..., Any], what: str, *arguments: Any) -> Any:
    """Return what a user's function returns; what it raises passes, but where it cannot be called with the arguments.

    ``what``: what it is, for the message.
    """
    try:
        return function(*arguments)
    except TypeError as error:
        traceback = error.__traceback__
        if traceback is not None and traceback.tb_next is not None:
            raise
        raise ArgumentError(
            f"{what}: got {brief(repr(function))}, expected a function of {len(arguments)} arguments: {error}"
        ) from error


class Functions:
    """A function ``f(x, u, when)`` and its derivatives, given or obtained as asked for.

    ``f``: ``f(x, u, when) -> (nx,)``; `when` is the index of a step or a time. ``nx``, ``nu``: numbers of states and
    inputs. ``derivatives``, ``curvature``: as in `leastaction.optimal.FunctionSystem`. Raises `ArgumentError`: an
    unknown way to differentiate, or functions that return wrong shapes (at the first call).
    """

    def __init__(
        self, f: Callable[[Any, Any, Any], Any], nx: int, nu: int, derivatives: Derivatives, curvature: Curvature | None
    ) -> None:
        if isinstance(derivatives, str) and derivatives not in ("jax", "complex-step", "finite-differences"):
            raise ArgumentError(
                f"derivatives: got {derivatives!r}, expected a function, 'jax', 'complex-step' or 'finite-differences'."
            )
        if isinstance(curvature, str) and curvature not in ("jax", "differences"):
            raise ArgumentError(f"curvature: got {curvature!r}, expected a function, 'jax' or 'differences'.")
        self._traced = TracedFunction(partial(_joined, f, nx)) if derivatives == "jax" else None
        self._weighted = TracedFunction(partial(_weighted, f, nx)) if curvature == "jax" else None
        self.nx, self.nu = nx, nu
        self._f = f
        self._derivatives = derivatives
        self._curvature = curvature

    @property
    def derivatives_given(self) -> Callable[[Array, Array, Any], tuple[Any, Any]] | None:
        """The function that was given for first derivatives, if one was."""
        return self._derivatives if callable(self._derivatives) else None

    @property
    def curvature_given(self) -> Callable[[Array, Array, Any, Array], Any] | None:
        """The function that was given for second derivatives, if one was."""
        return self._curvature if callable(self._curvature) else None

    def f(self, x: Array, u: Array, when: Any) -> Array:
        """Return the value (nx,)."""
        if self._traced is not None:
            return sized("f", self._traced.derivative(0, np.concatenate([x, u]), when), (self.nx,))
        return sized("f", called(self._f, "f", x, u, when), (self.nx,))

    def derivatives(self, x: Array, u: Array, when: Any) -> tuple[Array, Array]:
        """Return A (nx, nx) and B (nx, nu)."""
        if callable(self._derivatives):
            found = called(self._derivatives, "derivatives", x, u, when)
            if not isinstance(found, Sequence) or len(found) != 2:
                raise ArgumentError(f"derivatives: the function returned {brief(repr(found))}, expected A and B.")
            A, B = found
            nx, nu = self.nx, self.nu
            return sized("A", A, (nx, nx)), sized("B", B, (nx, nu))
        y = np.concatenate([x, u])
        if self._traced is not None:
            G = sized("f", self._traced.derivative(1, y, when), (self.nx, self.nx + self.nu))
        elif self._derivatives == "complex-step":
            G = complex_step(partial(self._complex_value, when=when), y)
        else:
            G = central_differences(lambda y: self.f(y[: self.nx], y[self.nx :], when), y)
        return G[:, : self.nx], G[:, self.nx :]

    def curvature(self, x: Array, u: Array, when: Any, z: Array) -> Array:
        """Return ``z . D2f`` (nx+nu, nx+nu)."""
        n = self.nx + self.nu
        if callable(self._curvature):
            return sized("curvature", called(self._curvature, "curvature", x, u, when, z), (n, n))
        if self._weighted is not None:
            return self._weighted.derivative(2, np.concatenate([x, u]), when, z)

        def slope(y: Array) -> Array:
            return np.asarray(z @ np.hstack(self.derivatives(y[: self.nx], y[self.nx :], when)))

        H = central_differences(slope, np.concatenate([x, u]), step=1e-5)
        return np.asarray(0.5 * (H + H.T))

    def _complex_value(self, y: Any, when: Any) -> Any:
        value = as_complex("f", called(self._f, "f", y[: self.nx], y[self.nx :], when), "derivatives")
        sized("f", value.real, (self.nx,))
        return value


def _joined(f: Callable[[Any, Any, Any], Any], nx: int, y: Any, when: Any) -> Any:
    return f(y[:nx], y[nx:], when)


def _weighted(f: Callable[[Any, Any, Any], Any], nx: int, y: Any, when: Any, z: Any) -> Any:
    return z @ _joined(f, nx, y, when)


def as_complex(name: str, value: Any, instead: str) -> Any:
    """Return what a function returned for complex arguments; complain of a real result. ``instead``: what to give."""
    found = np.asarray(value)
    if not np.iscomplexobj(found):
        raise ArgumentError(
            f"{name}: got a real result for complex arguments, so the complex step sees no derivative. Build it of "
            f"NumPy functions of the arguments (np.array([...]), np.stack), without float(), or give `{instead}`"
        )
    return found


def sized(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return what a function returned, or complain about its shape."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{name}: the function returned {brief(repr(value))}, expected numbers {shape}.") from None
    if array.shape != shape:
        raise ArgumentError(f"{name}: the function returned shape {array.shape}, expected {shape}.")
    return array
