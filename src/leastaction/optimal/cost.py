"""What costs share in either kind of time: weights, checked and owned, and their products with deviations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import NOT_YET, ArgumentError
from leastaction.numerics.arrays import Array, as_array, read_only, shape_of
from leastaction.optimal.space import StateSpace
from leastaction.optimal.system import System

# What of a weight's size its least eigenvalue may be below zero by rounding.
_SEMI = 1e-12


def owned(value: ArrayLike, what: str) -> Array:
    """Return a copy of finite numbers that cannot be written to: what the caller changes later changes nothing."""
    return read_only(as_array(value, what).copy())


def owned_row(value: ArrayLike, what: str) -> Array:
    """Return the same, where a number stands for a row of one, as of a single input."""
    return read_only(np.atleast_1d(as_array(value, what)).copy())


def is_diagonal(weight: Array) -> bool:
    """Whether a weight is a diagonal: (n,), or (N, n, 1) with one for each stage."""
    return weight.ndim == 1 or (weight.ndim == 3 and weight.shape[2] == 1)


def as_weight(value: ArrayLike, what: str, n: int, *, stages: int | None = None, definite: bool) -> Array:
    """Return a weight of n entries, checked, and owned.

    ``value``: a diagonal (n,) or a matrix (n, n); with `stages` also a diagonal (N, n) or (N, n, 1) or a matrix (N, n,
    n) for each stage. An array (n, n) is a matrix, whatever N is. ``what``: its name, for messages. ``n``, ``stages``:
    sizes; of one entry a number will do. ``definite``: whether it must be positive definite, not only semidefinite.
    Returns (n,), (n, n), (N, n, 1) or (N, n, n). Raises `ArgumentError`: a wrong shape, values that are not finite, a
    matrix that is not symmetric, or not definite.
    """
    shapes: list[tuple[int, ...]] = [(n,), (n, n)]
    if stages is not None:
        shapes += [(stages, n), (stages, n, 1), (stages, n, n)]
    weight = as_array([value] if n == 1 and shape_of(value) == () else value, what, *shapes)
    if weight.ndim == 2 and weight.shape != (n, n):
        weight = weight[:, :, None]
    weight = weight.copy()
    check_weight(weight, what, definite=definite)
    if not is_diagonal(weight):
        weight = 0.5 * (weight + np.swapaxes(weight, -1, -2))
    return read_only(weight)


def check_weight(weight: Array, what: str, *, definite: bool) -> None:
    """Complain unless a weight is symmetric and positive (semi)definite, at every stage."""
    diagonal = is_diagonal(weight)
    if not diagonal:
        skew = float(np.abs(weight - np.swapaxes(weight, -1, -2)).max(initial=0.0))
        if skew > 1e-12 * float(np.abs(weight).max(initial=0.0)):
            raise ArgumentError(
                f"{what}: got a matrix that differs from its transpose by {skew:.3g}, expected a "
                "symmetric one. Use (W + W.T) / 2."
            )
    spectrum = weight if diagonal else np.linalg.eigvalsh(weight)
    smallest = float(spectrum.min(initial=np.inf))
    largest = float(np.abs(spectrum).max(initial=0.0))
    if smallest < (0.0 if diagonal else -1e-12 * largest) or (definite and smallest <= 0.0):
        advice = f"Give every input a weight above zero; {NOT_YET}." if definite else "Weights cannot be negative."
        raise ArgumentError(
            f"{what}: got a smallest eigenvalue of {smallest:.3g}, expected a positive "
            f"{'definite' if definite else 'semidefinite'} weight. {advice}"
        )


def weigh(weight: Array, d: Array) -> Array:
    """Return a weight times each row of d (N, n): (n,), (n, n), or (N, n, 1), (N, n, n) with one for each row."""
    if weight.ndim == 1:
        result: Array = d * weight
    elif weight.ndim == 2:
        result = d @ weight
    elif weight.shape[2] == 1:
        result = d * weight[:, :, 0]
    else:
        result = np.einsum("kij,kj->ki", weight, d)
    return result


def clipped(weight: Array) -> Array:
    """Return a weight whose eigenvalues below zero are zero; itself where there are none."""
    if is_diagonal(weight):
        return weight if (weight >= 0.0).all() else np.maximum(weight, 0.0)
    size = np.abs(np.diagonal(weight, axis1=-2, axis2=-1)).max(axis=-1, initial=0.0)
    raised = weight.copy()
    places = np.arange(weight.shape[-1])
    raised[..., places, places] += (_SEMI * size + np.finfo(np.float64).tiny)[..., None]
    try:
        np.linalg.cholesky(raised)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(weight)
        return np.asarray((vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2))
    return weight


def matrix_of(weight: Array) -> Array:
    """Return a weight as matrices: (n, n), or (N, n, n) with one for each stage."""
    if not is_diagonal(weight):
        return weight
    return np.diag(weight) if weight.ndim == 1 else weight * np.eye(weight.shape[1])


def widened(weight: Array, moved: Callable[[Array], Array]) -> Array:
    """Return a weight by other entries, into which ``moved`` takes rows (..., n): a diagonal remains one."""
    if weight.ndim == 1:
        return moved(weight)
    if is_diagonal(weight):
        return moved(weight[:, :, 0])[:, :, None]
    return across(moved(weight), moved)


def diagonal_of(weight: Array) -> Array:
    """Return the diagonal (n,), or (N, n), of a weight, to be written to."""
    if weight.ndim == 1:
        return weight
    return weight[:, :, 0] if is_diagonal(weight) else np.einsum("...ii->...i", weight)


def across(matrices: Array, moved: Callable[[Array], Array]) -> Array:
    """Return matrices (..., n, m) whose columns are moved, as `widened` moves rows."""
    return np.ascontiguousarray(np.swapaxes(moved(np.swapaxes(matrices, -1, -2)), -1, -2))


def own_matrices(weight: Array, shape: tuple[int, ...]) -> Array:
    """Return a copy of matrices (n, n) or (N, n, n), for every stage of a shape.

    Stage after stage in memory: by itself a copy of one matrix for all of them has the stages innermost.
    """
    return np.array(np.broadcast_to(weight, shape), order="C")


def final_of(weight: Array) -> Array:
    """Return the last of a weight's stages (or the weight, if it is constant)."""
    if weight.ndim < 3:
        return weight
    last: Array = weight[-1]
    return last[:, 0] if last.shape[1] == 1 else last


