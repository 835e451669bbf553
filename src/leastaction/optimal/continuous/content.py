"""A result in continuous time as what a file holds: its functions of time as the coefficients of their pieces."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.result import OptimizationResult


@dataclass(frozen=True)
class Pieces:
    """A function of time: ``breaks`` (n+1,), ``coefficients`` (n, degrees, size), and the ``shape`` of a value."""

    breaks: Array
    coefficients: Array
    shape: tuple[int, ...]

    @classmethod
    def of(cls, function: PiecewisePolynomial) -> Pieces:
        """Return the pieces of a function."""
        return cls(function.breaks, function.coefficients, function.shape)

    def function(self) -> PiecewisePolynomial:
        """Return the function."""
        return PiecewisePolynomial(self.breaks, self.coefficients, self.shape)


@dataclass(frozen=True)
class ContinuousContent:
    """What a file holds of a `ContinuousOptimizationResult`.

    ``common``: what results in discrete time have too. The others are as there, ``trajectory`` with states and inputs
    in one vector, of which the first ``nx`` are states.
    """

    common: OptimizationResult
    nx: int
    t: Array
    trajectory: Pieces
    feedback: Pieces
    projection: Pieces
    accuracy: Accuracy
    jumps: tuple[float, ...]

    @classmethod
    def of(cls, result: Any) -> ContinuousContent:
        """Return what a file holds of a result."""
        common = OptimizationResult(**common_of(result))
        if isinstance(common.settings.projection, PiecewisePolynomial):
            # They are those of the projection, which are kept.
            common = replace(common, settings=common.settings.changed(projection=None))
        return cls(
            common=common,
            nx=result.dense.nx,
            t=result.t,
            trajectory=Pieces.of(result.dense.xu),
            feedback=Pieces.of(result.feedback),
            projection=Pieces.of(result.projection),
            accuracy=result.accuracy,
            jumps=tuple(result.jumps),
        )


def common_of(result: OptimizationResult) -> dict[str, Any]:
    """Return the fields of a result that those in either kind of time have."""
    return {field.name: getattr(result, field.name) for field in fields(OptimizationResult)}
