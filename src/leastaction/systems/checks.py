"""One name for holding to its definition whatever a user wrote: a function of an element, a system, a cost."""

from __future__ import annotations

from typing import Any, overload

from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics import FunctionReport, PythonFunction, check_function
from leastaction.optimal import (
    ContinuousCost,
    ContinuousSystem,
    Cost,
    DenseTrajectory,
    DerivativeReport,
    DiscreteSystem,
    checks,
)


@overload
def check_derivatives(
    what: PythonFunction, at: ArrayLike, *, tolerance: float = ..., strict: bool = ...
) -> FunctionReport: ...


@overload
def check_derivatives(
    what: DiscreteSystem,
    at: ArrayLike,
    u: ArrayLike,
    *,
    cost: Cost | None = ...,
    tolerance: float = ...,
    seed: int = ...,
) -> DerivativeReport: ...


@overload
def check_derivatives(
    what: ContinuousSystem,
    at: DenseTrajectory,
    *,
    cost: ContinuousCost | None = ...,
    tolerance: float = ...,
    seed: int = ...,
) -> DerivativeReport: ...


@overload
def check_derivatives(
    what: Cost, at: ArrayLike, u: ArrayLike, *, tolerance: float = ..., seed: int = ...
) -> DerivativeReport: ...


@overload
def check_derivatives(
    what: ContinuousCost, at: DenseTrajectory, *, tolerance: float = ..., seed: int = ...
) -> DerivativeReport: ...


def check_derivatives(what: Any, at: Any, *arguments: Any, **options: Any) -> FunctionReport | DerivativeReport:
    """Compare the derivatives of what you wrote with those of its definition.

    Parameters
    ----------
    what : PythonFunction, DiscreteSystem, ContinuousSystem, Cost or ContinuousCost
    at : array_like (m,), or a curve
        Where to compare: of a function at a point z, of a system or a cost along a curve x, u or a DenseTrajectory.
    *arguments, **options
        As of `leastaction.mechanics.check_function`, or of `leastaction.optimal.check_derivatives`, which takes a cost
        besides.

    Returns
    -------
    FunctionReport or DerivativeReport
        `ok`, and by name the errors; print it.

    Raises
    ------
    ArgumentError
        Something else, what does not fit it, and where a function's derivative is wrong (the message names the entry).
    """
    if isinstance(what, PythonFunction):
        return check_function(what, at, *arguments, **options)
    if isinstance(what, (DiscreteSystem, ContinuousSystem, Cost, ContinuousCost)):
        return checks.check_derivatives(what, at, *arguments, **options)
    raise ArgumentError(
        f"check_derivatives: got {type(what).__name__}, expected a PythonFunction (with a point z), a system or "
        "a cost (with a curve)"
    )
