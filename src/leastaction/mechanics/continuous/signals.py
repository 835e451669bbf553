"""Inputs as functions of time and state, for a simulation in continuous time."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, shape_of
from leastaction.numerics.frozen import own_arrays, restore_state, saved_state
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.numerics.public import public
from leastaction.numerics.signals import OfTime, StateLaw, put_together, takes_state
from leastaction.numerics.time_functions import TimeFunction

ContinuousSignal = OfTime | Mapping[str, OfTime] | PiecewisePolynomial | StateLaw | None
"""A constant, rows of instants or intervals, a function of time, these by name, a law of time and state, or nothing."""


@public
@dataclass(frozen=True)
class Feedback:
    """The law ``u = ubar(t) - K(t) (x - xbar(t))`` with an exact derivative by the state.

    Frozen; as fit for several threads as the functions in it are.

    Attributes
    ----------
    K : ndarray of shape (n, nx), or callable
        Gains, or a function of time that returns them.
    xbar : ndarray of shape (nx,), or callable
        Reference state: ``[q; rho; v; v_rho]`` in continuous time, ``[q; rho; p; v_rho]`` in discrete time.
    ubar : ndarray of shape (n,), or callable
        Reference input.

    Raises
    ------
    ArgumentError
        Arrays of other shapes, such as the gains of all steps: what changes over time is given as a function of it.
    """

    K: Any
    xbar: Any
    ubar: Any

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        for name, axes, shape in (("K", 2, "(n, nx)"), ("xbar", 1, "(nx,)"), ("ubar", 1, "(n,)")):
            part = getattr(self, name)
            if not callable(part) and as_array(part, f"Feedback: {name}").ndim != axes:
                raise ArgumentError(
                    f"Feedback: {name}: got shape {np.shape(part)}, expected {shape}; what changes over time is given "
                    f"as a function of it, such as lambda time: {name}[np.searchsorted(t, time, 'right') - 1]"
                )
        own_arrays(self, "K", "xbar", "ubar")

    def __call__(self, t: float, x: Array) -> Array:
        """Return the input (n,) at a time and a state."""
        ubar, gain, xbar = (_at(part, t) for part in (self.ubar, self.K, self.xbar))
        if np.shape(xbar) != x.shape or np.shape(gain) != (*np.shape(ubar), *x.shape) or np.ndim(ubar) != 1:
            raise ArgumentError(
                f"Feedback: at t = {t:g} s K, xbar and ubar have the shapes {np.shape(gain)}, {np.shape(xbar)} and "
                f"{np.shape(ubar)}, expected (n, nx), (nx,) and (n,) with a state of shape {x.shape}; gains "
                "of turns, where rotations are quaternions, need lambda t, x: ubar - K @ system.difference(x, xbar)"
            )
        value: Array = ubar - gain @ (x - xbar)
        return value

    def jacobian(self, t: float, x: Array) -> Array:  # noqa: ARG002 - the signature of every law
        """Return the derivative of the input by the state, (n, nx)."""
        return -_at(self.K, t)


class InputLaw:
    """One input signal, checked, as a function of time and state.

    ``signal``: a constant (n,); rows (N+1, n), which are joined by straight lines; rows (N, n), each held over an
    interval; a `PiecewisePolynomial`; a function ``(t)``; a function ``(t, x)``, which may have a ``jacobian(t, x)`` of
    shape (n, nx); zero if None. ``times`` (N+1,): the instants of the rows (s). ``names``: of the n entries. ``what``:
    the name of the argument, for messages.
    """

    def __init__(self, signal: ContinuousSignal, times: Array, names: Sequence[str], what: str) -> None:
        self.names, self.what = tuple(names), what
        self.n = len(self.names)
        self.law: StateLaw | None = None
        self.kinked = False
        self.signal = TimeFunction(np.zeros(self.n), what)
        signal = put_together(signal, self.names, what, np.zeros(self.n))
        if isinstance(signal, PiecewisePolynomial):
            self.signal = TimeFunction(signal, what)
            self.signal.check(times[0], times[-1], (self.n,), what=f"({self.n},)")
        elif callable(signal):
            if hasattr(signal, "info"):  # what a controller says of itself is of one call, at an instant
                raise ArgumentError(
                    f"{what}: got a controller, {type(signal).__name__}, which is asked at instants and not within the "
                    "steps of a solver; leastaction.simulate(..., inputs=controller) holds what it says from one "
                    "time to the next"
                )
            self.law = _as_law(signal, what)
        elif signal is not None:
            self.signal = TimeFunction(self._sampled(cast(ArrayLike, signal), times), what)

    def _sampled(self, signal: ArrayLike, times: Array) -> Array | PiecewisePolynomial:
        shape, N = shape_of(signal), len(times) - 1
        if shape is None or len(shape) != 2:
            meaning = f"a constant; rows are of shape ({N}, {self.n}) or ({N + 1}, {self.n})"
            return as_array(signal, self.what, (self.n,), meaning=meaning, names=self.names)
        held = shape[0] == N
        self.kinked = not held
        rows = as_array(signal, self.what, (N if held else N + 1, self.n), names=self.names)
        if not self.n:
            return np.zeros(0)
        return PiecewisePolynomial.through(times, rows, kind="hold" if held else "linear")

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) inside at which the signal jumps; a kink between rows is nothing to stop at."""
        return () if self.kinked else self.signal.jumps

    def value(self, t: float, x: Array) -> Array:
        """Return the input (n,); after the jump where it jumps."""
        if self.law is None:
            return self.signal.at(t)
        given = self.law(t, x)
        array = np.asarray(given)
        if array.shape == (self.n,) and array.dtype.kind == "f":
            # What is not finite is for the integrator to say: it knows the state that led to it.
            return array.astype(np.float64, copy=False)
        return as_array(given, f"{self.what}({t:g}, x)", (self.n,), names=self.names)

    def jacobian(self, t: float, x: Array) -> Array | None:
        """Return the derivative by the state (n, nx): the law's own, or forward differences; None for zero.

        The differences serve the Newton iterations of an implicit method, and nothing else.
        """
        if self.law is None or not self.n:
            return None
        derivative = getattr(self.law, "jacobian", None)
        if callable(derivative):
            given = derivative(t, x)
            return as_array(given, f"{self.what}.jacobian({t:g}, x)", (self.n, len(x)))
        here = self.value(t, x)
        result = np.empty((self.n, len(x)))
        for i, entry in enumerate(x):
            step = 1e-7 * max(1.0, abs(float(entry)))
            beside = x.copy()
            beside[i] += step
            result[:, i] = (self.value(t, beside) - here) / (beside[i] - entry)
        return result


