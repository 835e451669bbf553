"""The optimiser's result as a file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from leastaction.errors import ResultFileError
from leastaction.io.results.record import load_record, save_record
from leastaction.optimal import OptimizationResult


def save_result(path: str | os.PathLike[str], result: OptimizationResult) -> Path:
    """Write the result of an optimisation into a file; an existing file is replaced in one step.

    Parameters
    ----------
    path : path
        The file, by custom with the ending ``.npz``.
    result : OptimizationResult
        In discrete time.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; an older file of that name is untouched.
    """
    return save_record(path, result)


def load_result(path: str | os.PathLike[str]) -> OptimizationResult:
    """Read the result of an optimisation as it was saved; `optimize` with ``resume`` goes on with it.

    Parameters
    ----------
    path : path
        A file that `save_result` wrote.

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not such a file, of another format, or contradicts itself.
    """
    result = load_record(path, OptimizationResult).content
    check_result(result, str(path))
    return result


def check_result(result: OptimizationResult, source: str) -> None:
    """Raise a `ResultFileError` unless the arrays of a result fit each other and are finite.

    ``source``: where it comes from, for the message.
    """
    steps, nx, nu = len(result.u), result.x.shape[-1], result.u.shape[-1]
    # Those by which a run goes on are also by its unknowns and, where it was to return, by entries of the first state.
    least = nx + len(result.unknowns)
    most = least if result.limits is None else least + nx
    gains = min(max(result.projection_gain.shape[-1], least), most)
    shapes: dict[str, tuple[int, ...]] = {
        "x": (steps + 1, nx),
        "u": (steps, nu),
        "K": (steps, nu, nx),
        "projection_gain": (steps, nu, gains),
    }
    for name, shape in shapes.items():
        array = getattr(result, name)
        if array.shape != shape:
            raise ResultFileError(
                f"{source} contradicts itself: {name} has shape {array.shape}, expected {shape} for {steps} "
                f"steps, {nx} states and {nu} inputs. Run the optimisation again"
            )
        if not np.all(np.isfinite(array)):
            raise ResultFileError(
                f"{source} is damaged: {name} holds numbers that are not finite. Run the optimisation again"
            )
    for name, values in vars(result.history).items():
        expected = result.iterations + (name == "cost")
        if len(values) != expected:
            raise ResultFileError(
                f"{source} contradicts itself: history.{name} has {len(values)} entries, expected {expected} "
                f"for {result.iterations} iterations. Run the optimisation again"
            )
