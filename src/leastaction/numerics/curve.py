"""Smooth curves: what a nonlinear spring, a muscle or a cam is given by."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from types import FrameType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError, SwingWarning, brief
from leastaction.numerics.arrays import Array, as_array, as_choice, as_count, as_number
from leastaction.numerics.hermite import monotone, quintics, suggested_curvatures

_DEGREE = 5
Between = Literal["smooth", "monotone"]
# Parts of the range of two points and their neighbours, and of all points, by which a curve may leave it: samples of
# smooth functions, three a wave, stay within them.
_SWING, _SWING_OF_ALL = 1.0, 0.01
_MISSED = 1e-6  # of the largest value, by which a curve may miss its points
_INSIDE = np.linspace(0.0, 1.0, 12)[1:-1]  # of the way from one point to the next


class Curve:
    """A smooth function of one variable through given points: an interpolating quintic spline.

    Four derivatives are continuous, so a force from it has all the derivatives that Newton's method and
    the second order of a step use. Up to six points are met by the one polynomial through them, which is
    smooth everywhere. Where points are few, uneven or have a kink it swings: then say slopes too, or choose
    ``between="monotone"``, which never leaves the values of its neighbours. Both are quintics with two
    continuous derivatives, as many as the second order of a step asks of a force. Outside of the points the
    first and the last piece carry on, so give points as far as the motion goes: a polynomial that is left to
    itself soon grows.

    Parameters
    ----------
    x : array_like, shape (n,)
        Places, two at least, strictly increasing.
    y : array_like, shape (n,)
        Values there.
    slopes : array_like, shape (n,), optional
        First derivatives there.
    curvatures : array_like, shape (n,), optional
        Second derivatives there, beside slopes; if left out those that the slopes suggest.
    between : {"smooth", "monotone"}, optional
        What stands between points of which values alone are given: the smoothest, or what rises and falls only as
        the points do.

    Attributes
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Where the pieces begin and the last one ends.
    coefficients : ndarray, shape (pieces, degree + 1)
        Of every piece in ascending powers of ``x - breaks[i]``.

    Raises
    ------
    DescriptionError
        If the points are fewer than two, not finite, not increasing or of different number, if curvatures come
        without slopes, or either with ``between="monotone"``.

    Warns
    -----
    SwingWarning
        If it swings: where between two points it leaves the range of those two and their neighbours by as much again.

    Notes
    -----
    Immutable, so any number of threads may share it. The spline is SciPy's `make_interp_spline` with its
    not-a-knot ends.
    """

    __slots__ = ("breaks", "coefficients")

    breaks: Array
    coefficients: Array

    def __init__(
        self,
        x: ArrayLike,
        y: ArrayLike,
        *,
        slopes: ArrayLike | None = None,
        curvatures: ArrayLike | None = None,
        between: Between = "smooth",
    ) -> None:
        places = as_array(x, "Curve: x", (None,), error=DescriptionError)
        if len(places) < 2:
            raise DescriptionError(
                f"Curve: got {len(places)} point{'s'[: len(places) != 1]}; expected two at least, and "
                "more than six for a spline"
            )
        values = as_array(y, "Curve: y", (len(places),), error=DescriptionError)
        back = places[1:] <= places[:-1]
        if np.any(back):
            k = int(np.argmax(back))
            raise DescriptionError(
                f"Curve: x must increase strictly, but x[{k}] = {places[k]:g} is followed by "
                f"x[{k + 1}] = {places[k + 1]:g}; sort the points and name each place once"
            )
        as_choice(between, "Curve: between", get_args(Between), error=DescriptionError)
        given = {"slopes": slopes, "curvatures": curvatures}
        named = [name for name, value in given.items() if value is not None]
        if named and (between == "monotone" or slopes is None):
            other = "between='monotone', which finds them" if between == "monotone" else "no slopes, which they need"
            raise DescriptionError(f"Curve: got {' and '.join(named)} and {other}")
        number = (len(places),)
        first, second = (
            None if value is None else as_array(value, f"Curve: {name}", number, error=DescriptionError)
            for name, value in given.items()
        )
        # Numbers near one, in units that are powers of two: none overflows on the way, and none is rounded by it.
        u, w = _exponent(places), _exponent(values)
        with np.errstate(all="ignore"):
            x1, y1 = np.ldexp(places, -u), np.ldexp(values, -w)
            if between == "monotone":
                pieces = x1, quintics(x1, y1, *monotone(x1, y1))
            elif first is not None:
                first = np.ldexp(first, u - w)
                second = suggested_curvatures(x1, y1, first) if second is None else np.ldexp(second, 2 * u - w)
                pieces = x1, quintics(x1, y1, first, second)
            else:
                pieces = _spline(x1, y1)
            powers = np.arange(pieces[1].shape[1])
            self._set(np.ldexp(pieces[0], u), np.ldexp(pieces[1], w - u * powers))
            missed = np.abs(np.ldexp(self(np.nextafter(places[1:], places[:-1])), -w) - y1[1:])
        if not np.all(missed <= _MISSED):
            raise DescriptionError(
                f"Curve: polynomials through these {len(places)} points, x from {places[0]:g} to {places[-1]:g} and "
                f"y up to {np.abs(values).max():g} in size, are beyond what numbers can hold; choose other units, or "
                "points that are less uneven"
            )
        _tell_of_swings(_restore(*pieces), x1, y1, u, w)

    @classmethod
    def from_function(cls, function: Callable[[float], float], start: float, end: float, *, pieces: int = 32) -> Curve:
        """Return the curve through equally spaced points of a function.

        Parameters
        ----------
        function : callable
            Takes a float and returns one.
        start, end : float
            The range.
        pieces : int, optional
            How many spaces lie between the points.

        Raises
        ------
        DescriptionError
            If the range is empty, there is no piece, or a value is not a finite number.
        """
        first = as_number(start, "Curve: start", error=DescriptionError)
        last = as_number(end, "Curve: end", error=DescriptionError)
        if not 0.0 < last - first < np.inf:
            raise DescriptionError(
                f"Curve: got start {first:g} and end {last:g}; expected start < end, a finite way apart"
            )
        number = as_count(pieces, "Curve: pieces", 1, error=DescriptionError)
        if not callable(function):
            raise DescriptionError(f"Curve: function: got {brief(repr(function))}, expected a function of one number")
        places = np.linspace(first, last, number + 1)
        values = [
            as_number(function(float(x)), f"Curve: the function at {x:g}", error=DescriptionError) for x in places
        ]
        return cls(places, values)

    @classmethod
    def from_pieces(cls, breaks: ArrayLike, coefficients: ArrayLike) -> Curve:
        """Return the curve of given polynomials, as its `breaks` and `coefficients` are.

        Parameters
        ----------
        breaks : array_like, shape (pieces + 1,)
            Where the pieces begin and the last one ends, strictly increasing.
        coefficients : array_like, shape (pieces, degree + 1)
            Of every piece in ascending powers of ``x - breaks[i]``.

        Raises
        ------
        DescriptionError
            If a number is not finite, the places do not increase, or there are not as many pieces as places between.
        """
        places = as_array(breaks, "Curve: breaks", (None,), error=DescriptionError)
        pieces = as_array(coefficients, "Curve: coefficients", (max(len(places) - 1, 1), None), error=DescriptionError)
        if len(places) < 2 or np.any(places[1:] <= places[:-1]) or pieces.shape[1] == 0:
            raise DescriptionError("Curve: expected two breaks at least that increase strictly, and coefficients")
        return _restore(places, pieces)

    @property
    def start(self) -> float:
        """Where the given points begin."""
        return float(self.breaks[0])

    @property
    def end(self) -> float:
        """Where the given points end."""
        return float(self.breaks[-1])

    def __call__(self, x: ArrayLike, derivative: int = 0) -> Any:
        """Return the value, or a derivative, at places of any shape: a float for a single place.

        ``x``: places. ``derivative``: order of the derivative.
        """
        order = as_count(derivative, "Curve: derivative (integral() goes the other way)", 0)
        if not isinstance(x, (float, np.ndarray)) or getattr(x, "dtype", None) not in (None, np.dtype(np.float64)):
            x = as_array(x, "Curve: x")
        values = self._polynomial()(np.asarray(x, dtype=np.float64), order)
        return float(values) if values.ndim == 0 else values

    def integral(self) -> Curve:
        """Return the curve of the integral from the start: the energy of a curve of force."""
        whole = self._polynomial().antiderivative()
        return _restore(whole.x, whole.c[::-1].T)

    def _polynomial(self) -> Any:
        """Return it as SciPy has piecewise polynomials."""
        from scipy.interpolate import PPoly  # slow to import

        # Copies: older versions of SciPy cannot integrate what is read-only.
        return PPoly(self.coefficients.T[::-1].copy(), self.breaks.copy())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Curve):
            return NotImplemented
        return np.array_equal(self.breaks, other.breaks) and np.array_equal(self.coefficients, other.coefficients)

    def __hash__(self) -> int:
        return hash((self.breaks.tobytes(), self.coefficients.tobytes()))

    def __setattr__(self, field: str, value: object) -> None:
        raise AttributeError(f"a Curve is immutable ({field} cannot be set); make a new one")

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.breaks, self.coefficients)

    def __repr__(self) -> str:
        pieces, terms = self.coefficients.shape
        return f"<Curve from {self.start:g} to {self.end:g}: {pieces} piece{'s'[: pieces != 1]} of degree {terms - 1}>"

    def _set(self, breaks: Array, coefficients: Array) -> None:
        for name, array in (("breaks", breaks), ("coefficients", coefficients)):
            own = np.array(array, order="C")
            own.setflags(write=False)
            object.__setattr__(self, name, own)


def _spline(x: Array, y: Array) -> tuple[Array, Array]:
    """Return breaks and coefficients of the quintic spline through points, or of the polynomial through few.

    The coefficients are not numbers where the points are too uneven for one.
    """
    # Here, so that to import the package is quick.
    from scipy.interpolate import PPoly, make_interp_spline

    degree = min(_DEGREE, len(x) - 1)
    # One polynomial has no knots inside, which older versions of SciPy must be told for even degrees.
    knots = np.repeat(x[[0, -1]], degree + 1) if len(x) == degree + 1 else None
    try:
        pieces = PPoly.from_spline(make_interp_spline(x, y, k=degree, t=knots))
    except ValueError:  # a matrix that is singular, or places that are one in these units
        return x, np.full((len(x) - 1, 1), np.nan)
    # A spline repeats the knots at its ends, which makes pieces of no width.
    wide = np.diff(pieces.x) > 0.0
    return np.append(pieces.x[:-1][wide], pieces.x[-1]), pieces.c[::-1, wide].T


def _tell_of_swings(curve: Curve, x: Array, y: Array, u: int, w: int) -> None:
    """Warn where a curve between two points is far from them and their neighbours; in units of ``2**u``, ``2**w``."""
    ends = np.concatenate([[y[0]], y, [y[-1]]])
    near = np.lib.stride_tricks.sliding_window_view(ends, 4)
    least, most = near.min(axis=1), near.max(axis=1)
    allowed = _SWING * (most - least) + _SWING_OF_ALL * np.ptp(y)
    inside = x[:-1, None] + np.diff(x)[:, None] * _INSIDE
    found = np.asarray(curve(inside))
    off = np.maximum(found - most[:, None], least[:, None] - found) - allowed[:, None]
    if not np.any(off > 1e-9 * np.abs(y).max()):
        return
    i, k = np.unravel_index(int(np.argmax(off)), off.shape)
    with np.errstate(over="ignore", under="ignore"):
        between, given = np.ldexp(x[i : i + 2], u), np.ldexp([*y[i : i + 2], found[i, k]], w)
    warnings.warn(
        f"Curve: between x = {between[0]:g} and {between[1]:g}, where y = {given[0]:g} and {given[1]:g} are given, it "
        f"goes to {given[2]:.3g}: it swings. Choose between='monotone', give slopes=, or more points where it bends",
        SwingWarning,
        stacklevel=_outside(),
    )


def _exponent(numbers: Array) -> int:
    """Return which power of two is near the largest of some numbers."""
    return int(np.frexp(np.abs(numbers).max())[1])


def _outside() -> int:
    """Return the stack level of who made the curve, of a warning in `_tell_of_swings`."""
    level = 1
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__") == __name__:
        level, frame = level + 1, frame.f_back
    return level


def _restore(breaks: Array, coefficients: Array) -> Curve:
    curve = Curve.__new__(Curve)
    curve._set(breaks, coefficients)
    return curve
