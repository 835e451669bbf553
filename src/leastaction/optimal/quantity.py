"""Quantities of a system by name: what can be limited."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_places, read_only
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.names import as_names, matching, some_names
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public
from leastaction.optimal.functions import as_complex, called, sized

Instants = np.ndarray[tuple[int], np.dtype[np.intp]]
"""Whole numbers: indices of instants, or places in a vector."""


class Samples(NamedTuple):
    """Where a quantity is evaluated.

    ``k`` (n,): instants of a quantity of the state, steps of any other. ``x``, ``u``, ``x_next`` (n, nx), (n, nu), (n,
    nx): state and input there, and the state that the step leads to; no columns where that is not needed.
    """

    k: Instants
    x: Array
    u: Array
    x_next: Array


class Quantity(ABC):
    """Named functions of the state, of state and input, or of a whole step; vectorised over time, and pure.

    Any number of threads may share one.

    A quantity of the state (`of_state`) is evaluated at instants. Any other is evaluated for steps, with their inputs
    and, if it `looks_ahead`, with the states that the steps lead to.
    """

    __repr__ = printed

    names: tuple[str, ...]
    """One for each function."""
    unit: str = ""
    """For messages and figures."""
    kind: str = ""
    """Before the names in messages and figures, such as "rate of"."""
    of_state: bool = False
    looks_ahead: bool = False
    first: int = 0
    """The first instant at which a quantity of the state means something."""
    by_entries: bool = False
    """Whether derivatives are by the entries of a state (nx), whatever its space; else by its directions (ndx)."""
    says_all: bool = False
    """Whether the names say all of a bound at zero."""

    def columns(self, nx: int, nu: int) -> Instants | None:
        """Return the places in ``(x, u, x_next)`` on which it depends at all, in which its derivatives are given.

        None, as here: all of x, and all of u and of x_next as far as it is evaluated with them. A place may come twice
        in a quantity that looks ahead.
        """

    def all_columns(self, nx: int, nu: int) -> Instants:
        """Return the same where it is all of them too."""
        found = self.columns(nx, nu)
        return np.arange(self._reach(nx, nu)) if found is None else found

    def _reach(self, nx: int, nu: int) -> int:
        return nx if self.of_state else 2 * nx + nu if self.looks_ahead else nx + nu

    @abstractmethod
    def values(self, at: Samples) -> Array:
        """Return the values (n, m)."""

    @abstractmethod
    def jacobian(self, at: Samples) -> Array:
        """Return the derivatives by x, and by u, and by x_next, as far as it depends on them, (n, m, ...)."""

    def whole_jacobian(self, at: Samples, nx: int, nu: int) -> Array:
        """Return those by all of x, u and x_next, as far as it is evaluated with them, (n, m, ...)."""
        whole = np.zeros((len(at.k), len(self.names), self._reach(nx, nu)))
        whole[:, :, self.all_columns(nx, nu)] = self.jacobian(at)
        return whole

    @abstractmethod
    def curvature(self, at: Samples, y: Array) -> Array | None:
        """Return the second derivative of ``y . values`` by the same, (n, ..., ...); None where all are linear."""

    def matching(self, pattern: str) -> list[int]:
        """Return the rows of the functions with a name, which may have wildcards."""
        return matching(self.names, pattern)

    def select(self, rows: Sequence[int]) -> Quantity:
        """Return some of the functions."""
        found = self.own_select(rows)
        return _Selected(self, tuple(rows)) if found is None else found

    def own_select(self, rows: Sequence[int]) -> Quantity | None:
        """Return some of the functions as a quantity that evaluates no others; None where there is no such."""

    def apart(self, other: Quantity, k: Instants) -> Array | None:
        """Return the distance between the sets where each is at least zero, at instants (n,); None where not known.

        It is above zero where no state is in both.
        """

    def is_like(self, other: Quantity) -> bool:
        """Return whether another quantity, stated alike of a system with other parameters, is the same function.

        False where that is not known.
        """
        return other is self or bool(self.own_is_like(other))

    def own_is_like(self, other: Quantity) -> bool | None:
        """Return the same of another quantity that is not this one; None where that is not known."""

    @property
    def sign(self) -> Quantity:
        """A quantity with the same signs, for bounds at zero; a simpler one, if there is one."""
        return self

    def joined(self, others: Sequence[Quantity]) -> Quantity | None:
        """Return this and others of its type as one quantity, with the functions of all, if that is less work."""

    def among(self, others: Sequence[Quantity]) -> list[Self]:
        """Return this and those others that are of its type, for `joined`."""
        return [self, *(other for other in others if isinstance(other, type(self)))]


def as_slice(places: Instants) -> Instants | slice:
    """Return places as a slice, which copies nothing, where they follow each other."""
    follow = len(places) > 0 and bool((np.diff(places) == 1).all())
    return slice(int(places[0]), int(places[-1]) + 1) if follow else places


def names_of(quantities: Sequence[Quantity]) -> tuple[str, ...]:
    """Return the names of all functions of some quantities."""
    return tuple(name for each in quantities for name in each.names)


@public
class Entries(Quantity):
    """Entries of state or input, times factors.

    Parameters
    ----------
    names : sequence of str
    columns : sequence of int
        Places in x, or in u.
    of_state : bool
        Whether they are of the state.
    factors : array_like, optional
        1 if left out.
    kind, unit : str, optional
    """

    def __init__(
        self,
        names: Sequence[str],
        columns: ArrayLike,
        *,
        of_state: bool,
        factors: Any = 1.0,
        kind: str = "",
        unit: str = "",
    ) -> None:
        self.names = as_names(names, "Entries: names", "names")
        self.of_state, self.kind, self.unit = of_state, kind, unit
        self.by_entries = of_state
        self.places: Instants = as_places(columns, "columns", f"(n,): a place of each of {len(self.names)} names")
        self.places.setflags(write=False)
        n = len(self.places)
        if n != len(self.names):
            raise ArgumentError(f"columns: got {n} places for {len(self.names)} names, expected one for each")
        factor = as_array(factors, "factors", (), (1,), (n,))
        self.factors = read_only(np.array(np.broadcast_to(factor, (n,))))

    def values(self, at: Samples) -> Array:
        """Return the entries times their factors."""
        return np.asarray((at.x if self.of_state else at.u)[:, self.places] * self.factors)

    def jacobian(self, at: Samples) -> Array:
        """Return the constant derivatives."""
        offset = 0 if self.of_state else at.x.shape[1]
        result = np.zeros((len(at.k), len(self.places), at.x.shape[1] + (0 if self.of_state else at.u.shape[1])))
        result[:, np.arange(len(self.places)), offset + self.places] = self.factors
        return result

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""

    def own_is_like(self, other: Quantity) -> bool:
        return (
            isinstance(other, Entries)
            and (self.names, self.of_state) == (other.names, other.of_state)
            and np.array_equal(self.places, other.places)
            and np.array_equal(self.factors, other.factors)
        )

    def own_select(self, rows: Sequence[int]) -> Entries:
        """Return some of the entries."""
        return Entries(
            [self.names[row] for row in rows],
            self.places[list(rows)],
            of_state=self.of_state,
            factors=self.factors[list(rows)],
            kind=self.kind,
            unit=self.unit,
        )


class QuantityView(Quantity):
    """Another quantity, seen otherwise: it has that one's names, and what is said of it, until a subclass says more."""

    keeps_signs: ClassVar[bool] = True
    """Whether each of its functions is at least zero where one of the other quantity is."""

    def __init__(self, whole: Quantity) -> None:
        self.whole = whole
        self.names, self.kind, self.unit, self.first = whole.names, whole.kind, whole.unit, whole.first
        self.of_state, self.looks_ahead, self.says_all = whole.of_state, whole.looks_ahead, whole.says_all
        self.by_entries = whole.by_entries

    def instants(self, k: Instants) -> Instants:
        """Return the instants of the other quantity at which it is evaluated."""
        found = self.own_instants(k)
        return k if found is None else found

    def own_instants(self, k: Instants) -> Instants | None:
        """Return the same where they are others; None where they are not."""

    def apart(self, other: Quantity, k: Instants) -> Array | None:
        if not isinstance(other, QuantityView) or not (self.keeps_signs and other.keeps_signs):
            return None
        own = self.instants(k)
        return self.whole.apart(other.whole, own) if np.array_equal(own, other.instants(k)) else None


