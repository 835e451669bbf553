"""Functions of time as piecewise polynomials, and the mesh on which they are sampled.

A piece of degree 7 is stored by its Chebyshev coefficients. They are found from the values at the
Chebyshev points inside of the piece, never at its ends, so a function may jump between two pieces;
and the size of the last ones tells whether a piece is short enough.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_choice, as_count, as_number, as_times
from leastaction.numerics.public import public

Through = Literal["linear", "hold", "cubic"]
"""How a function goes from one sample to the next."""

POINTS = 8
"""Coefficients of a piece; the interpolants of the integrators have no higher degree than 7."""

_ABSCISSAE = chebyshev.chebpts1(POINTS)
# Coefficients from values at these points.
_TRANSFORM = np.linalg.inv(chebyshev.chebvander(_ABSCISSAE, POINTS - 1))
# Fejer's weights: they integrate a piece over [-1, 1].
_WEIGHTS = chebyshev.chebval(1.0, chebyshev.chebint(_TRANSFORM, lbnd=-1.0))

# Halvings of a piece before it is taken as it is.
_MOST_HALVINGS = 12

# Pieces of a mesh: beyond that it is noise that is being resolved.
_MOST_PIECES = 20_000


@public
class PiecewisePolynomial:
    """A function of time, ``f(t)``, of any shape; continuous from the right where it jumps.

    Parameters
    ----------
    breaks : ndarray (n+1,)
        Ends of the pieces (s), increasing.
    coefficients : ndarray (n, degrees, size)
        Chebyshev coefficients of each piece over [-1, 1].
    shape : tuple of int
        Shape of a value; its product is `size`.

    Notes
    -----
    Nothing in it changes, so any number of threads may share it.
    """

    def __init__(self, breaks: Array, coefficients: Array, shape: tuple[int, ...]) -> None:
        self.breaks = breaks
        self.coefficients = coefficients
        self.shape = shape
        self._inner: list[float] = breaks[1:-1].tolist()
        self._middle: list[float] = (0.5 * (breaks[1:] + breaks[:-1])).tolist()
        self._scale: list[float] = (2.0 / np.diff(breaks)).tolist()
        self._degrees = np.arange(coefficients.shape[1], dtype=np.float64)

    @classmethod
    def constant(cls, value: ArrayLike, t0: float, tf: float) -> PiecewisePolynomial:
        """Return a constant over ``[t0, tf]``."""
        array = as_array(value, "value")
        t0, tf = as_number(t0, "t0"), as_number(tf, "tf")
        return cls(np.array([t0, tf]), array.reshape(1, 1, -1).copy(), array.shape)

    @classmethod
    def through(cls, t: ArrayLike, values: ArrayLike, *, kind: Through = "cubic") -> PiecewisePolynomial:
        """Return a function through samples.

        Parameters
        ----------
        t : array_like (n+1,)
            Times (s), increasing.
        values : array_like (n+1, ...) or, for "hold", (n, ...)
            Samples, time first.
        kind : {"linear", "hold", "cubic"}
            Straight lines; each value held until the next time; or the spline with two continuous
            derivatives (not-a-knot ends; with fewer than four samples the parabola or the line).

        Raises
        ------
        ArgumentError
            Times that do not increase, or values that do not fit them or are not finite.
        """
        times = as_times(t)
        as_choice(kind, "kind", get_args(Through))
        samples = as_array(values, "values")
        wanted = times.size - (kind == "hold")
        if samples.ndim < 1 or samples.shape[0] != wanted:
            raise ArgumentError(
                f"values: got shape {samples.shape}, expected ({wanted}, ...): one per "
                f"{'interval' if kind == 'hold' else 'time'}."
            )
        shape = samples.shape[1:]
        flat = samples.reshape(wanted, -1)
        if kind == "hold":
            return cls(times, flat[:, None, :].copy(), shape)
        if kind == "linear":
            middle, half = 0.5 * (flat[1:] + flat[:-1]), 0.5 * (flat[1:] - flat[:-1])
            return cls(times, np.stack([middle, half], axis=1), shape)
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(times, flat)
        mesh = Mesh(times)
        return mesh.fit(np.asarray(spline(mesh.t)), shape)

    @property
    def t0(self) -> float:
        """First time (s)."""
        return float(self.breaks[0])

    @property
    def tf(self) -> float:
        """Last time (s)."""
        return float(self.breaks[-1])

    def flat(self, t: float) -> Array:
        """Return the value at a time as a vector; beyond the ends, the value there."""
        # In every evaluation of a feedback: a cosine takes a fifth of what NumPy's own recursion does.
        i = bisect_right(self._inner, t)
        s = (t - self._middle[i]) * self._scale[i]
        angle = math.acos(-1.0 if s < -1.0 else 1.0 if s > 1.0 else s)
        value: Array = np.cos(angle * self._degrees) @ self.coefficients[i]
        return value

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times of any shape: an array of shape ``t.shape + shape``."""
        times = np.asarray(t, dtype=np.float64)
        if times.ndim == 0:
            return self.flat(float(times)).reshape(self.shape)
        i = np.searchsorted(self.breaks[1:-1], times.ravel(), side="right")
        s = (times.ravel() - np.asarray(self._middle)[i]) * np.asarray(self._scale)[i]
        basis = chebyshev.chebvander(np.clip(s, -1.0, 1.0), self.coefficients.shape[1] - 1)
        if len(i) > 2 * len(self.coefficients) and (np.diff(i) >= 0).all():
            # Many times per piece: one product for each piece, instead of a copy for each time.
            values = np.empty((len(i), self.coefficients.shape[2]))
            ends = np.searchsorted(i, np.arange(len(self.coefficients) + 1))
            for piece, (begin, end) in enumerate(itertools.pairwise(ends.tolist())):
                values[begin:end] = basis[begin:end] @ self.coefficients[piece]
        else:
            values = np.einsum("nk,nkm->nm", basis, self.coefficients[i])
        return values.reshape(times.shape + self.shape)

    def derivative(self, order: int = 1) -> PiecewisePolynomial:
        """Return the derivative of an order by time."""
        if as_count(order, "order", 0) == 0:
            return self
        slopes = chebyshev.chebder(self.coefficients, axis=1) * np.asarray(self._scale)[:, None, None]
        return PiecewisePolynomial(self.breaks, slopes, self.shape).derivative(order - 1)

    def jumps(self) -> tuple[float, ...]:
        """Return the times (s) between pieces at which the value or its slope jumps."""
        slopes = self.derivative()
        there = self._steps(1e-6) | slopes._steps(1e-3)
        return tuple(self.breaks[1:-1][there].tolist())

    def _steps(self, share: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return between which pieces the value jumps by more than a share of its size."""
        signs = (-1.0) ** np.arange(self.coefficients.shape[1])
        left = self.coefficients[:-1].sum(axis=1)
        right = np.einsum("k,nkm->nm", signs, self.coefficients[1:])
        size = np.abs(self.coefficients).max(axis=(0, 1), initial=0.0)
        result: np.ndarray[tuple[int], np.dtype[np.bool_]] = (np.abs(right - left) > share * size).any(axis=1)
        return result

    def part(self, index: ArrayLike, shape: tuple[int, ...]) -> PiecewisePolynomial:
        """Return the function made of the entries `index` (of the flat value), in a shape."""
        columns = np.asarray(index).ravel()
        chosen = np.ascontiguousarray(self.coefficients[:, :, columns])
        return PiecewisePolynomial(self.breaks, chosen, shape)


class Mesh:
    """The points of every piece.

    ``breaks`` (n+1,): ends of the pieces (s), increasing. ``t`` (n * POINTS,): times of the points, increasing.
    ``weights`` (n * POINTS,): weights that integrate a function sampled there.
    """

    def __init__(self, breaks: Array) -> None:
        self.breaks = breaks
        half = 0.5 * np.diff(breaks)[:, None]
        middle = 0.5 * (breaks[1:] + breaks[:-1])[:, None]
        self.t: Array = (middle + half * _ABSCISSAE).ravel()
        self.weights: Array = (half * _WEIGHTS).ravel()

    def fit(self, values: Array, shape: tuple[int, ...]) -> PiecewisePolynomial:
        """Return the function with these values (n * POINTS, ...) at the points."""
        return PiecewisePolynomial(self.breaks, self.coefficients(values), shape)

    def coefficients(self, values: Array) -> Array:
        """Return the Chebyshev coefficients (n, POINTS, size) of values at the points."""
        pieces = values.reshape(len(self.breaks) - 1, POINTS, -1)
        result: Array = _TRANSFORM @ pieces
        return result

    def coarse(
        self, values: Array, tolerance: float, least: Array | None = None
    ) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which pieces are too long for values (n * POINTS, size) sampled on them, (n,).

        The error of an entry is relative to the largest size that it takes anywhere, to a millionth of
        the largest size of any entry, or to `least` (size,), whichever is most.
        """
        coefficients = np.abs(self.coefficients(values))
        size = coefficients.max(axis=(0, 1), initial=0.0)
        size = np.maximum(size, 1e-6 * size.max(initial=0.0)) + 1e-300
        if least is not None:
            size = np.maximum(size, least)
        # The coefficients fall about geometrically: the first one left out is smaller than the last.
        tail = np.maximum(coefficients[:, -1], 0.1 * coefficients[:, -2])
        result: np.ndarray[tuple[int], np.dtype[np.bool_]] = (tail > tolerance * size).any(axis=1)
        return result

    def refined(self, coarse: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Mesh:
        """Return the mesh with these pieces halved."""
        middles = 0.5 * (self.breaks[1:] + self.breaks[:-1])
        return Mesh(np.sort(np.concatenate([self.breaks, middles[coarse]])))


def approximate(
    function: Callable[[Array], Array], mesh: Mesh, tolerance: float, least: Array | None = None
) -> tuple[Mesh, Array]:
    """Sample a function on a mesh that is fine enough for it.

    ``function``: ``function(t)`` returns values (n, size) at times (n,). ``mesh``: where to begin; pieces are halved as
    long as that is needed and helps. ``tolerance``: relative error that is allowed. ``least`` (size,): sizes that
    errors are relative to where the values are smaller, as differences of larger terms. Returns ``mesh``, ``values``
    (len(mesh.t), size).
    """
    values = function(mesh.t)
    for _ in range(_MOST_HALVINGS):
        coarse = mesh.coarse(values, tolerance, least)
        if not coarse.any():
            break
        finer = mesh.refined(coarse)
        if len(finer.breaks) > _MOST_PIECES:
            break
        fresh = np.isin(finer.breaks[:-1], mesh.breaks[:-1][~coarse], invert=True)
        points = np.repeat(fresh, POINTS)
        new = np.empty((len(finer.t), *values.shape[1:]))
        new[points] = function(finer.t[points])
        new[~points] = values[np.repeat(~coarse, POINTS)]
        mesh, values = finer, new
    return mesh, values
