"""Limits as lines over time, and the time in which they are active."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import matching
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.limit import Bound, Limit, Value
from leastaction.viz.figures import INK, ORANGE
from leastaction.viz.signals import Key, Signal
from leastaction.viz.strings import spans

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LABEL: Final = re.compile(r"(?P<name>.+) (?P<relation><=|>=|=) ")
_KINDS: Final = (None, "input", "state", "variable", "momentum")  # of which signals are drawn
_NEAR: Final = 1e-3  # of the range of a signal and its bounds: so near to a bound it is on it
LIMIT: Final[dict[str, Any]] = {"color": INK, "linewidth": 0.9, "linestyle": (0, (5, 2)), "zorder": 2.5}
ACTIVE: Final[dict[str, Any]] = {"color": ORANGE, "alpha": 0.3, "linewidth": 0.0, "zorder": 1}


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnBound:
    """A bound over time.

    ``t``, ``values``, ``active`` (n,): where it holds, its value, whether the run is on it. ``end``: as of its signal.
    """

    t: Array
    values: Array
    active: NDArray[np.bool_]
    end: float | None


def stated_bounds(limits: Sequence[Limit], signals: Sequence[Signal]) -> dict[Key, list[DrawnBound]]:
    """Return each `Bound` that holds all along, by the names of the signals; no others."""
    found: dict[Key, list[DrawnBound]] = {}
    for limit in limits:
        if not isinstance(limit, Bound) or limit.of not in _KINDS or limit.at is not None:
            continue
        if not isinstance(limit.names, str | Sequence):
            continue  # a weighted sum
        # As of a limit of the optimiser: names are looked for among inputs first.
        meant = [signal for signal in signals if signal.kind == "input" or limit.of != "input"]
        meant = [signal for signal in meant if signal.kind != "input" or limit.of in (None, "input")]
        inputs = [signal.name for signal in meant if signal.kind == "input"]
        meant = [signal for signal in meant if signal.kind == "input" or signal.name not in inputs]
        known = [signal.name for signal in meant]
        for pattern in [limit.names] if isinstance(limit.names, str) else limit.names:
            places = matching(known, pattern)
            if not places and limit.of is None:
                raise ArgumentError(
                    f"plot_run: limits: unknown name {pattern!r}; {closest(pattern, known, what='names')}"
                )
            for column, i in enumerate(places):
                found.setdefault(meant[i].key, []).extend(_sides(limit, meant[i], column, len(places)))
    return found


def _sides(limit: Bound, signal: Signal, column: int, count: int) -> list[DrawnBound]:
    sides = []
    reach = np.ptp(signal.values)
    for bound, sign in ((limit.min, 1.0), (limit.max, -1.0)):
        values = None if bound is None else _over_time(bound, signal, column, count)
        if values is None or not np.isfinite(values).any():
            continue
        room = sign * (signal.values - values)
        near = _NEAR * max(reach, float(np.abs(values).max()))
        sides.append(DrawnBound(t=signal.t, values=values, active=room <= near, end=signal.end))
    return sides


def _over_time(bound: Value, signal: Signal, column: int, count: int) -> Array:
    """Return a bound (n,) as a limit says it: a number, a function of time, or values over the instants."""
    n = len(signal.t)
    given = np.array([bound(t) for t in signal.t]) if callable(bound) else np.asarray(bound, dtype=float)
    if given.ndim == 2 and given.shape[1] == count:
        given = given[:, column]
    given = given.ravel()
    if len(given) == n - 1:  # from the second instant on
        given = np.concatenate([given[:1], given])
    if len(given) not in (1, n):
        raise ArgumentError(
            f"plot_run: limits: got a bound of shape {given.shape} for {signal.name!r}, expected a number, a "
            f"function of time or ({n},) values over its instants"
        )
    return np.broadcast_to(given, (n,)).astype(float)


def reported_bounds(report: LimitReport, signals: Sequence[Signal]) -> dict[Key, list[DrawnBound]]:
    """Return the limits of an optimisation that are on signals and hold at several instants, by name."""
    found: dict[Key, list[DrawnBound]] = {}
    for side in report.sides:
        for j, label in enumerate(side.labels):
            said = _LABEL.match(label)
            named = [each for each in signals if said and each.name == said["name"]]
            # An input may have the name of a variable; its steps are one less than instants.
            fit = [each for each in named if side.t is not None or int(side.k.max(initial=0)) < len(each.t)]
            signal = next(iter(sorted(fit, key=lambda each: each.kind)), None)
            if said is None or signal is None or len(side.k) < 2:
                continue
            if side.t is None:
                t, values = signal.t[side.k], signal.values[side.k]
            else:
                t, values = side.t, np.interp(side.t, signal.t, signal.values)
            room = side.value[:, j] if said["relation"] == "<=" else -side.value[:, j]
            active = np.zeros(len(t), dtype=bool) if side.equation else side.active[:, j]
            found.setdefault(signal.key, []).append(
                DrawnBound(t=t, values=values + room, active=active, end=signal.end)
            )
    return found


def draw_bound(axes: Axes, bound: DrawnBound, factor: float) -> None:
    """Draw a bound, in units that are drawn, and shade the time in which it is active."""
    t, values = bound.t, factor * bound.values
    if bound.end is None:
        shaded = spans(t, bound.active)
    else:
        t, values = np.append(t, bound.end), np.append(values, values[-1:])
        edges = np.flatnonzero(np.diff(np.concatenate(([False], bound.active, [False]))))
        shaded = [(float(t[a]), float(t[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for begin, end in shaded:
        axes.axvspan(begin, end, **ACTIVE)
    axes.plot(t, values, **LIMIT)