class QuantityElsewhere(QuantityView):
    """Another quantity, evaluated at other samples, which a subclass says."""

    @abstractmethod
    def seen(self, at: Samples) -> Samples:
        """Return where the other quantity is evaluated."""

    def values(self, at: Samples) -> Array:
        return self.whole.values(self.seen(at))

    def jacobian(self, at: Samples) -> Array:
        return self.whole.jacobian(self.seen(at))

    def curvature(self, at: Samples, y: Array) -> Array | None:
        return self.whole.curvature(self.seen(at), y)


class _Selected(QuantityView):
    """Some of the functions of another quantity."""

    def __init__(self, whole: Quantity, rows: tuple[int, ...]) -> None:
        super().__init__(whole)
        self.rows = list(rows)
        self.names = tuple(whole.names[row] for row in rows)

    def columns(self, nx: int, nu: int) -> Instants | None:
        return self.whole.columns(nx, nu)

    def values(self, at: Samples) -> Array:
        return self.whole.values(at)[:, self.rows]

    def jacobian(self, at: Samples) -> Array:
        return self.whole.jacobian(at)[:, self.rows]

    def curvature(self, at: Samples, y: Array) -> Array | None:
        weights = np.zeros((len(y), len(self.whole.names)))
        weights[:, self.rows] = y
        return self.whole.curvature(at, weights)

    def own_is_like(self, other: Quantity) -> bool:
        return isinstance(other, _Selected) and self.rows == other.rows and self.whole.is_like(other.whole)


