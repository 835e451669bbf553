"""Linear-quadratic problems: the affine LQ problem, the LQR, and the adjoint of a closed loop.

The problem, for ``k = 0 .. N-1``::

    minimise   sum  1/2 dx'Q dx + dx'S du + 1/2 du'R du + H_scale/2 [dx; du]'H [dx; du] + q'dx + r'du
               + 1/2 dx_N' Q_final dx_N + q_final' dx_N
    subject to dx+ = A dx + B du + c

The optimal input is ``du = -K dx - C``, the optimal cost from ``dx_0`` is
``1/2 dx_0'P0 dx_0 + b_0'dx_0 + constant`` (dissertation B.2.2 and B.2.3; the cost carries the 1/2).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_choice, as_number, require_finite
from leastaction.numerics.frozen import made
from leastaction.numerics.pool import empty
from leastaction.numerics.public import public
from leastaction.optimal.cost import final_of

Regularize = Literal["none", "stage"]


class Workspace:
    """Arrays that one solution after the other is written into.

    Fresh memory is slow (the gains of a long horizon are tens of megabytes), so a loop that solves one problem after
    the other hands in the same workspace. The solution it returns is valid until the workspace is used again.
    """

    def __init__(self, N: int, nx: int, nu: int) -> None:
        self.K = np.empty((N, nu, nx))
        self.C = np.empty((N, nu))
        self.b = np.empty((N + 1, nx))
        self.P0 = np.empty((nx, nx))
        self.kept: tuple[Array, Array] | None = None

    def keep(self) -> tuple[Array, Array]:
        """Return where P and the factors of all stages are written, if these are kept."""
        if self.kept is None:
            N, nu, nx = self.K.shape
            self.kept = np.empty((N + 1, nx, nx)), np.empty((N, nu, nu))
        return self.kept


@public
@dataclass(frozen=True)
class LinearQuadraticSolution:
    """Solution of a linear-quadratic problem, or the stage at which there is none.

    Attributes
    ----------
    K : ndarray (N, nu, nx)
        Feedback gains. NaN from `stage` down if the problem has no minimum.
    C : ndarray (N, nu)
        Feedforward, ``du = -K dx - C``.
    b : ndarray (N+1, nx)
        Linear term of the optimal cost; for ``c = 0`` also the adjoint of the loop closed with K.
    P0 : ndarray (nx, nx)
        Quadratic term of the optimal cost at ``k = 0``.
    P : ndarray (N+1, nx, nx) or None
        The same at every k, with `keep_P`.
    factors : ndarray (N, nu, nu) or None
        Then too: the Cholesky factors L of ``R + B'PB``, lower triangles.
    constant : float
        Optimal cost for ``dx_0 = 0``. For ``c = 0`` twice this is the derivative of the cost along the solution.
    definite : bool
        Whether the problem, as regularised, has a unique minimum. If not, do not use the rest.
    stage : int or None
        The stage where the recursion ended, or the first one (from the end) that was regularised.
    smallest_eigenvalue : float
        Of ``R + B'PB`` at that stage; NaN if every stage was definite.
    regularized_stages : int
        Number of stages regularised.
    largest_change : float
        Largest negative eigenvalue (its size) that was removed from a P.
    structured_stages : int
        Stages whose sparse rows or zero columns of ``[A B]`` were exploited; none of problems so small (16 states and
        inputs) that multiplying by zeros is faster.
    message : str
        All this in one sentence.
    """

    K: Array
    C: Array
    b: Array
    P0: Array
    P: Array | None
    factors: Array | None
    constant: float
    definite: bool
    stage: int | None
    smallest_eigenvalue: float
    regularized_stages: int
    largest_change: float
    structured_stages: int
    message: str


@public
def solve_linear_quadratic(
    A: ArrayLike,
    B: ArrayLike,
    *,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    S: ArrayLike | None = None,
    H: ArrayLike | None = None,
    H_scale: float = 1.0,
    part: tuple[Any, Array] | None = None,
    q: ArrayLike | None = None,
    r: ArrayLike | None = None,
    c: ArrayLike | None = None,
    Q_final: ArrayLike | None = None,
    q_final: ArrayLike | None = None,
    regularize: Regularize = "none",
    use_structure: bool = True,
    pattern: ArrayLike | None = None,
    keep_P: bool = False,
    workspace: Workspace | None = None,
) -> LinearQuadraticSolution:
    """Solve the affine linear-quadratic problem stated at the top of this module.

    Anything left out is zero; with ``q = r = q_final = c = 0`` this is the LQR.

    Parameters
    ----------
    A, B : array_like (N, nx, nx), (N, nx, nu)
        Dynamics.
    Q, R : array_like, optional
        Symmetric weights of state and input: a diagonal ``(n,)``, a matrix ``(n, n)``, a diagonal per
        stage ``(N, n, 1)`` or a matrix per stage ``(N, n, n)``.
    S : array_like (nx, nu) or (N, nx, nu), optional
        Cross weight.
    H : array_like (N, nx+nu, nx+nu), optional
        Symmetric Hessian of every stage, added to Q, S, R on the fly. Its lower triangle is read. With a `pattern` also
        (N, m (m+1)/2): lower triangles by rows, of the m inputs and states with entries in their columns.
    H_scale : float
        Factor of H.
    part : pair of array_like, optional
        Places (m,) in ``(x, u)``, ascending, and a symmetric matrix (N, m, m) by them for each stage, added to Q, S, R
        too. Its lower triangle is read.
    q, r, c : array_like (N, nx), (N, nu), (N, nx), optional
        Gradients of the cost and drift of the dynamics.
    Q_final, q_final : array_like (nx,) or (nx, nx), and (nx,), optional
        Final weight and gradient.
    regularize : {"none", "stage"}
        What to do where ``R + B'PB`` is not positive definite: end there, or go on with a nearby
        convex problem, with the positive semidefinite part of P and without that stage's H. After 16
        such stages H is left out of all the earlier ones.
    use_structure : bool
        Look for rows of ``[A B]`` with at most two entries and for zero columns, and use them.
    pattern : array_like of bool (nx, nx+nu), optional
        Which entries of ``[A B]`` may differ from zero, at any stage, for `use_structure` to need no look at them. The
        others are read at most where rows with more than two meet columns with some; nor is what H holds of states that
        nothing depends on. A `part` may couple these.
    keep_P : bool
        Return P of every stage, and the factors.
    workspace : Workspace, optional
        Where the solution is written; it is overwritten by the next one that uses it.

    Returns
    -------
    LinearQuadraticSolution
        Check `definite` before using it.

    Raises
    ------
    ArgumentError
        Wrong shapes, or a value that is not finite.
    """
    as_choice(regularize, "regularize", get_args(Regularize))
    A, B = _dynamics(A, B)
    N, nx, nu = B.shape
    if workspace is None:
        workspace = Workspace(N, nx, nu)
    elif workspace.K.shape != (N, nu, nx):
        raise ArgumentError(f"workspace: got one for K of shape {workspace.K.shape}, expected {(N, nu, nx)}.")
    entries = _pattern(pattern, (nx, nx + nu)) if use_structure else None
    return recursion(
        A,
        B,
        workspace,
        Q=_weight(Q, "Q", N, nx),
        R=_weight(R, "R", N, nu),
        S=_optional(S, "S", (nx, nu), (N, nx, nu)),
        H=_hessians(H, (N, nx + nu, nx + nu), entries),
        H_scale=as_number(H_scale, "H_scale", above=-np.inf),
        part=_part(part, N, nx + nu),
        q=_optional(q, "q", (N, nx)),
        r=_optional(r, "r", (N, nu)),
        c=_optional(c, "c", (N, nx)),
        Q_final=_weight(Q_final, "Q_final", N, nx, per_stage=False),
        q_final=_optional(q_final, "q_final", (nx,)),
        regularize=regularize == "stage",
        use_structure=use_structure,
        pattern=entries,
        keep_P=keep_P,
    )


def recursion(
    A: Array,
    B: Array,
    workspace: Workspace,
    *,
    part: tuple[Any, Array] | None = None,
    keep_P: bool = False,
    **terms: Any,
) -> LinearQuadraticSolution:
    """Return what `solve_linear_quadratic` does, of arrays that are looked through already; for short iterations.

    ``terms``: the others, by the same names, as the core takes them.

    Raises
    ------
    TypeError, ValueError
        What is no array of numbers, or a wrong shape, in the words of the core.
    ArgumentError
        A value that is not finite.
    """
    K, C, b, P0 = workspace.K, workspace.C, workspace.b, workspace.P0
    P, factors = workspace.keep() if keep_P else (None, None)
    columns, matrices = (None, None) if part is None else part
    report = _core.solve_linear_quadratic(A, B, K, C, b, P0, P, factors, part_columns=columns, part=matrices, **terms)
    if report.status == _NOT_FINITE:
        for name in ("Q", "R", "S", "q", "r", "c", "Q_final", "q_final"):
            if terms.get(name) is not None:
                require_finite(terms[name], name)
        raise ArgumentError(
            f"A, B, H, Q, R or S: got a value that is not finite, met at stage {report.stage} "
            f"(of 0 .. {len(A) - 1}). Look at A[{report.stage}], B[{report.stage}] and that stage's cost."
        )
    definite = report.status == _SOLVED
    if not definite:
        for unread in (K[: report.stage + 1], C[: report.stage + 1], b[: report.stage + 1], P0):
            unread.fill(np.nan)
        if P is not None:
            P[: report.stage + 1].fill(np.nan)
    return made(
        LinearQuadraticSolution,
        K=K,
        C=C,
        b=b,
        P0=P0,
        P=P,
        factors=factors,
        constant=report.constant if definite else np.nan,
        definite=definite,
        stage=report.stage if report.stage >= 0 else None,
        smallest_eigenvalue=report.smallest_eigenvalue,
        regularized_stages=report.regularized_stages,
        largest_change=report.largest_change,
        structured_stages=report.structured_stages,
        message=_message(definite, report),
    )


@public
def regulate(
    A: ArrayLike,
    B: ArrayLike,
    *,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    Q_final: ArrayLike | None = None,
    workspace: Workspace | None = None,
) -> Array:
    """Return the gains K (N, nu, nx) of the time-varying LQR, ``u = ubar - K (x - xbar)``.

    Parameters
    ----------
    A, B : array_like (N, nx, nx), (N, nx, nu)
        Linearisation along the trajectory to be held.
    Q, R : array_like, optional
        Weights as in `solve_linear_quadratic`; identities if left out.
    Q_final : array_like (nx,) or (nx, nx), optional
        Final weight; Q (its last one) if left out.
    workspace : Workspace, optional
        Where the solution is written; it is overwritten by the next one that uses it.

    Raises
    ------
    ArgumentError
        Wrong shapes, values that are not finite, or weights for which there is no regulator.
    """
    A, B = _dynamics(A, B)
    _, nx, nu = B.shape
    Q = np.ones(nx) if Q is None else as_array(Q, "Q")
    R = np.ones(nu) if R is None else R
    if Q_final is None:
        Q_final = final_of(Q)
    solution = solve_linear_quadratic(A, B, Q=Q, R=R, Q_final=Q_final, workspace=workspace)
    if not solution.definite:
        raise ArgumentError(
            f"Q, R: there is no regulator: {solution.message} Give a positive definite R and a positive semidefinite Q."
        )
    return solution.K


class Law(Protocol):
    """A linear law ``du = -K dx - C``."""

    @property
    def K(self) -> Array:
        """Gains (N, nu, nx)."""

    @property
    def C(self) -> Array:
        """Feedforward (N, nu)."""


class Feedforward(NamedTuple):
    """A law ``du = -K dx - C``: K (N, nu, nx), C (N, nu)."""

    K: Array
    C: Array


@public
def sweep_forward(
    A: Array,
    B: Array,
    solution: Law,
    dx0: ArrayLike | None = None,
    *,
    c: Array | None = None,
    pattern: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return dx (N+1, nx) and du (N, nu) of ``dx+ = A dx + B du + c`` with ``du = -K dx - C``; c (N, nx) or zero.

    With a `pattern` as of `solve_linear_quadratic` nothing else of A, B is read.
    """
    A, B = _dynamics(A, B)
    N, nx, nu = B.shape
    dx, du = np.empty((N + 1, nx)), np.empty((N, nu))
    dx[0] = 0.0 if dx0 is None else as_array(dx0, "dx0", (nx,))
    if not hasattr(solution, "K") or not hasattr(solution, "C"):
        raise ArgumentError(f"solution: got {type(solution).__name__}, expected what `solve_linear_quadratic` returns")
    c = None if c is None else _shaped(c, "c", (N, nx))
    _core.sweep_forward(A, B, solution.K, solution.C, c, dx, du, _pattern(pattern, (nx, nx + nu)))
    return dx, du


