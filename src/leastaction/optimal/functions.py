"""Derivatives of dynamics that are given as plain functions, in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import central_differences, complex_step

Derivatives = Callable[[Array, Array, Any], tuple[Any, Any]] | Literal["complex-step", "finite-differences"]
Curvature = Callable[[Array, Array, Any, Array], Any] | Literal["differences"]


class Functions:
    """A function ``f(x, u, when)`` and its derivatives, given or obtained as asked for.

    ``f``: ``f(x, u, when) -> (nx,)``; `when` is the index of a step or a time. ``nx``, ``nu``: numbers of states and
    inputs. ``derivatives``, ``curvature``: as in `leastaction.optimal.FunctionSystem`. Raises `ArgumentError`: an
    unknown way to differentiate, or functions that return wrong shapes (at the first call).
    """

    def __init__(
        self, f: Callable[[Any, Any, Any], Any], nx: int, nu: int, derivatives: Derivatives, curvature: Curvature | None
    ) -> None:
        if isinstance(derivatives, str) and derivatives not in ("complex-step", "finite-differences"):
            raise ArgumentError(
                f"derivatives: got {derivatives!r}, expected a function, 'complex-step' or 'finite-differences'."
            )
        if isinstance(curvature, str) and curvature != "differences":
            raise ArgumentError(f"curvature: got {curvature!r}, expected a function or 'differences'.")
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
        return sized("f", self._f(x, u, when), (self.nx,))

    def derivatives(self, x: Array, u: Array, when: Any) -> tuple[Array, Array]:
        """Return A (nx, nx) and B (nx, nu)."""
        if callable(self._derivatives):
            A, B = self._derivatives(x, u, when)
            nx, nu = self.nx, self.nu
            return sized("A", A, (nx, nx)), sized("B", B, (nx, nu))
        y = np.concatenate([x, u])
        if self._derivatives == "complex-step":
            G = complex_step(partial(self._complex_value, when=when), y)
        else:
            G = central_differences(lambda y: self.f(y[: self.nx], y[self.nx :], when), y)
        return G[:, : self.nx], G[:, self.nx :]

    def curvature(self, x: Array, u: Array, when: Any, z: Array) -> Array:
        """Return ``z . D2f`` (nx+nu, nx+nu)."""
        n = self.nx + self.nu
        if callable(self._curvature):
            return sized("curvature", self._curvature(x, u, when, z), (n, n))

        def slope(y: Array) -> Array:
            return np.asarray(z @ np.hstack(self.derivatives(y[: self.nx], y[self.nx :], when)))

        H = central_differences(slope, np.concatenate([x, u]), step=1e-5)
        return np.asarray(0.5 * (H + H.T))

    def _complex_value(self, y: Any, when: Any) -> Any:
        value = np.asarray(self._f(y[: self.nx], y[self.nx :], when))
        if not np.iscomplexobj(value):
            raise ArgumentError(
                "f: got a real result for complex arguments, so the complex step sees no derivative. "
                "Build the result from the arguments (np.array([...]), np.stack), without float(), "
                "or give `derivatives`."
            )
        sized("f", value.real, (self.nx,))
        return value


def sized(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return what a function returned, or complain about its shape."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ArgumentError(f"{name}: the function returned shape {array.shape}, expected {shape}.")
    return array
