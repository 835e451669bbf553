"""The optimiser's result as a file."""

from __future__ import annotations

import os
from pathlib import Path

from leastaction.errors import ResultFileError
from leastaction.io.results.opening import open as open_file
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.public import public
from leastaction.optimal import OptimizationResult


@public
def save_result(path: str | os.PathLike[str], result: OptimizationResult) -> Path:
    """Write the result of an optimisation into a file: `OptimizationResult.save`, which has the particulars.

    ``path``: the file; its ending says what is written. ``result``: in discrete time or in continuous time. Returns the
    file written. Raises `ArgumentError` for what is no result or another ending, `OutputError` where the file could not
    be written; an older file of that name is untouched.
    """
    require_instance(result, "result", OptimizationResult, "optimize() returns one")
    return result.save(path)


@public
def load_result(path: str | os.PathLike[str]) -> OptimizationResult:
    """Read the result of an optimisation: `leastaction.open`, where nothing else will do.

    ``path``: a file that `OptimizationResult.save` wrote. Returns the result, of one in continuous time a
    `ContinuousOptimizationResult`. Raises `ResultFileError`: the file is missing, damaged, not such a file, of another
    format, contradicts itself, or holds something else.
    """
    found = open_file(path)
    if not isinstance(found, OptimizationResult):
        raise ResultFileError(f"{path} holds a {type(found).__name__}, expected the result of an optimisation")
    return found