def feedforward_of_drift(
    A: Array, B: Array, K: Array, P: Array, factors: Array, c: Array, *, pattern: ArrayLike | None = None
) -> Array:
    """Return what a drift c (N, nx) adds to the feedforward (N, nu) of a problem that was solved, with its gains K.

    ``P``, ``factors``: those of all stages, as kept. Quicker than to solve it again by a factor of ten. With a
    `pattern` as of `solve_linear_quadratic` nothing else of A, B is read.
    """
    A, B = _dynamics(A, B)
    N, nx, nu = B.shape
    C = np.empty((N, nu))
    kept = (
        _shaped(K, "K", (N, nu, nx)),
        _shaped(P, "P", (N + 1, nx, nx)),
        _shaped(factors, "factors", (N, nu, nu)),
        _shaped(c, "c", (N, nx)),
    )
    _core.sweep_drift(A, B, *kept, C, _pattern(pattern, (nx, nx + nu)))
    return C


@public
def adjoint(
    A: Array, B: Array, K: Array, q: Array, r: Array, q_final: Array, *, pattern: ArrayLike | None = None
) -> Array:
    """Return the adjoint z (N+1, nx) of the loop closed with K (dissertation Prop. 7).

    ``z_N = q_final``, ``z_k = q_k - K'r_k + (A - BK)'z_{k+1}``: the derivative of the cost to go by
    the state while the feedback holds on. With a `pattern` as of `solve_linear_quadratic` nothing else of A, B is read.
    """
    A, B = _dynamics(A, B)
    N, nx, nu = B.shape
    z = np.empty((N + 1, nx))
    gains, gradient = _shaped(K, "K", (N, nu, nx)), (_shaped(q, "q", (N, nx)), _shaped(r, "r", (N, nu)))
    final = _shaped(q_final, "q_final", (nx,))
    _core.sweep_adjoint(A, B, gains, *gradient, final, z, _pattern(pattern, (nx, nx + nu)))
    if not np.isfinite(z[0]).all():
        # What is not a number goes on to the first stage, and all takes longer to look through than to use.
        for name, array in (("K", gains), ("q", gradient[0]), ("r", gradient[1]), ("q_final", final)):
            require_finite(array, name)
    return z


