"""Constraint functions, and which of them are redundant: methods of `Mechanism`, which is ``m`` here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.arguments import Compiled, batch, rates, shaped, single
from leastaction.numerics.arrays import Array, Row

# Length of what is left of a gradient, as a fraction of it, below which an equation counts as dependent.
RANK_TOLERANCE = 1e-9
# Share in a dependent gradient below which an equation has no part in it.
WEIGHT_TOLERANCE = 1e-6


def constraint_values(m: Compiled, q: Row) -> Array:
    """Return h(q), shape (nc,), or (N, nc) for a batch."""
    values, one = batch(m, q)
    result = np.empty((len(values), m.nc))
    for row, configuration in zip(result, values, strict=True):
        row[:] = m.core.constraints(configuration)
    return shaped(result, one)


def constraint_residuals(m: Compiled, q: Row) -> dict[str, Any]:
    """Return h(q) by constraint name: floats, or arrays (N,) for a batch."""
    values = constraint_values(m, q)
    if values.ndim == 1:
        return {n: float(h) for n, h in zip(m.constraints, values, strict=True)}
    return dict(zip(m.constraints, values.T, strict=True))


def constraint_jacobian(m: Compiled, q: Row) -> Array:
    """Return Dh(q), shape (nc, nv), at q of shape (nq,)."""
    jacobian = m.core.constraint_jacobian(single(m, q))
    return np.asarray(jacobian).reshape(m.nc, m.nv)


def constraint_rates(m: Compiled, q: Row, v: Row) -> Array:
    """Return the rates (nc,) of the constraints at q (nq,) and v (nv,): ``Dh v``, and dh/dt where they move by time."""
    here, speed = single(m, q), rates(m, v)
    return np.asarray(constraint_jacobian(m, here) @ speed + m.core.constraint_drift(here)[0])


def constraint_rank(m: Compiled, q: Row) -> int:
    """Return the rank of the constraints on the dynamic variables at q of shape (nq,)."""
    return m.nc - len(redundancy(m, q))


def degrees_of_freedom(m: Compiled, q: Row) -> int:
    """Return nd less the rank of the constraints on the dynamic variables at q of shape (nq,)."""
    return m.nd - constraint_rank(m, q)


def redundancy(m: Compiled, q: Row) -> dict[str, tuple[str, ...]]:
    """Return the constraint equations that ask for nothing new at a configuration.

    Parameters
    ----------
    q : array_like, shape (nq,)
        The configuration.

    Returns
    -------
    dict of str to tuple of str
        Every equation whose gradient by the dynamic variables is a linear combination of those of
        equations listed before it in `constraints`, and which these are; none for a gradient of zero.
        Empty where all equations are independent. At a singular configuration, as a four-bar linkage
        in one line, equations are dependent that are independent elsewhere.

    Raises
    ------
    ArgumentError
        If a gradient is not finite there, as that of a path two points of which meet.
    """
    return _dependent_rows(constraint_jacobian(m, q)[:, : m.nd], m.constraints)


def _dependent_rows(jacobian: Array, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
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
