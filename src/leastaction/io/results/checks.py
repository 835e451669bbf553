"""What has to fit in a result that is read from a file."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.errors import ResultFileError
from leastaction.numerics.arrays import Array
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
