"""Limits as users state them, by the names of the system."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, brief, closest
from leastaction.numerics.arrays import Array, as_number, require_instance
from leastaction.numerics.names import as_names, matching
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Quantity, WeightedSum

Names = str | Sequence[str] | Mapping[str, float]
When = str | int | float | Sequence[int] | Sequence[float] | None
Value = ArrayLike | Callable[[float], Any] | None


class Horizon(Protocol):
    """The instants of a system by which limits are stated: those of a `DiscreteSystem`, or points of a horizon."""

    @property
    def numbered(self) -> bool:
        """Whether limits may name them by their index."""

    @property
    def quantities(self) -> tuple[str, ...]:
        """The kinds of quantities that can be limited, in the order in which names are looked for."""

    def quantity(self, kind: str, /) -> Quantity:
        """Return the quantities of a kind, by name."""

    def span(self, *, of_state: bool) -> tuple[int, int]:
        """Return the first and the last one of states, or of inputs."""

    def time(self, k: int, /) -> float:
        """Return the time of one (s)."""

    def when(self, k: int, /) -> str:
        """Return how to speak of one in messages."""

    def instant(self, t: float, what: str, /) -> int:
        """Return the index of a time."""


class Limit(ABC):
    """What a motion has to keep to. Frozen, so any number of threads may share it."""

    __repr__ = printed

    at: When = None
    """When it holds; always if None."""

    @abstractmethod
    def rows(self, system: Any, first: int) -> list[Rows]:
        """Return the rows for a system; quantities of the state hold from instant `first` on.

        Raises
        ------
        ArgumentError
            Unknown names, values of wrong shapes, or bounds that contradict each other.
        """


@public
@dataclass(frozen=True)
class Bound(Limit):
    """Least and largest values of quantities of the system, by name.

    Parameters
    ----------
    names : str, sequence of str, or mapping of str to float
        Such as ``"push"``, or with wildcards, ``"*_string"``. A mapping is their weighted sum, as one quantity:
        ``{"hip": 1.0, "knee": -0.5}``.
    min, max : float, array_like (n,) or (n, m), or callable
        For all names and instants, over the instants, for each of the m names too, or a function of the time (s).
        None is no bound. Of states n is N + 1, or N from the second instant on.
    of : str, optional
        Which quantity of the system: "input", "state"; in steps of time also "input rate", how fast inputs
        change from the middle of a step to that of the next. Of a `MidpointSystem` also "variable", "rate", "momentum",
        "acceleration", "multiplier" and "tension", of a `MechanismSystem` all of these but "momentum". The first that
        knows the names, if left out.
    at : str, int, float or sequence, optional
        "end", "start", an index or a time (s) of the system's, or several; everywhere if left out. In continuous time
        every number is a time.

    Notes
    -----
    A fixed initial state cannot be moved: bounds on quantities of the state are looked for from the second instant on.
    If they are for all instants, the first one too, the initial state has to keep to them, or `optimize` says that it
    does not. N values, or `at`, say nothing of it.
    """

    names: Names
    min: Value = None
    max: Value = None
    of: str | None = field(default=None, kw_only=True)
    at: When = field(default=None, kw_only=True)

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows of both sides."""
        what = f"Bound({self.names!r})"
        quantity = selected(system, self.names, self.of, what)
        if self.min is None and self.max is None:
            raise ArgumentError(f"{what}: got neither min nor max, expected one of them at least")
        return _bounded(system, quantity, self.min, self.max, self.at, first, what)


@public
@dataclass(frozen=True)
class Within(Limit):
    """Least and largest values of a quantity of your own, such as a `FunctionQuantity`.

    Parameters
    ----------
    quantity : Quantity
    min, max : float, array_like (n,) or (n, m), or callable
        As of `Bound`; at least 0 if both are left out.
    at : str, int, float or sequence, optional
        As of `Bound`.
    """

    quantity: Quantity
    min: Value = None
    max: Value = None
    at: When = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        require_instance(self.quantity, "Within: quantity", Quantity, "FunctionQuantity makes one of a function")
        if not self.quantity.names:
            raise ArgumentError("Within: quantity: got one of no names, expected one at least")

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows of both sides."""
        least = 0.0 if self.min is None and self.max is None else self.min
        what = f"Within({self.quantity.names[0]!r})"
        rows = _bounded(system, self.quantity, least, self.max, self.at, first, what)
        return [replace(row, is_own=True) for row in rows]


@public
@dataclass(frozen=True)
class Equal(Limit):
    """Values that quantities of the system must have at some instants: conditions at the end, or on the way.

    Parameters
    ----------
    names : str, sequence of str, mapping of str to float, or Quantity
        As of `Bound`, or a quantity of your own.
    value : float, array_like (n,) or (n, m), or callable
        As of `Bound`; for a single instant one value for each name, (m,), will do.
    of : str, optional
        As of `Bound`.
    at : str, int, float or sequence, optional
        As of `Bound`; "end" if left out.
    """

    names: Names | Quantity
    value: ArrayLike | Callable[[float], Any] = 0.0
    of: str | None = field(default=None, kw_only=True)
    at: When = field(default="end", kw_only=True)

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return both sides of the equations."""
        if isinstance(self.names, Quantity):
            what, quantity = f"Equal({self.names.names[0]!r})", self.names
        else:
            what = f"Equal({self.names!r})"
            quantity = selected(system, self.names, self.of, what)
        k = _instants(system, quantity, self.at, first, what)
        fixed = _fixed(quantity, self.at, first)
        value, at_start = _values(
            system, self.value, k, len(quantity.names), f"{what}: value", fixed, (-np.inf, np.inf)
        )
        scale = np.maximum(np.abs(value).max(axis=0), 1.0)
        own = isinstance(self.names, Quantity)
        return [
            Rows(what, quantity, sign, value, k, scale, equal=True, is_own=own, start=at_start) for sign in (1.0, -1.0)
        ]


