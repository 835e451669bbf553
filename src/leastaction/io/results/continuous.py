"""A result in continuous time that is read from a file, and what has to fit in it."""

from __future__ import annotations

from math import prod

import numpy as np

from leastaction.errors import ResultFileError
from leastaction.io.results.checks import check_history, check_shapes
from leastaction.numerics.arrays import Array
from leastaction.optimal import ContinuousOptimizationResult, DenseTrajectory
from leastaction.optimal.continuous.content import ContinuousContent, Pieces, common_of
from leastaction.optimal.continuous.trajectory import OverTime


def result_of(content: ContinuousContent) -> ContinuousOptimizationResult:
    """Return the result that a file holds."""
    return ContinuousOptimizationResult(
        **{**common_of(content.common), "t": content.t},
        feedback=content.feedback.function(),
        projection=content.projection.function(),
        over_time=OverTime(DenseTrajectory(content.trajectory.function(), content.nx), content.accuracy, content.jumps),
    )


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
    mesh = None if common.state is None else common.state.mesh
    if mesh is not None:
        N, nz, nv = len(mesh.u), mesh.x.shape[-1], mesh.u.shape[-1]
        shapes |= {
            "state.mesh.breaks": (mesh.breaks, (N + 1,)),
            "state.mesh.x": (mesh.x, (N + 1, nz)),
            "state.mesh.u": (mesh.u, (N, nv)),
            "state.mesh.gain": (mesh.gain, (N, nv, mesh.gain.shape[-1])),
        }
    check_shapes(shapes, f"{n} times, {nx} states and {nu} inputs", source)
    for name in ("t", *(f"{name}.breaks" for name in wanted)):
        if not (np.diff(shapes[name][0]) > 0.0).all():
            raise ResultFileError(f"{source} is damaged: {name} does not increase. Run the optimisation again")
    check_history(common, source)
