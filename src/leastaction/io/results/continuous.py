"""A result in continuous time as what a file holds: its functions of time as the coefficients of their pieces."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import prod
from typing import Any

import numpy as np

from leastaction.errors import ResultFileError
from leastaction.io.results.checks import check_history, check_shapes
from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal import Accuracy, ContinuousOptimizationResult, DenseTrajectory, OptimizationResult


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
    def of(cls, result: ContinuousOptimizationResult) -> ContinuousContent:
        """Return what a file holds of a result."""
        common = OptimizationResult(**_common(result))
        return cls(
            common=common,
            nx=result.trajectory.nx,
            t=result.t,
            trajectory=Pieces.of(result.trajectory.xu),
            feedback=Pieces.of(result.feedback),
            projection=Pieces.of(result.projection),
            accuracy=result.accuracy,
            jumps=tuple(result.jumps),
        )

    def result(self) -> ContinuousOptimizationResult:
        """Return the result."""
        return ContinuousOptimizationResult(
            **_common(self.common),
            t=self.t,
            trajectory=DenseTrajectory(self.trajectory.function(), self.nx),
            feedback=self.feedback.function(),
            projection=self.projection.function(),
            accuracy=self.accuracy,
            jumps=self.jumps,
        )


def _common(result: OptimizationResult) -> dict[str, Any]:
    return {field.name: getattr(result, field.name) for field in fields(OptimizationResult)}


def check_continuous(content: ContinuousContent, source: str) -> None:
    """Raise a `ResultFileError` unless the parts of a result fit each other and are finite.

    ``source``: where it comes from, for the message.
    """
    common, nx = content.common, content.nx
    n, nu = len(content.t), common.u.shape[-1]
    shapes: dict[str, tuple[Array, tuple[int, ...]]] = {
        "t": (content.t, (n,)),
        "x": (common.x, (n, nx)),
        "u": (common.u, (n, nu)),
        "K": (common.K, (n, nu, nx)),
        "projection_gain": (common.projection_gain, (n, nu, nx)),
    }
    # Of the projection the gains row by row, and the feedforward behind them.
    wanted = {"trajectory": (nx + nu,), "feedback": (nu, nx), "projection": (nu * nx + nu,)}
    for name, shape in wanted.items():
        pieces: Pieces = getattr(content, name)
        ends = len(pieces.breaks)
        degrees = pieces.coefficients.shape[1] if pieces.coefficients.ndim > 1 else 0
        shapes[f"{name}.breaks"] = pieces.breaks, (max(ends, 2),)
        shapes[f"{name}.coefficients"] = pieces.coefficients, (ends - 1, max(degrees, 1), prod(shape))
        if pieces.shape != shape:
            raise ResultFileError(
                f"{source} contradicts itself: {name} is of shape {pieces.shape}, expected {shape} for {nx} states and "
                f"{nu} inputs. Run the optimisation again"
            )
    mesh = None if common.memory is None else common.memory.mesh
    if mesh is not None:
        N, nz, nv = len(mesh.u), mesh.x.shape[-1], mesh.u.shape[-1]
        shapes |= {
            "memory.mesh.breaks": (mesh.breaks, (N + 1,)),
            "memory.mesh.x": (mesh.x, (N + 1, nz)),
            "memory.mesh.u": (mesh.u, (N, nv)),
            "memory.mesh.gain": (mesh.gain, (N, nv, nz)),
        }
    check_shapes(shapes, f"{n} times, {nx} states and {nu} inputs", source)
    for name in ("t", *(f"{name}.breaks" for name in wanted)):
        if not (np.diff(shapes[name][0]) > 0.0).all():
            raise ResultFileError(f"{source} is damaged: {name} does not increase. Run the optimisation again")
    check_history(common, source)
