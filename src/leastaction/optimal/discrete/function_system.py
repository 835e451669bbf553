"""Discrete systems from matrices or from plain functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_count
from leastaction.numerics.differences import central_differences
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.public import public
from leastaction.optimal.cost import owned
from leastaction.optimal.discrete.charts import StepInCharts
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.functions import Curvature, Derivatives, Functions, sized
from leastaction.optimal.space import StateSpace
from leastaction.optimal.system import Linearization, keeps, sizes_of

StepFunction = Callable[[Any, Any, int], Any]


@public
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

    __getstate__, __setstate__ = saved_state, restore_state

    def __init__(self, A: ArrayLike, B: ArrayLike, *, c: ArrayLike | None = None, N: int | None = None) -> None:
        A_given, B_given = owned(A, "A"), owned(B, "B")
        lengths = {a.shape[0] for a in (A_given, B_given) if a.ndim == 3}
        if N is not None:
            lengths.add(as_count(N, "N", 1))
        if len(lengths) != 1:
            got = f"{sorted(lengths)}" if lengths else "constant A and B and no N"
            raise ArgumentError(f"A, B, N: got horizons {got}, expected one. Give N once.")
        self.N = lengths.pop()
        if A_given.ndim not in (2, 3) or A_given.shape[-1] != A_given.shape[-2]:
            raise ArgumentError(f"A: got shape {A_given.shape}, expected (nx, nx) or (N, nx, nx).")
        self.nx = A_given.shape[-1]
        if B_given.ndim not in (2, 3) or B_given.shape[-2] != self.nx:
            raise ArgumentError(f"B: got shape {B_given.shape}, expected ({self.nx}, nu) or (N, {self.nx}, nu).")
        self.nu = B_given.shape[-1]
        shape = (self.N, self.nx)
        drift = np.zeros(shape) if c is None else as_array(c, "c", shape, (self.nx,)).copy()
        self._A = np.ascontiguousarray(np.broadcast_to(A_given, (*shape, self.nx)))
        self._B = np.ascontiguousarray(np.broadcast_to(B_given, (*shape, self.nu)))
        self._c = np.broadcast_to(drift, shape)

    def f(self, x: Array, u: Array, k: int) -> Array:
        result: Array = self._A[k] @ x + self._B[k] @ u + self._c[k]
        return result

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:  # noqa: ARG002
        return self._A[k], self._B[k]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:  # noqa: ARG002
        return np.zeros((self.nx + self.nu, self.nx + self.nu))

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization | None:  # noqa: ARG002
        """Return A and B, not a copy; None of a subclass with other derivatives."""
        if not keeps(self, LinearSystem, "derivatives"):
            return None
        return Linearization(self._A, self._B, self._no_curvature)

    def _no_curvature(self, z: Array) -> Array:  # noqa: ARG002
        n = self.nx + self.nu
        return np.zeros((self.N, n, n))


@public
class FunctionSystem(DiscreteSystem):
    """A system given by functions of one step; as fit for several threads as they are.

    Parameters
    ----------
    f : callable
        ``f(x, u, k) -> x+``.
    nx, nu, N : int
        Numbers of states, inputs and steps; where there are `names`, those of states and inputs may be left out.
    derivatives : callable or "jax" or "complex-step" or "finite-differences"
        ``derivatives(x, u, k) -> (A, B)``, or how to obtain them from `f`. "jax": of an `f` of JAX's NumPy, exact and
        compiled (extra ``jax``). The complex step is exact to rounding, and needs an `f` that accepts complex arrays
        and is analytic (no ``abs``, no comparison); finite differences are good to about 1e-9 and make the optimiser's
        last digits unreliable. There is no default: nothing is differenced that you did not ask for.
    curvature : callable or "jax" or "differences", optional
        ``curvature(x, u, k, z) -> (nx+nu, nx+nu)``, or "jax" likewise, or "differences": central differences of
        ``z'[A B]``. Left out: Newton's method is not available.
    names : pair of sequences of str, optional
        Names of the states and of the inputs, such as ``(["x", "v"], ["push"])``, for limits, results and messages.
    space : StateSpace, optional
        How states differ and move, where they are no plain vectors, such as ``ProductSpace(Rotations(), Vectors(3))``.
        Functions that are given for derivatives return those of the step read in charts, (ndx, ...), as `System` says.

    Raises
    ------
    ArgumentError
        Wrong sizes, or functions that return wrong shapes (found at the first call).
    """

    def __init__(
        self,
        f: StepFunction,
        *,
        nx: int | None = None,
        nu: int | None = None,
        N: int,
        derivatives: Derivatives,
        curvature: Curvature | None = None,
        space: StateSpace | None = None,
        names: tuple[Sequence[str], Sequence[str]] | None = None,
    ) -> None:
        self.nx, self.nu, self.entry_names = sizes_of(nx, nu, names)
        self.N = as_count(N, "N", 1)
        self.has_curvature = curvature is not None
        self.space = space
        functions = Functions(f, self.nx, self.nu, derivatives, curvature)
        if space is not None and space.nx != self.nx:
            raise ArgumentError(f"space: got one of states with {space.nx} numbers, expected nx = {self.nx}")
        charts = self.charts()
        self._functions = functions if charts is None else ChartFunctions(functions, charts)

    def f(self, x: Array, u: Array, k: int) -> Array:
        return self._functions.f(x, u, k)

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        return self._functions.derivatives(x, u, k)

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array | None:
        return self._functions.curvature(x, u, k, z) if self.has_curvature else None


class ChartFunctions:
    """A step ``f(x, u, k)`` and its derivatives by charts: given as such, or obtained as asked for.

    The complex step and differences are by the entries of a state: f takes such that are none of the space, as a
    quaternion of another length, whatever it makes of them.
    """

    def __init__(self, functions: Functions, space: StateSpace) -> None:
        self.functions, self.space = functions, space
        self.f = functions.f

    def derivatives(self, x: Array, u: Array, when: Any) -> tuple[Array, Array]:
        """Return A (ndx, ndx) and B (ndx, nu)."""
        space, given = self.space, self.functions.derivatives_given
        if given is not None:
            A, B = given(x, u, when)
            return sized("A", A, (space.ndx, space.ndx)), sized("B", B, (space.ndx, self.functions.nu))
        A, B = self.functions.derivatives(x, u, when)
        # What a direction moves, the other way round.
        read = np.linalg.pinv(space.plus_derivative(self.f(x, u, when)))
        return read @ A @ space.plus_derivative(x), read @ B

    def curvature(self, x: Array, u: Array, when: Any, z: Array) -> Array:
        """Return ``z . D2f`` (ndx+nu, ndx+nu)."""
        n, given = self.space.ndx + self.functions.nu, self.functions.curvature_given
        if given is not None:
            return sized("curvature", given(x, u, when, z), (n, n))
        step = StepInCharts(
            self.space, lambda x, u: self.f(x, u, when), lambda x, u: self.derivatives(x, u, when), x, u
        )
        at = np.concatenate([np.zeros(self.space.ndx), u])
        H = central_differences(lambda y: z @ step.derivatives(y), at, step=1e-5)
        return np.asarray(0.5 * (H + H.T))
