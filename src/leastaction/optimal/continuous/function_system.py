"""Continuous systems from matrices or from plain functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.public import public
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.functions import Curvature, Derivatives, Functions
from leastaction.optimal.system import sizes_of


def as_dynamics(A: ArrayLike, B: ArrayLike) -> tuple[Array, Array]:
    """Return matrices A (nx, nx) and B (nx, nu) of finite numbers, or raise an `ArgumentError`."""
    by_state, by_input = as_array(A, "A"), as_array(B, "B")
    if by_state.ndim != 2 or by_state.shape[0] != by_state.shape[1] or by_state.size == 0:
        raise ArgumentError(f"A: got shape {by_state.shape}, expected (nx, nx).")
    if by_input.ndim != 2 or by_input.shape[0] != len(by_state) or by_input.size == 0:
        raise ArgumentError(f"B: got shape {by_input.shape}, expected ({len(by_state)}, nu).")
    return by_state, by_input


@public
class LinearContinuousSystem(ContinuousSystem):
    """The linear system ``x' = A x + B u + c``.

    Parameters
    ----------
    A : array_like (nx, nx)
    B : array_like (nx, nu)
    c : array_like (nx,), optional
        Drift; zero if left out.

    Raises
    ------
    ArgumentError
        Shapes that do not fit together, or values that are not finite.
    """

    autonomous = True
    __getstate__, __setstate__ = saved_state, restore_state

    def __init__(self, A: ArrayLike, B: ArrayLike, *, c: ArrayLike | None = None) -> None:
        self.A, self.B = (read_only(each.copy()) for each in as_dynamics(A, B))
        self.nx, self.nu = self.B.shape
        self.c = read_only(np.zeros(self.nx) if c is None else as_array(c, "c", (self.nx,)).copy())

    def f(self, x: Array, u: Array, t: float) -> Array:  # noqa: ARG002
        result: Array = self.A @ x + self.B @ u + self.c
        return result

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:  # noqa: ARG002
        return self.A, self.B

    def curvature(self, x: Array, u: Array, t: float, z: Array) -> Array:  # noqa: ARG002
        return np.zeros((self.nx + self.nu, self.nx + self.nu))


@public
class FunctionContinuousSystem(ContinuousSystem):
    """A system given by functions of one time; as fit for several threads as they are.

    Parameters
    ----------
    f : callable
        ``f(x, u, t) -> x'``.
    nx, nu : int
        Numbers of states and inputs; where there are `names`, they may be left out.
    derivatives : callable or "jax" or "complex-step" or "finite-differences"
        ``derivatives(x, u, t) -> (A, B)``, or how to obtain them from `f`, as in `leastaction.optimal.FunctionSystem`.
    curvature : callable or "jax" or "differences", optional
        ``curvature(x, u, t, z) -> (nx+nu, nx+nu)``, or "jax" likewise, or "differences": central differences of
        ``z'[A B]``. Left out: Newton's method is not available.
    jumps : sequence of float, optional
        Times (s) where f jumps.
    names : pair of sequences of str, optional
        Names of the states and of the inputs, as in `leastaction.optimal.FunctionSystem`.

    Raises
    ------
    ArgumentError
        Wrong sizes, or functions that return wrong shapes (found at the first call).
    """

    def __init__(
        self,
        f: Callable[[Any, Any, float], Any],
        *,
        nx: int | None = None,
        nu: int | None = None,
        derivatives: Derivatives,
        curvature: Curvature | None = None,
        jumps: Sequence[float] = (),
        names: tuple[Sequence[str], Sequence[str]] | None = None,
    ) -> None:
        self.nx, self.nu, self.entry_names = sizes_of(nx, nu, names)
        self.jumps = tuple(as_array(list(jumps), "jumps").ravel().tolist())
        self.has_curvature = curvature is not None
        self._functions = Functions(f, self.nx, self.nu, derivatives, curvature)

    def f(self, x: Array, u: Array, t: float) -> Array:
        return self._functions.f(x, u, t)

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:
        return self._functions.derivatives(x, u, t)

    def curvature(self, x: Array, u: Array, t: float, z: Array) -> Array | None:
        return self._functions.curvature(x, u, t, z) if self.has_curvature else None
