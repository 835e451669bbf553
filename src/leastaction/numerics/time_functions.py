"""Functions of time, one for all that is given as such: inputs, prescribed motions, weights, references.

What a user gives, a constant, samples, a `PiecewisePolynomial` or a callable, is a `TimeFunction` inside. A law also
takes the state (`StateLaw`), and a `Curve` is no function of time but of a place.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.piecewise import PiecewisePolynomial

TimeFunctionLike = ArrayLike | PiecewisePolynomial | Callable[[float], ArrayLike]
"""A constant array, a `PiecewisePolynomial`, or a function of one time (s)."""


class TimeFunction:
    """An array that may change with time.

    ``value``: what was given. ``name``: the argument's, for messages. ``row``: whether a number stands for a row of
    one, as of a single input. Raises `ArgumentError`: a constant that is not an array of finite numbers.
    """

    __getstate__, __setstate__ = saved_state, restore_state

    def __init__(self, value: TimeFunctionLike, name: str, *, row: bool = False) -> None:
        self.name, self._row = name, row
        self.jumps: tuple[float, ...] = ()
        self._constant: Array | None = None
        self._curve: PiecewisePolynomial | None = None
        self._function: Callable[[float], ArrayLike] | None = None
        if isinstance(value, PiecewisePolynomial):
            self._curve = value if value.shape or not row else value.part([0], (1,))
            self.jumps = value.jumps()
        elif callable(value):
            self._function = value
        else:
            constant = as_array(value, name)
            self._constant = read_only((np.atleast_1d(constant) if row else constant).copy())

    @property
    def is_constant(self) -> bool:
        """Whether it never changes."""
        return self._constant is not None

    def at(self, t: float) -> Array:
        """Return the value at a time."""
        if self._constant is not None:
            return self._constant
        if self._curve is not None:
            return self._curve.flat(t).reshape(self._curve.shape)
        assert self._function is not None
        found = np.asarray(self._function(t), dtype=np.float64)
        return np.atleast_1d(found) if self._row else found

    def samples(self, t: Array) -> Array:
        """Return the values at times (n,): (n, ...)."""
        if self._constant is not None:
            return np.broadcast_to(self._constant, (len(t), *self._constant.shape))
        if self._curve is not None:
            return self._curve(t)
        return np.stack([self.at(float(time)) for time in t])

    def check(self, t0: float, tf: float, *shapes: tuple[int, ...], what: str) -> Array:
        """Complain unless the values over [t0, tf] have one of the shapes and are finite.

        Returns
        -------
        ndarray (n, ...)
            A few values over the interval; one if it is constant.
        """
        if self._constant is not None:
            return as_array(self._constant, self.name, *shapes, meaning=what)[None]
        values = []
        for t in np.linspace(t0, tf, 7):
            try:
                value = self.at(float(t))
            except (TypeError, ValueError, OverflowError) as error:
                raise ArgumentError(
                    f"{self.name}: at t = {t:g} s it is not an array of numbers ({error}); expected "
                    f"one of shape {what}."
                ) from error
            values.append(as_array(value, f"{self.name} at t = {t:g} s", *shapes, meaning=what))
        return np.stack(values)