def swept(
    A: Array, B: Array, law: Law, dx0: Array | None, c: Array | None, pattern: npt.NDArray[np.bool_] | None
) -> tuple[Array, Array]:
    """Return what `sweep_forward` does, which looks through what the core does not take; for short iterations."""
    try:
        N, nx, nu = B.shape
        dx, du = empty((N + 1, nx)), empty((N, nu))
        dx[0] = 0.0 if dx0 is None else dx0
        _core.sweep_forward(A, B, law.K, law.C, c, dx, du, pattern)
    except (AttributeError, TypeError, ValueError):
        return sweep_forward(A, B, law, dx0, c=c, pattern=pattern)
    return dx, du


def adjoint_along(
    A: Array,
    B: Array,
    K: Array,
    gradient: tuple[Array, Array, Array],
    pattern: npt.NDArray[np.bool_] | None,
    by_inputs: Array | None = None,
) -> Array:
    """Return what `adjoint` does, which looks through what the core does not take; for short iterations.

    ``by_inputs`` (N, nu): where the derivative of the cost to go by the inputs is put, ``r + B'z``.
    """
    try:
        z = empty((len(A) + 1, A.shape[1]))
        _core.sweep_adjoint(A, B, K, *gradient, z, pattern, by_inputs)
    except (AttributeError, TypeError, ValueError):
        return adjoint(A, B, K, *gradient, pattern=pattern)
    return z if isfinite(z[0].dot(z[0])) else adjoint(A, B, K, *gradient, pattern=pattern)