@dataclass(frozen=True)
class FromSecond(Limit):
    """Another limit, which says nothing of a fixed initial state: one that was found, and may be off a little."""

    limit: Limit

    def rows(self, system: Any, first: int) -> list[Rows]:
        return [replace(rows, start=None) for rows in self.limit.rows(system, first)]


def checked_limits(limits: Sequence[Limit]) -> list[Limit]:
    """Return limits as a list; what is none of them is an error."""
    if isinstance(limits, Limit):
        return [limits]
    several: object = limits
    if not isinstance(several, Iterable) or isinstance(several, str | Mapping):
        raise ArgumentError(
            f"limits: got {brief(repr(limits))}, expected a list of limits such as [Bound('push', -5, 5)]"
        )
    given = list(limits)
    for i, limit in enumerate(given):
        if not isinstance(limit, Limit):
            raise ArgumentError(
                f"limits[{i}]: got {type(limit).__name__}, expected a Limit such as Bound('push', -5, 5)"
            )
    return given


def selected(system: Horizon, names: Names, of: str | None, what: str) -> Quantity:
    """Return a quantity of the system, of the functions whose names match, or the sum that a mapping says."""
    if not isinstance(names, Mapping):
        return _matching(system, names, of, what)
    for name, weight in names.items():
        if as_number(weight, f"{what}: weight of {name!r}") == 0.0:
            raise ArgumentError(f"{what}: got a weight of 0 for {name!r}, expected a sum without it")
    whole = _matching(system, list(names), of, what)
    weights = np.zeros(len(whole.names))
    for pattern, weight in names.items():
        weights[whole.matching(pattern)] += weight
    return WeightedSum(whole, weights)


def _matching(system: Horizon, names: str | Sequence[str], of: str | None, what: str) -> Quantity:
    kinds = system.quantities
    if of is not None and of not in kinds:
        expected = f"expected one of {', '.join(map(repr, kinds))}"
        try:
            system.quantity(of)
        except ArgumentError as error:
            if str(error).startswith(f"{of}: "):  # the system knows why it has none
                expected += f"; {error}"
        raise ArgumentError(f"{what}: got of={of!r}, {expected}")
    patterns = [names] if isinstance(names, str) else list(as_names(names, what, "names"))
    if not patterns:
        raise ArgumentError(f"{what}: got no names")
    known: list[str] = []
    more: Mapping[str, str] = getattr(system, "beside", {})
    asked = kinds if of is None else (of, more[of]) if of in more else (of,)
    turns = "" if of is None else ".w[xyz]"  # a joint that is a rotation has rates and momenta about three axes
    for kind in asked:
        whole = system.quantity(kind)
        found = [whole.matching(pattern) or whole.matching(f"{pattern}{turns}") for pattern in patterns]
        if all(found):
            return whole.select(list(dict.fromkeys(i for each in found for i in each)))  # in the order of their values
        known += [name for name in whole.names if name not in known]
    unknown = next((pattern for pattern in patterns if not matching(known, pattern)), None)
    if unknown is None:
        raise ArgumentError(
            f"{what}: the names are of several quantities, expected those of one; state a limit for each"
        )
    there = closest(unknown, known, what="names" if of is None else of + " names")
    raise ArgumentError(f"{what}: unknown name {unknown!r}; {there}")


def _bounded(
    system: Horizon, quantity: Quantity, least: Value, most: Value, at: When, first: int, what: str
) -> list[Rows]:
    k = _instants(system, quantity, at, first, what)
    m, fixed = len(quantity.names), _fixed(quantity, at, first)
    low, low_start = (None, None) if least is None else _values(system, least, k, m, f"{what}: min", fixed, (np.inf,))
    high, high_start = (None, None) if most is None else _values(system, most, k, m, f"{what}: max", fixed, (-np.inf,))
    scale = np.zeros(m)
    if low is not None and high is not None:
        _check_order(system, quantity, low, high, k, what)
        if low_start is not None and high_start is not None:
            _check_order(system, quantity, low_start[None], high_start[None], np.zeros(1, dtype=np.intp), what)
        scale = np.where(np.isfinite(high - low), high - low, np.inf).min(axis=0)
        scale = np.where(np.isfinite(scale), scale, 0.0)
    rows = []
    for sign, bounds, start in ((1.0, low, low_start), (-1.0, high, high_start)):
        if bounds is None:
            continue
        # Where a bound is infinite at every instant there is none.
        columns = [j for j in range(m) if np.isfinite(bounds[:, j]).any()]
        if not columns:
            continue
        kept, start = bounds[:, columns], None if start is None else start[columns]
        if not np.isfinite(kept).all():
            raise ArgumentError(
                f"{what}: got bounds that are infinite at some instants only; give `at`, and two bounds"
            )
        part = quantity if len(columns) == m else quantity.select(columns)
        if not kept.any() and (start is None or not start.any()):
            part = part.sign
        rows.append(Rows(what, part, sign, kept, k, scale[columns], start=start))
    return rows