class WholeInput:
    """The input ``u = [inputs; rho_a]`` from its two parts, or from one law for both."""

    def __init__(self, parts: Sequence[InputLaw]) -> None:
        self.parts = tuple(parts)

    @property
    def breaks(self) -> Array:
        """Times (s) inside at which one of the parts jumps, increasing."""
        return np.unique(np.concatenate([part.breaks for part in self.parts]))

    def value(self, t: float, x: Array) -> Array:
        """Return u (n_inputs + nrho,)."""
        if len(self.parts) == 1:
            return self.parts[0].value(t, x)
        return np.concatenate([part.value(t, x) for part in self.parts])

    def jacobian(self, t: float, x: Array) -> Array | None:
        """Return its derivative by the state (n_inputs + nrho, nx); None for zero."""
        blocks = [part.jacobian(t, x) for part in self.parts]
        if all(block is None for block in blocks):
            return None
        return np.vstack([
            np.zeros((part.n, len(x))) if block is None else block
            for part, block in zip(self.parts, blocks, strict=True)
        ])  # fmt: skip


def _at(part: Any, t: float) -> Array:
    return np.asarray(part(t) if callable(part) else part, dtype=np.float64)


class _OfTime:
    """A function of time, called as one of time and state."""

    def __init__(self, function: Callable[[float], ArrayLike]) -> None:
        self.function = function

    def __call__(self, t: float, x: Array) -> ArrayLike:  # noqa: ARG002 - the signature of every law
        return self.function(t)

    def jacobian(self, t: float, x: Array) -> Array:
        return np.zeros((len(np.atleast_1d(self.function(t))), len(x)))


def _as_law(function: Callable[..., Any], what: str) -> StateLaw:
    """Return a function of time and state from one, or from one of time alone."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError, OverflowError):
        return function  # a function of C that does not say how it is called
    for arguments in ((0.0,), (0.0, np.zeros(0))):
        try:
            signature.bind(*arguments)
        except TypeError:
            continue
        return function if takes_state(function) or len(arguments) == 2 else _OfTime(function)
    raise ArgumentError(
        f"{what}: it is called as {what}(t), or as {what}(t, x) with the time and the state [q; rho; v; v_rho], but "
        f"takes {signature}; give it these arguments"
    )
