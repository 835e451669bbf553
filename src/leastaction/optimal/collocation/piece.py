"""The linear equations of a piece: what Newton's method solves, and how its points follow its start and its inputs."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.mesh import MATRIX, STAGES
from leastaction.optimal.quantity import Instants

Factors = tuple[Array, Instants]
"""Triangular factors of a matrix, and how their rows were exchanged."""


def newton_matrix(h: Array | float, A: Array) -> Array:
    """Return ``1 - h MATRIX A`` of the points of a piece (..., STAGES, nx, nx), (..., STAGES nx, STAGES nx)."""
    size = STAGES * A.shape[-1]
    coupled = np.einsum("ij,...jab->...iajb", MATRIX, A)
    return np.asarray(np.eye(size) - h * coupled.reshape(*A.shape[:-3], size, size))


def slopes_of_points(matrices: Array, h: Array, B: Array) -> Array:
    """Return the derivatives (N, STAGES, nx, nx + STAGES nu) of the states of points by the start and all inputs.

    ``matrices``: Newton's. ``h`` (N, 1, 1): lengths. ``B`` (N, STAGES, nx, nu).
    """
    N, _, nx, nu = B.shape
    pushed = h * np.einsum("ij,njab->niajb", MATRIX, B).reshape(N, STAGES * nx, STAGES * nu)
    start = np.broadcast_to(np.tile(np.eye(nx), (STAGES, 1)), (N, STAGES * nx, nx))
    moved = np.concatenate([start, pushed], axis=2)
    return solved_each(matrices, moved).reshape(N, STAGES, nx, nx + STAGES * nu)


def factored(matrix: Array) -> Factors:
    """Return the triangular factors of a matrix; `ArithmeticError` of a singular one."""
    from scipy.linalg.lapack import dgetrf

    factors, pivots, info = dgetrf(matrix)
    if info:
        raise ArithmeticError("its equations are singular")
    return factors, pivots


def solved(factors: Factors, right: Array) -> Array:
    """Return what a factored matrix takes to the right side."""
    from scipy.linalg.lapack import dgetrs

    return np.asarray(dgetrs(*factors, right)[0])


def solved_each(matrices: Array, right: Array) -> Array:
    """Return what matrices (N, n, n) take to right sides (N, n, m); `ArithmeticError` of a singular one."""
    try:
        return np.asarray(np.linalg.solve(matrices, right))
    except np.linalg.LinAlgError:
        raise ArithmeticError("its equations are singular") from None
