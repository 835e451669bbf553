"""Discrete systems from matrices or from plain functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.optimal._arrays import Floats, as_count, as_floats
from leastaction.optimal.protocol import DiscreteSystem, Linearization

__all__ = ["FunctionSystem", "LinearSystem"]

StepFunction = Callable[[Any, Any, int], Any]
DerivativeFunction = Callable[[Floats, Floats, int], tuple[Any, Any]]
CurvatureFunction = Callable[[Floats, Floats, int, Floats], Any]


class LinearSystem(DiscreteSystem):
    """The linear system ``x+ = A x + B u + c``, constant or time-varying.

    Parameters
    ----------
    A : array_like (nx, nx) or (N, nx, nx)
    B : array_like (nx, nu) or (N, nx, nu)
    c : array_like (nx,) or (N, nx), optional
        Drift; zero if left out.
    N : int, optional
        Number of steps; needed only if A and B are constant.

    Raises
    ------
    ArgumentError
        Shapes that do not fit together, or values that are not finite.
    """

    def __init__(
        self, A: ArrayLike, B: ArrayLike, *, c: ArrayLike | None = None, N: int | None = None
    ) -> None:
        A_given, B_given = as_floats("A", A), as_floats("B", B)
        lengths = {a.shape[0] for a in (A_given, B_given) if a.ndim == 3}
        if N is not None:
            lengths.add(as_count("N", N, minimum=1))
        if len(lengths) != 1:
            got = f"{sorted(lengths)}" if lengths else "constant A and B and no N"
            raise ArgumentError(f"A, B, N: got horizons {got}, expected one. Give N once.")
        self.N = lengths.pop()
        if A_given.ndim not in (2, 3) or A_given.shape[-1] != A_given.shape[-2]:
            raise ArgumentError(f"A: got shape {A_given.shape}, expected (nx, nx) or (N, nx, nx).")
        self.nx = A_given.shape[-1]
        if B_given.ndim not in (2, 3) or B_given.shape[-2] != self.nx:
            raise ArgumentError(
                f"B: got shape {B_given.shape}, expected ({self.nx}, nu) or (N, {self.nx}, nu)."
            )
        self.nu = B_given.shape[-1]
        shape = (self.N, self.nx)
        drift = np.zeros(shape) if c is None else as_floats("c", c, shape, (self.nx,))
        self._A = np.ascontiguousarray(np.broadcast_to(A_given, (*shape, self.nx)))
        self._B = np.ascontiguousarray(np.broadcast_to(B_given, (*shape, self.nu)))
        self._c = np.broadcast_to(drift, shape)

    def f(self, x: Floats, u: Floats, k: int) -> Floats:
        """Return ``A x + B u + c``."""
        result: Floats = self._A[k] @ x + self._B[k] @ u + self._c[k]
        return result

    def derivatives(self, x: Floats, u: Floats, k: int) -> tuple[Floats, Floats]:  # noqa: ARG002
        """Return A and B of step k."""
        return self._A[k], self._B[k]

    def curvature(self, x: Floats, u: Floats, k: int, z: Floats) -> Floats:  # noqa: ARG002
        """Return zero."""
        return np.zeros((self.nx + self.nu, self.nx + self.nu))

    def linearize(
        self,
        x: Floats,  # noqa: ARG002
        u: Floats,  # noqa: ARG002
        out: Linearization | None = None,  # noqa: ARG002
    ) -> Linearization:
        """Return A and B; not a copy."""
        return Linearization(self._A, self._B)


class FunctionSystem(DiscreteSystem):
    """A system given by functions of one step.

    Parameters
    ----------
    f : callable
        ``f(x, u, k) -> x+``.
    nx, nu, N : int
        Numbers of states, inputs and steps.
    derivatives : callable or "complex-step" or "finite-differences"
        ``derivatives(x, u, k) -> (A, B)``, or how to obtain them from `f`. The complex step is
        exact to rounding, and needs an `f` that accepts complex arrays and is analytic (no ``abs``,
        no comparison); finite differences are good to about 1e-9 and make the optimiser's last
        digits unreliable. There is no default: nothing is differenced that you did not ask for.
    curvature : callable or "differences", optional
        ``curvature(x, u, k, z) -> (nx+nu, nx+nu)``, or "differences": central differences of
        ``z'[A B]``. Left out: Newton's method is not available.

    Raises
    ------
    ArgumentError
        Wrong sizes, or functions that return wrong shapes (found at the first call).
    """

    def __init__(
        self,
        f: StepFunction,
        *,
        nx: int,
        nu: int,
        N: int,
        derivatives: DerivativeFunction | Literal["complex-step", "finite-differences"],
        curvature: CurvatureFunction | Literal["differences"] | None = None,
    ) -> None:
        self.nx = as_count("nx", nx, minimum=1)
        self.nu = as_count("nu", nu, minimum=1)
        self.N = as_count("N", N, minimum=1)
        self._f = f
        self.has_curvature = curvature is not None
        if isinstance(derivatives, str) and derivatives not in (
            "complex-step",
            "finite-differences",
        ):
            raise ArgumentError(
                f"derivatives: got {derivatives!r}, expected a function, 'complex-step' or "
                "'finite-differences'."
            )
        if isinstance(curvature, str) and curvature != "differences":
            raise ArgumentError(
                f"curvature: got {curvature!r}, expected a function or 'differences'."
            )
        self._derivatives = derivatives
        self._curvature = curvature

    def f(self, x: Floats, u: Floats, k: int) -> Floats:
        """Return the next state."""
        return self._sized("f", self._f(x, u, k), (self.nx,))

    def derivatives(self, x: Floats, u: Floats, k: int) -> tuple[Floats, Floats]:
        """Return A and B of step k."""
        if callable(self._derivatives):
            A, B = self._derivatives(x, u, k)
            nx, nu = self.nx, self.nu
            return self._sized("A", A, (nx, nx)), self._sized("B", B, (nx, nu))
        y = np.concatenate([x, u])
        columns = [
            self._complex_step(y, k, i)
            if self._derivatives == "complex-step"
            else self._central_difference(y, k, i)
            for i in range(y.size)
        ]
        G = np.stack(columns, axis=1)
        return G[:, : self.nx], G[:, self.nx :]

    def curvature(self, x: Floats, u: Floats, k: int, z: Floats) -> Floats:
        """Return ``z . D2f`` of step k."""
        n = self.nx + self.nu
        if callable(self._curvature):
            return self._sized("curvature", self._curvature(x, u, k, z), (n, n))
        if self._curvature is None:
            return super().curvature(x, u, k, z)
        y = np.concatenate([x, u])
        H = np.empty((n, n))
        for i in range(n):
            h = 1e-5 * max(1.0, abs(y[i]))
            ends = []
            for step in (h, -h):
                moved = y.copy()
                moved[i] += step
                ends.append(z @ np.hstack(self.derivatives(moved[: self.nx], moved[self.nx :], k)))
            H[i] = (ends[0] - ends[1]) / (2 * h)
        result: Floats = 0.5 * (H + H.T)
        return result

    def _complex_step(self, y: Floats, k: int, i: int) -> Floats:
        h = 1e-30
        moved = y.astype(complex)
        moved[i] += 1j * h
        value = np.asarray(self._f(moved[: self.nx], moved[self.nx :], k))
        if not np.iscomplexobj(value):
            raise ArgumentError(
                "f: got a real result for complex arguments, so the complex step sees no derivative. "
                "Build the result from the arguments (np.array([...]), np.stack), without float(), "
                "or give `derivatives`."
            )
        return self._sized("f", value.imag / h, (self.nx,))

    def _central_difference(self, y: Floats, k: int, i: int) -> Floats:
        h = 6e-6 * max(1.0, abs(y[i]))  # cube root of the rounding unit
        ends = []
        for step in (h, -h):
            moved = y.copy()
            moved[i] += step
            ends.append(self.f(moved[: self.nx], moved[self.nx :], k))
        result: Floats = (ends[0] - ends[1]) / (2 * h)
        return result

    @staticmethod
    def _sized(name: str, value: Any, shape: tuple[int, ...]) -> Floats:
        array = np.asarray(value, dtype=np.float64)
        if array.shape != shape:
            raise ArgumentError(
                f"{name}: the function returned shape {array.shape}, expected {shape}."
            )
        return array
