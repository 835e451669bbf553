"""The optimiser's result as a file."""

from __future__ import annotations

import os
from pathlib import Path

from leastaction.io.results.checks import check_history, check_shapes
from leastaction.io.results.continuous import ContinuousContent, check_continuous
from leastaction.io.results.record import load_record, save_record
from leastaction.numerics.arrays import Array, require_instance
from leastaction.optimal import ContinuousOptimizationResult, OptimizationResult


def save_result(path: str | os.PathLike[str], result: OptimizationResult) -> Path:
    """Write the result of an optimisation into a file; an existing file is replaced in one step.

    Parameters
    ----------
    path : path
        The file, by custom with the ending ``.npz``.
    result : OptimizationResult
        In discrete time or in continuous time.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ArgumentError
        What is no result.
    OutputError
        The file could not be written; an older file of that name is untouched.
    """
    require_instance(result, "result", OptimizationResult, "optimize() returns one")
    if isinstance(result, ContinuousOptimizationResult):
        return save_record(path, ContinuousContent.of(result))
    return save_record(path, result)


def load_result(path: str | os.PathLike[str]) -> OptimizationResult:
    """Read the result of an optimisation as it was saved; `optimize` with ``resume`` goes on with it.

    Parameters
    ----------
    path : path
        A file that `save_result` wrote.

    Returns
    -------
    OptimizationResult
        Of one in continuous time a `ContinuousOptimizationResult`.

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not such a file, of another format, or contradicts itself.
    """
    content: object = load_record(path, OptimizationResult, ContinuousContent).content
    if isinstance(content, ContinuousContent):
        check_continuous(content, str(path))
        return content.result()
    assert isinstance(content, OptimizationResult)
    check_result(content, str(path))
    return content


def check_result(result: OptimizationResult, source: str) -> None:
    """Raise a `ResultFileError` unless the arrays of a result fit each other and are finite.

    ``source``: where it comes from, for the message.
    """
    steps, nx, nu = len(result.u), result.x.shape[-1], result.u.shape[-1]
    # Those by which a run goes on are also by its unknowns and, where it was to return, by entries of the first state.
    least = nx + len(result.unknowns)
    most = least if result.limits is None else least + nx
    gains = min(max(result.projection_gain.shape[-1], least), most)
    shapes: dict[str, tuple[Array, tuple[int, ...]]] = {
        "x": (result.x, (steps + 1, nx)),
        "u": (result.u, (steps, nu)),
        "K": (result.K, (steps, nu, nx)),
        "projection_gain": (result.projection_gain, (steps, nu, gains)),
    }
    memory = result.memory
    if memory is not None:
        places = {"earlier": memory.earlier, "gaps": memory.gaps}
        if memory.resolved is not None:
            places["resolved.before"] = memory.resolved.before
        if memory.nearer is not None:
            places["nearer.place"] = memory.nearer.place
        for where, place in places.items():
            if place is not None:
                # With unknowns the states of a run are longer than those of its result.
                shapes |= {
                    f"memory.{where}.x": (place.x, (steps + 1, least)),
                    f"memory.{where}.u": (place.u, (steps, nu)),
                    f"memory.{where}.gain": (place.gain, (steps, nu, least)),
                }
        if memory.start is not None:
            start = memory.start.x
            shapes["memory.start.x"] = start, (gains,) if start.ndim == 1 else (steps + 1, gains)
            shapes["memory.start.u"] = memory.start.u, (steps, nu)
        if memory.gaps is not None:
            gaps = memory.gaps
            shapes["memory.gaps.size"] = gaps.size, (least,)
            shapes["memory.gaps.costates"] = gaps.costates, (steps + 1 if len(gaps.costates) else 0, least)
            shapes["memory.gaps.filter"] = gaps.filter, (len(gaps.filter), 2)
        if memory.wanted is not None:
            shapes["memory.wanted.x"] = memory.wanted.x, (steps + 1, gains)
            shapes["memory.wanted.u"] = memory.wanted.u, (steps, nu)
    check_shapes(shapes, f"{steps} steps, {nx} states and {nu} inputs", source)
    check_history(result, source)
