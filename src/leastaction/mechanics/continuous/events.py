"""Events of a simulation in continuous time: where a function of time and state goes through zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_number, require_mapping
from leastaction.numerics.public import public

_EPS = float(np.finfo(float).eps)


@public
@dataclass(frozen=True)
class Event:
    """Where a function of time and state goes through zero.

    Frozen: threads may share it where they may share its function.

    Attributes
    ----------
    function : callable or str
        ``function(t, x) -> float`` with ``x = [q; rho; v; v_rho]``; or the name of a variable, whose value less
        `value` is the function.
    terminal : bool or int
        Whether the simulation ends there; a number: at the so many-th time.
    direction : float
        Positive: only where the function rises through zero; negative: only where it falls; zero: both.
    value : float
        Of the named variable (m or rad).

    Notes
    -----
    A start, or a restart, at a zero is no event; the next passage is. A function that goes through zero twice
    within one step of the integrator is not seen to do so: bound the step by ``max_step``.
    """

    function: Callable[[float, Array], float] | str
    terminal: bool | int = False
    direction: float = 0.0
    value: float = 0.0


@public
@dataclass(frozen=True)
class EventRecord:
    """The times at which an event took place, and the states there.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times (s).
    x : ndarray, shape (n, nx)
        States ``[q; rho; v; v_rho]``.
    """

    t: Array
    x: Array = field(repr=False)


@dataclass
class Watched:
    """An event under way: its function, what is known of it, and what has been found."""

    name: str
    function: Callable[[float, Array], float]
    terminal: int
    direction: float
    last: float = 0.0
    t: list[float] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)

    def evaluate(self, t: float, x: Array) -> float:
        """Return the function's value."""
        given = self.function(t, x)
        try:
            return float(given)
        except (TypeError, ValueError, OverflowError):
            raise ArgumentError(f"events[{self.name!r}]: got {given!r} at t = {t:g} s, expected a number") from None

    def crossed(self, new: float) -> bool:
        """Return whether the function went through zero in the direction asked for."""
        rises = self.last < 0.0 <= new and self.direction >= 0.0
        falls = self.last > 0.0 >= new and self.direction <= 0.0
        return rises or falls

    def locate(self, sol: Callable[[float], Array], t_old: float, t_new: float) -> float:
        """Return when (s), to rounding."""

        def along(t: float) -> float:
            return self.evaluate(t, sol(t))

        # The ends of the interpolant may differ from the states of the steps by rounding.
        if along(t_old) * self.last <= 0.0:
            return t_old
        if along(t_new) * self.last > 0.0:
            return t_new
        from scipy.optimize import brentq  # slow to import

        return float(brentq(along, t_old, t_new, xtol=4.0 * _EPS, rtol=4.0 * _EPS))

    def record(self, nx: int) -> EventRecord:
        """Return what has been found."""
        return EventRecord(np.array(self.t), np.array(self.x).reshape(len(self.t), nx))


def watch(events: Mapping[str, Event | Callable[[float, Array], float] | str], mechanism: Mechanism) -> list[Watched]:
    """Return the events of a user, checked, ready to be watched.

    ``events``: by name. A function may have the attributes ``terminal`` and ``direction``, as SciPy's events do; a name
    is that of a variable. Raises `ArgumentError` for what is no event, or an unknown variable.
    """
    require_mapping(events, "events", "{'bottom': Event('theta')}")
    return [_watched(str(name), event, mechanism) for name, event in events.items()]


def _watched(name: str, event: Any, mechanism: Mechanism) -> Watched:
    what = f"events[{name!r}]"
    if isinstance(event, str):
        event = Event(event)
    elif callable(event) and not isinstance(event, Event):
        event = Event(event, getattr(event, "terminal", False) or False, getattr(event, "direction", 0.0))
    if not isinstance(event, Event):
        raise ArgumentError(
            f"{what}: got {type(event).__name__}, expected an Event, a function of (t, x), or the name of a variable"
        )
    terminal = event.terminal
    if not hasattr(terminal, "__index__") or int(terminal) < 0:
        raise ArgumentError(
            f"{what}: terminal is {terminal!r}, expected True, False, or how many times it may take place"
        )
    direction = as_number(event.direction, f"{what}: direction")
    function = event.function
    if isinstance(function, str):
        if function not in mechanism.coordinates:
            raise unknown("variable", function, mechanism.coordinates, what)
        function = _crossing(mechanism.coordinates.index(function), as_number(event.value, f"{what}: value"))
    elif not callable(function):
        raise ArgumentError(
            f"{what}: its function is {function!r}, expected a function of (t, x) or the name of a variable"
        )
    return Watched(name, function, int(terminal), direction)


def _crossing(index: int, value: float) -> Callable[[float, Array], float]:
    def function(t: float, x: Array) -> float:  # noqa: ARG001 - the signature of every event
        return float(x[index]) - value

    return function
