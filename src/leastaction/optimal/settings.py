"""The settings of an optimisation, checked; the same in discrete and in continuous time."""

from __future__ import annotations

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import as_choice, as_count, as_number
from leastaction.optimal.result import Settings

__all__ = ["check_settings"]

METHODS = ("auto", "steepest", "quasi-newton", "newton")
REGULATORS = ("descent", "lqr")


def check_settings(
    *,
    has_curvature: bool,
    system: str,
    method: str,
    regulator: str,
    max_iterations: int,
    tolerance: float,
    absolute_tolerance: float,
    alpha: float,
    beta: float,
    max_backtracks: int,
    chunk: int,
) -> Settings:
    """Return the settings of an optimisation, or complain about the first that is wrong.

    ``has_curvature``, ``system``: whether the system has a second derivative, and its name. ``method``, ``regulator``,
    ``max_iterations``, ``tolerance``, ``absolute_tolerance``, ``alpha``, ``beta``, ``max_backtracks``, ``chunk``: as in
    `leastaction.optimal.optimize`. Raises `ArgumentError`: a setting that does not exist or is out of range.
    """
    as_choice(method, "method", METHODS)
    as_choice(regulator, "regulator", REGULATORS)
    if method == "newton" and not has_curvature:
        raise ArgumentError(
            f"method: got 'newton', but {system} has no second derivative. Give it a "
            "`curvature`, or use 'auto' or 'quasi-newton'."
        )
    return Settings(
        method=method,
        regulator=regulator,
        max_iterations=as_count(max_iterations, "max_iterations", 0),
        tolerance=as_number(tolerance, "tolerance", least=0.0),
        absolute_tolerance=as_number(absolute_tolerance, "absolute_tolerance", least=0.0),
        alpha=as_number(alpha, "alpha", above=0.0, below=0.5),
        beta=as_number(beta, "beta", above=0.0, below=1.0),
        max_backtracks=as_count(max_backtracks, "max_backtracks", 0),
        chunk=as_count(chunk, "chunk", 1),
    )