def check_space(cost: Any, system: System) -> None:
    """Complain about a quadratic cost that subtracts states which are no plain vectors, within others or alone.

    Raises `ArgumentError`: saying what to give.
    """
    whole = system.charts()
    while whole is not None and cost is not None:
        if hasattr(cost, "space") and cost.space is None:
            raise ArgumentError(
                f"cost: got a {type(cost).__name__} that subtracts states, expected one over those of "
                f"{type(system).__name__}, which are no plain vectors: give it space=system"
            )
        cost = getattr(cost, "cost", None)


class Deviations(NamedTuple):
    """Derivatives of half the weighted squares of differences, by the states that these lead to.

    ``gradient`` (n, ndx). ``squares`` (n, ndx, ndx): Gauss and Newton's part of the second ones. ``bend`` (n, ndx,
    ndx): the rest, of the differences' own.
    """

    gradient: Array
    squares: Array
    bend: Array


def deviations(space: StateSpace, weight: Array, x: Array, wanted: Array) -> Deviations:
    """Return them for states x (n, nx) and a weight as of `weigh`."""
    pull = weigh(weight, space.difference(x, wanted))
    squares = own_matrices(matrix_of(weight), (len(x), space.ndx, space.ndx))
    bend, gradient = space.difference_curvature(x, wanted, pull), pull.copy()
    curved = np.flatnonzero(space.curved)
    if len(curved):
        # Elsewhere the derivative is the identity.
        J = space.difference_derivative(x, wanted)[:, curved[:, None], curved]
        squares[:, :, curved] = squares[:, :, curved] @ J
        squares[:, curved] = np.swapaxes(J, 1, 2) @ squares[:, curved]
        gradient[:, curved] = (pull[:, None, curved] @ J)[:, 0]
    return Deviations(gradient, squares, bend)