def _dynamics(A: ArrayLike, B: ArrayLike) -> tuple[Array, Array]:
    # No values are checked here: the recursion meets what is not finite, and names the stage.
    try:
        A = np.ascontiguousarray(A, dtype=np.float64)
        B = np.ascontiguousarray(B, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(
            f"A, B: got {type(A).__name__} and {type(B).__name__}, expected arrays (N, nx, nx) and "
            "(N, nx, nu); `linearize(x, u)` of a system has them"
        ) from None
    if A.ndim != 3 or A.shape[1] != A.shape[2] or 0 in A.shape:
        raise ArgumentError(f"A: got shape {A.shape}, expected (N, nx, nx) with N, nx > 0.")
    if B.ndim != 3 or B.shape[:2] != A.shape[:2]:
        raise ArgumentError(f"B: got shape {B.shape}, expected ({A.shape[0]}, {A.shape[1]}, nu) to go with A.")
    return A, B


def _optional(value: ArrayLike | None, name: str, *shapes: tuple[int, ...]) -> Array | None:
    return None if value is None else _shaped(value, name, *shapes)


def _shaped(value: ArrayLike, name: str, *shapes: tuple[int, ...]) -> Array:
    """Return an array of one of some shapes; of an array of doubles the values are not checked."""
    if not isinstance(value, np.ndarray) or value.dtype != np.float64 or value.shape not in shapes:
        return as_array(value, name, *shapes)
    return np.ascontiguousarray(value)


def _part(part: tuple[Any, Any] | None, N: int, n: int) -> tuple[Any, Array] | None:
    """Return the places and matrices of a part in the layout of the core."""
    if part is None:
        return None
    columns, matrices = np.ascontiguousarray(part[0], dtype=np.int64), part[1]
    if columns.ndim != 1 or (np.diff(columns) <= 0).any() or (columns.size and not 0 <= columns[0] <= columns[-1] < n):
        raise ArgumentError(f"part: got the places {columns.tolist()}, expected ascending ones of 0 .. {n - 1}.")
    return columns, _shaped(matrices, "part", (N, len(columns), len(columns)))


def used(pattern: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Return which of ``[x; u]`` a pattern of ``[A B]`` has entries of, with all inputs."""
    nx, n = pattern.shape
    return np.concatenate([np.flatnonzero(pattern[:, :nx].any(axis=0)), np.arange(nx, n)])


def unpacked(H: Array, pattern: npt.NDArray[np.bool_]) -> Array:
    """Return packed Hessians as whole ones (N, nx+nu, nx+nu)."""
    places = used(pattern)
    full = np.zeros((len(H), pattern.shape[1], pattern.shape[1]))
    rows, columns = (places[k] for k in np.tril_indices(len(places)))
    full[:, rows, columns] = full[:, columns, rows] = H
    return full


def _hessians(value: ArrayLike | None, shape: tuple[int, ...], pattern: npt.NDArray[np.bool_] | None) -> Array | None:
    if value is None:
        return None
    shapes = [shape]
    if pattern is not None and np.ndim(value) == 2:
        nx, n = pattern.shape
        m = n - nx + int(np.count_nonzero(pattern[:, :nx].any(axis=0)))
        shapes.append((shape[0], m * (m + 1) // 2))
    return _shaped(value, "H", *shapes)


def _pattern(value: ArrayLike | None, shape: tuple[int, int]) -> npt.NDArray[np.bool_] | None:
    if value is None:
        return None
    try:
        pattern = np.ascontiguousarray(value)
    except (TypeError, ValueError):
        raise ArgumentError(f"pattern: got {type(value).__name__}, expected bool of shape {shape}.") from None
    if pattern.dtype != np.bool_ or pattern.shape != shape:
        raise ArgumentError(f"pattern: got {pattern.dtype} of shape {pattern.shape}, expected bool of shape {shape}.")
    return pattern


def _weight(value: ArrayLike | None, name: str, N: int, n: int, *, per_stage: bool = True) -> Array | None:
    """Return a weight: a diagonal or a matrix, perhaps one per stage."""
    shapes: list[tuple[int, ...]] = [(n,), (n, n)]
    if per_stage:
        shapes += [(N, n, 1), (N, n, n)]
    return _optional(value, name, *shapes)


_SOLVED, _NOT_FINITE = _core.LinearQuadraticStatus.solved, _core.LinearQuadraticStatus.not_finite


def _message(definite: bool, report: _core.LinearQuadraticReport) -> str:
    if report.stage < 0:
        return "Every stage is positive definite."
    where = (
        f"R + B'PB is not positive definite at stage {report.stage} "
        f"(smallest eigenvalue {report.smallest_eigenvalue:.3g})"
    )
    if not definite:
        return f"{where}: this linear-quadratic problem has no minimum."
    return f"{where}; {report.regularized_stages} stages were made convex (largest change {report.largest_change:.3g})."
