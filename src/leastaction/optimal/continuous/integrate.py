"""Initial-value problems by SciPy's adaptive integrators, step by step, with dense output.

Stepping is done here and not by ``solve_ivp``, so that an integration can be given up in the middle, ends
with a reason instead of a warning, and starts anew where its equation jumps.
"""

from __future__ import annotations

import importlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, as_count, as_number
from leastaction.optimal.continuous.piecewise import Mesh, PiecewisePolynomial

__all__ = ["Accuracy", "Integration", "integrate", "segments"]

# Those whose state is left as it was by a step that ends in an exception.
_EXPLICIT = ("DOP853", "RK45", "RK23")

SOLVERS = ("DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA")


@dataclass(frozen=True)
class Accuracy:
    """How differential equations are integrated.

    Attributes
    ----------
    solver : {"DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA"}
        SciPy's integrator. The last three are for stiff equations.
    rtol, atol : float
        Error of one step that is allowed, ``atol + rtol * |y|``.
    max_steps : int
        Steps of one integration after which it is given up.
    """

    solver: str = "DOP853"
    rtol: float = 1e-9
    atol: float = 1e-11
    max_steps: int = 20_000

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise ArgumentError(
                f"solver: got {self.solver!r}, expected one of {', '.join(SOLVERS)}."
            )
        # SciPy does not go below 100 times the rounding unit.
        as_number(self.rtol, "rtol", above=3e-14, below=0.1)
        as_number(self.atol, "atol", above=0.0)
        as_count(self.max_steps, "max_steps", 1)

    @property
    def sampling(self) -> float:
        """Relative tolerance to which functions of time are sampled.

        It is above the error of the integrators' interpolants, whose kinks cannot be resolved.
        """
        return max(10.0 * self.rtol, 1e-12)


@dataclass(frozen=True)
class Integration:
    """The solution of an initial-value problem, or the part of it before it failed.

    Attributes
    ----------
    y : ndarray (n,)
        Value at the last time reached.
    t : float
        That time (s).
    steps : int
        Steps made.
    failure : str or None
        Why it ended early; None if it did not.
    breaks, values : ndarray (n+1,), (n * POINTS, size)
        Ends of the steps in increasing order, and the solution at the points of that mesh.
    """

    y: Array
    t: float
    steps: int
    failure: str | None
    breaks: Array
    values: Array

    @property
    def mesh(self) -> Mesh:
        """The steps as a mesh."""
        return Mesh(self.breaks)

    def curve(self, shape: tuple[int, ...]) -> PiecewisePolynomial:
        """Return the solution as a function of time."""
        return self.mesh.fit(self.values, shape)


def segments(t0: float, tf: float, jumps: Sequence[float]) -> list[float]:
    """Return t0, the jumps between, and tf, in increasing order."""
    least = 1e-12 * (abs(t0) + abs(tf))
    inner = sorted({float(t) for t in jumps if t0 + least < t < tf - least})
    return [t0, *inner, tf]


def integrate(
    fun: Callable[[float, Array], Array],
    t0: float,
    tf: float,
    y0: Array,
    *,
    accuracy: Accuracy,
    atol: Array | None = None,
    jumps: Sequence[float] = (),
    check: Callable[[float, Array], str | None] | None = None,
) -> Integration:
    """Integrate ``y' = fun(t, y)`` from t0 to tf, forwards or backwards.

    Parameters
    ----------
    fun : callable
        An `ArithmeticError`, or an error of this package other than an `ArgumentError`, ends the
        integration with that reason.
    t0, tf : float
        Times (s).
    y0 : ndarray (size,)
        Initial value.
    accuracy : Accuracy
    atol : ndarray (size,), optional
        Absolute tolerance of each entry, instead of the one of `accuracy`.
    jumps : sequence of float
        Times where `fun` jumps.
    check : callable, optional
        ``check(t, y)`` after every step; a string ends the integration with that reason.
    """
    stops = segments(min(t0, tf), max(t0, tf), jumps)
    if tf < t0:
        stops.reverse()
    # SciPy's integrators take most of a second to import: only those pay who integrate.
    method = getattr(importlib.import_module("scipy.integrate"), accuracy.solver)
    pieces: list[tuple[float, float, Any]] = []
    y, reached = y0, t0
    steps, failure = 0, None
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for begin, end in itertools.pairwise(stops):
            inside = _kept_inside(fun, min(begin, end), max(begin, end))
            try:
                solver = method(
                    inside,
                    begin,
                    y,
                    end,
                    rtol=accuracy.rtol,
                    atol=accuracy.atol if atol is None else atol,
                )
                while solver.status == "running":
                    reason = _step(solver, shortest=1e-9 * abs(tf - t0))
                    if solver.status == "failed":
                        failure = (
                            f"the integrator gave up, {str(reason).rstrip('.').lower()}: the "
                            "solution escapes there, or has no rate beyond"
                        )
                        break
                    steps += 1
                    y, reached = solver.y, float(solver.t)
                    pieces.append((float(solver.t_old), reached, solver.dense_output()))
                    if check is not None:
                        failure = check(reached, y)
                    if failure is None and not math.isfinite(float(np.sum(y))):
                        failure = "the solution is not finite"
                    if failure is None and steps >= accuracy.max_steps:
                        failure = f"{steps} steps were not enough (max_steps)"
                    if failure is not None:
                        break
            except ArgumentError:
                raise
            except (LeastActionError, ArithmeticError) as error:
                failure = str(error)
            except ValueError as error:
                # SciPy's way to say that the right-hand side is not finite, in its stiff integrators.
                if "finite" not in str(error) and "infs or NaNs" not in str(error):
                    raise
                failure = f"the integrator gave up, {error}"
            if failure is not None:
                break
    if failure is not None:
        failure = f"t = {reached:.6g} s: {failure}"
    breaks, values = _sampled(pieces, t0, y0, backwards=tf < t0, wanted=failure is None)
    return Integration(y, reached, steps, failure, breaks, values)


def _step(solver: Any, shortest: float) -> str | None:
    """Make a step, a shorter one where the equation has no value within it.

    A trial step may well look further ahead than the solution goes.
    """
    while True:
        try:
            message: str | None = solver.step()
        except ArgumentError:
            raise
        except (LeastActionError, ArithmeticError):
            if type(solver).__name__ not in _EXPLICIT:
                raise
            solver.h_abs *= 0.2
            if solver.h_abs < shortest:
                raise
        else:
            return message


def _kept_inside(
    fun: Callable[[float, Array], Array], low: float, high: float
) -> Callable[[float, Array], Array]:
    """Return fun that sees times strictly between the ends, where it may jump."""
    low, high = math.nextafter(low, high), math.nextafter(high, low)
    return lambda t, y: fun(low if t < low else high if t > high else t, y)


def _sampled(
    pieces: list[tuple[float, float, Any]],
    t0: float,
    y0: Array,
    *,
    backwards: bool,
    wanted: bool,
) -> tuple[Array, Array]:
    if not pieces or not wanted:
        return np.array([t0]), np.empty((0, y0.size))
    if backwards:
        pieces = pieces[::-1]
    ends = [max(old, new) for old, new, _ in pieces]
    breaks = np.array([min(pieces[0][:2]), *ends])
    mesh = Mesh(breaks)
    points = mesh.t.reshape(len(pieces), -1)
    values = [dense(t).T for (_, _, dense), t in zip(pieces, points, strict=True)]
    return breaks, np.concatenate(values)