class WeightedSum(QuantityView):
    """A weighted sum of the functions of another quantity, as one function; ``weights`` (m,)."""

    keeps_signs = False

    def __init__(self, whole: Quantity, weights: Array) -> None:
        super().__init__(whole)
        self.weights, self.says_all = read_only(weights.copy()), False
        self.names = (_sum_of(whole.names, weights),)

    def columns(self, nx: int, nu: int) -> Instants | None:
        whole = self.whole
        if isinstance(whole, Entries):
            return whole.places if self.of_state else nx + whole.places
        return whole.columns(nx, nu)

    def values(self, at: Samples) -> Array:
        return np.asarray(self.whole.values(at) @ self.weights)[:, None]

    def jacobian(self, at: Samples) -> Array:
        if isinstance(self.whole, Entries):
            return np.broadcast_to(self.weights * self.whole.factors, (len(at.k), 1, len(self.weights)))
        return np.asarray(np.einsum("m,kmi->ki", self.weights, self.whole.jacobian(at)))[:, None]

    def curvature(self, at: Samples, y: Array) -> Array | None:
        return self.whole.curvature(at, y * self.weights)

    def own_select(self, rows: Sequence[int]) -> Quantity:
        del rows  # there is one
        return self

    def own_is_like(self, other: Quantity) -> bool:
        if not isinstance(other, WeightedSum) or not np.array_equal(self.weights, other.weights):
            return False
        return self.whole.is_like(other.whole)


def _sum_of(names: Sequence[str], weights: Array) -> str:
    """Return how to speak of a sum: ``hip - 2 knee``."""
    said = ""
    for name, weight in zip(names, weights.tolist(), strict=True):
        sign = (" - " if said else "-") if weight < 0.0 else (" + " if said else "")
        said += sign + ("" if abs(weight) == 1.0 else f"{abs(weight):.6g} ") + name
    return said


class Later(QuantityElsewhere):
    """A quantity as it is from a later instant on: what a window of a system has of it."""

    def __init__(self, whole: Quantity, start: int) -> None:
        super().__init__(whole)
        self.start = start

    def columns(self, nx: int, nu: int) -> Instants | None:
        return self.whole.columns(nx, nu)

    def seen(self, at: Samples) -> Samples:
        return at._replace(k=self.instants(at.k))

    def own_instants(self, k: Instants) -> Instants:
        return k + self.start


