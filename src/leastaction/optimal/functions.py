"""Derivatives of dynamics that are given as plain functions, in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array

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

    def f(self, x: Array, u: Array, when: Any) -> Array:
        """Return the value (nx,)."""
        return _sized("f", self._f(x, u, when), (self.nx,))

    def derivatives(self, x: Array, u: Array, when: Any) -> tuple[Array, Array]:
        """Return A (nx, nx) and B (nx, nu)."""
        if callable(self._derivatives):
            A, B = self._derivatives(x, u, when)
            nx, nu = self.nx, self.nu
            return _sized("A", A, (nx, nx)), _sized("B", B, (nx, nu))
        y = np.concatenate([x, u])
        columns = [
            self._complex_step(y, when, i)
            if self._derivatives == "complex-step"
            else self._central_difference(y, when, i)
            for i in range(y.size)
        ]
        G = np.stack(columns, axis=1)
        return G[:, : self.nx], G[:, self.nx :]

    def curvature(self, x: Array, u: Array, when: Any, z: Array) -> Array:
        """Return ``z . D2f`` (nx+nu, nx+nu)."""
        n = self.nx + self.nu
        if callable(self._curvature):
            return _sized("curvature", self._curvature(x, u, when, z), (n, n))
        y = np.concatenate([x, u])
        H = np.empty((n, n))
        for i in range(n):
            h = 1e-5 * max(1.0, abs(y[i]))
            ends = []
            for step in (h, -h):
                moved = y.copy()
                moved[i] += step
                A, B = self.derivatives(moved[: self.nx], moved[self.nx :], when)
                ends.append(z @ np.hstack((A, B)))
            H[i] = (ends[0] - ends[1]) / (2 * h)
        result: Array = 0.5 * (H + H.T)
        return result

    def _complex_step(self, y: Array, when: Any, i: int) -> Array:
        h = 1e-30
        moved = y.astype(complex)
        moved[i] += 1j * h
        value = np.asarray(self._f(moved[: self.nx], moved[self.nx :], when))
        if not np.iscomplexobj(value):
            raise ArgumentError(
                "f: got a real result for complex arguments, so the complex step sees no derivative. "
                "Build the result from the arguments (np.array([...]), np.stack), without float(), "
                "or give `derivatives`."
            )
        return _sized("f", value.imag / h, (self.nx,))

    def _central_difference(self, y: Array, when: Any, i: int) -> Array:
        h = 6e-6 * max(1.0, abs(y[i]))  # cube root of the rounding unit
        ends = []
        for step in (h, -h):
            moved = y.copy()
            moved[i] += step
            ends.append(self.f(moved[: self.nx], moved[self.nx :], when))
        result: Array = (ends[0] - ends[1]) / (2 * h)
        return result


def _sized(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ArgumentError(f"{name}: the function returned shape {array.shape}, expected {shape}.")
    return array
