"""What projection, contradiction and equilibrium share: the null space of the constraints over the free variables.

With ``A = dh/ds`` (s: the free variables, scaled), a step ``d = n + t`` has a part that restores the constraints,
``n = -A^+ h`` (of least norm, so redundant constraints do no harm), and a part along them, with Z a basis of the
null space of A and B the second derivative of the Lagrangian with the multiplier ``-A^+T slope``::

    t = -Z (Z^T B Z)^-1 Z^T (slope + B n)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import unknown
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_flag
from leastaction.numerics.names import as_names

Indices = NDArray[np.intp]

# Singular values below this fraction of the largest count as zero: redundant constraints.
RANK_TOLERANCE = 1e-10
# Beside the constraints the bound rises with their residual, up to this fraction of the largest.
LOOSE_RANK_TOLERANCE = 0.03
_LOOSENING = 10.0
_LEFT = 0.1  # of |h| at most may be left for a later step


def row_scales(jacobian: Array) -> Array:
    """Return the scale that the residual of each constraint is compared with.

    ``max(1, |Dh_i|, |Dh_i|^2 / 4)``: the second makes it a distance in units of q, the third is the square
    of a `Distance`'s length, whose rounding the residual cannot fall below.
    """
    # Of numbers near the largest double the scale is infinite.
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(jacobian, axis=1)
        scales: Array = np.maximum(np.maximum(1.0, norms), norms**2 / 4.0)
    return scales


def free_variables(mechanism: Mechanism, hold: Sequence[str], move_kinematic: bool = False) -> Indices:
    """Return the indices in q of the variables that may move: the dynamic ones that are not held.

    ``hold``: variables that must not move, or joints whose rotation is a quaternion. ``move_kinematic``: let the
    kinematic variables move too. Raises `ArgumentError` for an unknown name.
    """
    turns = {rotation.name: rotation.variables for rotation in mechanism.tree.rotations}
    hold = [each for name in as_names(hold, "hold", "variables") for each in turns.get(name, (name,))]
    as_flag(move_kinematic, "move_kinematic")
    for name in hold:
        if name not in mechanism.variables:
            raise unknown("variable", name, mechanism.variables, "hold")
    count = mechanism.nv if move_kinematic else mechanism.nd
    held = set(hold)
    return np.array([i for i, name in enumerate(mechanism.variables[:count]) if name not in held], dtype=np.intp)


def all_finite(*arrays: Array) -> bool:
    """Whether no entry is a NaN or an infinity."""
    return all(bool(np.isfinite(array).all()) for array in arrays)


def restoring(jacobian: Array, h: Array) -> Array:
    """Return the least change that brings the constraints to zero, to first order: ``-A^+ h``."""
    return np.asarray(np.linalg.lstsq(jacobian, -h, rcond=RANK_TOLERANCE)[0], dtype=np.float64)


@dataclass(frozen=True)
class NullSpace:
    """The pseudo-inverse A^+ (n, nc) of a Jacobian A (nc, n), and a basis Z (n, nf) of its null space."""

    inverse: Array
    basis: Array

    @classmethod
    def of(cls, jacobian: Array, h: Array | None = None) -> NullSpace:
        """Split the variables of a Jacobian into those across the constraints and those along them.

        ``jacobian`` (nc, n). ``h`` (nc,): the residual, beside the constraints. Equations that are redundant on the
        constraints need not be so there: A has singular values of the size of the distance. They are noise, and what
        they belong to is a direction along the constraints; so singular values below a multiple of |h| count as zero
        where h has next to no part in them.
        """
        nc, n = jacobian.shape
        if not jacobian.size:
            return cls(np.zeros((n, nc)), np.eye(n))
        left, sizes, right = np.linalg.svd(jacobian)
        rank = int(np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes[0])))
        if h is not None:
            parts, size = left.T @ h, float(np.linalg.norm(h))
            bound = min(LOOSE_RANK_TOLERANCE * sizes[0], _LOOSENING * size)
            while rank and sizes[rank - 1] < bound and np.linalg.norm(parts[rank - 1 :]) < _LEFT * size:
                rank -= 1
        inverse = (right[:rank].T / sizes[:rank]) @ left[:, :rank].T
        return cls(inverse, right[rank:].T)

    def multiplier(self, slope: Array) -> Array:
        """Return the multiplier (nc,) of least norm for which ``slope + A^T lam`` is smallest."""
        return -self.inverse.T @ slope

    def reduced(self, matrix: Array) -> Array:
        """Return ``Z^T B Z``, (nf, nf)."""
        return self.basis.T @ matrix @ self.basis