@public
class FunctionQuantity(Quantity):
    """Functions of your own of the state, or of state and input.

    Parameters
    ----------
    names : str or sequence of str
        One for each function.
    values : callable
        ``values(x)`` or ``values(x, u)`` for x (n, nx), u (n, nu): (n, m), or (n,) of a single one. Built of NumPy
        functions that take complex numbers, if no derivatives are given. With `indexed` the instants k (n,) come
        last, here as below.
    of_state : bool
        Whether it is a function of the state alone.
    jacobian : callable, optional
        ``jacobian(x)`` or ``jacobian(x, u)``, (n, m, nx) or (n, m, nx + nu). By the complex step if left out.
    curvature : callable, optional
        ``curvature(x, y)`` or ``curvature(x, u, y)``, the second derivative of ``y . values``. By central
        differences of the first derivatives if left out, which are good to about nine digits.
    indexed : bool
        Whether the functions take the instants k too, for what changes over time.
    unit : str, optional

    Raises
    ------
    ArgumentError
        When first used: functions that return wrong shapes, or real results for complex arguments.
    """

    def __init__(
        self,
        names: str | Sequence[str],
        values: Callable[..., Any],
        *,
        of_state: bool = True,
        jacobian: Callable[..., Any] | None = None,
        curvature: Callable[..., Any] | None = None,
        indexed: bool = False,
        unit: str = "",
    ) -> None:
        self.by_entries = True
        self.names = some_names(names, "FunctionQuantity: names", "names")
        self.of_state, self.unit = of_state, unit
        self._values, self._jacobian, self._curvature = values, jacobian, curvature
        self._indexed = indexed

    def values(self, at: Samples) -> Array:
        return np.asarray(self._called(at.k, self._joined(at), at.x.shape[1]), dtype=np.float64)

    def jacobian(self, at: Samples) -> Array:
        return self._derivative(at.k, self._joined(at), at.x.shape[1])

    def curvature(self, at: Samples, y: Array) -> Array:
        z = self._joined(at)
        n, size = z.shape
        if self._curvature is not None:
            given = called(self._curvature, "curvature", *self._split(z, at.x.shape[1]), y, *self._instants(at.k))
            return sized(f"limit {self.names[0]!r}: curvature", given, (n, size, size))

        def slope(z: Array) -> Array:
            return np.asarray(np.einsum("kmi,km->ki", self._derivative(at.k, z, at.x.shape[1]), y))

        H = central_differences(slope, z)
        return np.asarray(0.5 * (H + H.transpose(0, 2, 1)))

    def _joined(self, at: Samples) -> Array:
        return at.x if self.of_state else np.hstack([at.x, at.u])

    def _split(self, z: Any, nx: int) -> tuple[Any, ...]:
        return (z,) if self.of_state else (z[:, :nx], z[:, nx:])

    def _instants(self, k: Instants) -> tuple[Instants, ...]:
        return (k,) if self._indexed else ()

    def _called(self, k: Instants, z: Any, nx: int) -> Any:
        found = np.asarray(called(self._values, "values", *self._split(z, nx), *self._instants(k)))
        if found.ndim == 1 and len(self.names) == 1:
            found = found[:, None]
        if found.shape != (len(z), len(self.names)):
            raise ArgumentError(
                f"limit {self.names[0]!r}: its function returned shape {found.shape} for {len(z)} instants, expected "
                f"{(len(z), len(self.names))}, a column for each of its names. It is called with all instants at once"
            )
        return found

    def _derivative(self, k: Instants, z: Array, nx: int) -> Array:
        n, size = z.shape
        if self._jacobian is not None:
            given = called(self._jacobian, "jacobian", *self._split(z, nx), *self._instants(k))
            return sized(f"limit {self.names[0]!r}: jacobian", given, (n, len(self.names), size))

        def value(moved: Any) -> Any:
            return as_complex(f"limit {self.names[0]!r}", self._called(k, moved, nx), "jacobian")

        return complex_step(value, z)
