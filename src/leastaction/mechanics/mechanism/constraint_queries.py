"""Which constraints are redundant, from their gradients; `Mechanism` asks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array

# Length of what is left of a gradient, as a fraction of it, below which an equation counts as dependent.
RANK_TOLERANCE = 1e-9
# Share in a dependent gradient below which an equation has no part in it.
WEIGHT_TOLERANCE = 1e-6


def dependent_rows(jacobian: Array, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the names of rows that are linear combinations of rows before them, and of which ones.

    Raises `ArgumentError` if a row is not finite.
    """
    if not np.isfinite(jacobian).all():
        bad = [name for name, row in zip(names, jacobian, strict=True) if not np.isfinite(row).all()]
        raise ArgumentError(
            f"the gradient of {', '.join(map(repr, bad[:6]))} is not finite at this configuration, so the "
            "rank of the constraints is not determined; ask at another one"
        )
    # Rows of ordinary size, so that no square overflows.
    jacobian = jacobian / max(1.0, float(np.abs(jacobian).max(initial=0.0)))
    scales = np.linalg.norm(jacobian, axis=1)
    # A row without a gradient is one of rounding, compared with the whole.
    floor = RANK_TOLERANCE * max(1.0, float(scales.max(initial=0.0)))
    basis = np.zeros((0, jacobian.shape[1]))
    kept: list[int] = []
    found: dict[str, tuple[str, ...]] = {}
    for row, (name, scale) in enumerate(zip(names, scales, strict=True)):
        if scale <= floor:
            found[name] = ()
            continue
        unit = jacobian[row] / scale
        rest = unit - basis.T @ (basis @ unit)
        rest -= basis.T @ (basis @ rest)
        size = float(np.linalg.norm(rest))
        if size > RANK_TOLERANCE:
            basis = np.vstack([basis, rest / size])
            kept.append(row)
            continue
        rows = jacobian[kept] / scales[kept, None]
        weights = np.linalg.lstsq(rows.T, unit, rcond=None)[0]
        found[name] = tuple(
            names[other] for other, weight in zip(kept, weights, strict=True) if abs(weight) > WEIGHT_TOLERANCE
        )
    return found
