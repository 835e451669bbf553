"""What has to fit in a result that is read from a file."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.errors import ResultFileError
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.optimal import OptimizationResult


def check_shapes(shapes: Mapping[str, tuple[Array, tuple[int, ...]]], sizes: str, source: str) -> None:
    """Raise a `ResultFileError` unless arrays have the shapes that they should, and hold finite numbers.

    ``sizes``: of what these shapes are, for the message; ``source``: where it comes from.
    """
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            raise ResultFileError(
                f"{source} contradicts itself: {name} has shape {array.shape}, expected {shape} for {sizes}. Run the "
                "optimisation again"
            )
        if not np.all(np.isfinite(array)):
            raise ResultFileError(
                f"{source} is damaged: {name} holds numbers that are not finite. Run the optimisation again"
            )


def check_history(result: OptimizationResult, source: str) -> None:
    """Raise a `ResultFileError` unless the history has an entry for each iteration."""
    for name, values in vars(result.history).items():
        expected = result.iterations + (name == "cost")
        if len(values) != expected:
            raise ResultFileError(
                f"{source} contradicts itself: history.{name} has {len(values)} entries, expected {expected} "
                f"for {result.iterations} iterations. Run the optimisation again"
            )


@public
def check_result(result: OptimizationResult, source: str) -> None:
    """Raise a `ResultFileError` unless the arrays of a result fit each other and are finite.

    ``source``: where it comes from, for the message.
    """
    steps, nx, nu = len(result.u), result.x.shape[-1], result.u.shape[-1]
    # Of states that are no plain vectors gains act on differences, which have fewer numbers.
    ndx, given, unknowns = result.K.shape[-1], result.projection_gain.shape[-1], len(result.unknowns)
    if not 0 < ndx < nx or (result.limits is None and given != ndx + unknowns):
        ndx = nx
    # Those by which a run goes on are also by its unknowns and, where it was to return or looks back, by entries of the
    # first state or of the step before.
    most = unknowns if result.limits is None else unknowns + 2 * nx + nu
    more = min(max(given - ndx, unknowns), most)
    gains, width = ndx + more, nx + more
    shapes: dict[str, tuple[Array, tuple[int, ...]]] = {
        "x": (result.x, (steps + 1, nx)),
        "u": (result.u, (steps, nu)),
        "K": (result.K, (steps, nu, ndx)),
        "projection_gain": (result.projection_gain, (steps, nu, gains)),
    }
    state = result.state
    if state is not None:
        run, begun, gaps = state.run, state.begun, state.gaps
        places = {"begun.earlier": begun.earlier, "gaps": gaps}
        if run.resolved is not None:
            places["run.resolved.before"] = run.resolved.before
        for where, place in places.items():
            if place is not None:
                # With unknowns the states of a run are longer than those of its result.
                shapes |= {
                    f"state.{where}.x": (place.x, (steps + 1, width)),
                    f"state.{where}.u": (place.u, (steps, nu)),
                    f"state.{where}.gain": (place.gain, (steps, nu, gains)),
                }
        for where, start in {"first": begun.first, "given": begun.given, "wanted": begun.wanted}.items():
            if start is not None:
                is_state = where == "given" and start.x.ndim == 1
                shapes[f"state.begun.{where}.x"] = start.x, (width,) if is_state else (steps + 1, width)
                shapes[f"state.begun.{where}.u"] = start.u, (steps, nu)
        if gaps is not None:
            shapes["state.gaps.size"] = gaps.size, (gains,)
            shapes["state.gaps.costates"] = gaps.costates, (steps + 1 if len(gaps.costates) else 0, gains)
            shapes["state.gaps.filter"] = gaps.filter, (len(gaps.filter), 2)
    check_shapes(shapes, f"{steps} steps, {nx} states and {nu} inputs", source)
    check_history(result, source)