def _check_order(system: Horizon, quantity: Quantity, low: Array, high: Array, k: Any, what: str) -> None:
    """Complain about a least value (n, m) that is not below the largest."""
    crossed = np.argwhere(low >= high)
    if crossed.size:
        i, j = crossed[0]
        raise ArgumentError(
            f"{what}: got min {low[i, j]:.6g} and max {high[i, j]:.6g} for {quantity.names[j]!r} at "
            f"{system.when(int(k[i]))}, expected the least value below the largest. Equations are `Equal`"
        )


def _fixed(quantity: Quantity, at: When, first: int) -> bool:
    """Whether a limit is for all instants, and the first of them cannot be moved."""
    return at is None and quantity.of_state and quantity.first == 0 and first == 1


def _instants(system: Horizon, quantity: Quantity, at: When, first: int, what: str) -> Any:
    """Return the indices at which a quantity is asked, in the order in which they are given: values go with them."""
    start, last = system.span(of_state=quantity.of_state)
    start = max(first if quantity.of_state else start, quantity.first)
    if at is None:
        return np.arange(start, last + 1)
    found = []
    for one in [at] if isinstance(at, (str, int, float)) else at:
        if one == "end":
            k = last
        elif one == "start":
            k = max(system.span(of_state=quantity.of_state)[0], quantity.first)
        elif isinstance(one, (str, bool)):
            raise ArgumentError(f"{what}: got at={one!r}, expected 'end', 'start', an index or a time (s)")
        elif isinstance(one, (int, np.integer)) and system.numbered:
            k = int(one) + (system.span(of_state=True)[1] + 1 if one < 0 else 0)
        elif not np.isfinite(float(one)):
            raise ArgumentError(f"{what}: got at={one!r}, expected 'end', 'start', an index or a time (s)")
        else:
            k = system.instant(float(one), what)
        if not start <= k <= last:
            found_at = f"index {k}, expected one of {start} .. {last}" if system.numbered else f"{system.when(k)}"
            raise ArgumentError(
                f"{what}: got at={one!r}, which is {found_at}"
                + (": the initial state is fixed" if k < start and quantity.of_state else "")
            )
        found.append(k)
    if not found or len(set(found)) < len(found):
        raise ArgumentError(f"{what}: got at={at!r}, expected one or several different instants")
    return np.array(found, dtype=np.intp)


def _values(
    system: Horizon, value: Any, k: Any, m: int, what: str, fixed: bool, never: tuple[float, ...]
) -> tuple[Array, Array | None]:
    """Return bounds (n, m), and those at the start (m,), which is fixed; None where they say nothing of it.

    ``never``: values that nothing can meet.
    """
    n = len(k)
    function = callable(value)
    if function:
        value = [value(system.time(int(i))) for i in ((0, *k) if fixed else k)]
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{what}: got {brief(repr(value))}, expected numbers") from None
    if np.isnan(array).any():
        raise ArgumentError(f"{what}: got NaN, expected numbers")
    impossible = array[np.isin(array, never)]
    if impossible.size:
        raise ArgumentError(f"{what}: got {impossible[0]:g}, which nothing can meet; leave out what is not limited")
    if array.ndim == 1 and n == 1 and array.shape == (m,) and not function:
        array = array[None, :]
    elif array.ndim == 1 and array.shape in ((n,), (n + fixed,)):
        array = array[:, None]
    if fixed and array.shape in ((n + 1, 1), (n + 1, m)):
        whole = np.array(np.broadcast_to(array, (n + 1, m)))
        return whole[1:], whole[0]
    if array.ndim > 2 or (array.ndim and array.shape not in ((n, m), (n, 1), (1, m))):
        counts = f"({n + 1},) over the instants, ({n},) from the second on" if fixed else f"({n},) over the instants"
        counts = f"({m},) for each of the names" if n == 1 else f"{counts}, or ({n}, {m}) for each of the names too"
        raise ArgumentError(f"{what}: got shape {np.shape(value)}, expected a number, a function of the time, {counts}")
    bounds = np.array(np.broadcast_to(array, (n, m)))
    constant = array.ndim == 0 or (n > 1 and len(array) == 1)
    return bounds, bounds[0].copy() if fixed and constant else None
