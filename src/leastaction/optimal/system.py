"""What the optimiser knows of the systems that it steers, in either kind of time.

Symbols: ``x`` (nx,), ``u`` (nu,), ``A = df/dx`` (ndx, ndx), ``B = df/du`` (ndx, nu), ``K`` (nu, ndx) with the
feedback ``u = ubar - K difference(x, xbar)``; over a horizon, with time first. Of states that are plain vectors, as
nearly all are, ndx is nx, and the difference is ``x - xbar``; `StateSpace` says what is meant of others.

Which method of the optimiser needs what:

================  =====  =============  ===========
                  ``f``  `derivatives`  `curvature`
================  =====  =============  ===========
steepest            x          x
quasi-newton        x          x
newton              x          x             x
================  =====  =============  ===========
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, brief, closest
from leastaction.numerics.arrays import Array, Row, as_array, as_count
from leastaction.numerics.dataset import Dataset
from leastaction.numerics.names import as_names, matching
from leastaction.numerics.printed import listed
from leastaction.numerics.public import public
from leastaction.optimal.quantity import Entries, Quantity
from leastaction.optimal.space import DifferencedSpace, StateSpace, Vectors

SecondOrder = Callable[[Array], Array]
Found = TypeVar("Found")

FINAL_TIME = "final time"
"""The name among a system's parameters of the time (s) at which its horizon ends, where that can be changed."""

_NOTHING: Mapping[str, float] = MappingProxyType({})
_NO_KINDS: Mapping[str, str] = MappingProxyType({})
_TURNS = ".[qw][wxyz]"  # pattern of the entries of a rotation that is a quaternion, behind its name


@public
@dataclass(frozen=True, eq=False)
class Linearization:
    """Derivatives of the dynamics along a trajectory: first ones, and contracted second ones for the asking.

    It owns what it needs: to change the arrays afterwards that it was made along changes nothing in it. Any
    number of threads may share it. ``A, B = linearization`` unpacks the first order.

    Attributes
    ----------
    A : ndarray (N, ndx, ndx)
        ``df/dx`` of every step, or at every sample.
    B : ndarray (N, ndx, nu)
        ``df/du`` of every step, or at every sample.
    second : callable or None
        ``second(z) -> (N, ndx+nu, ndx+nu)``, which `curvature` returns; `z` (N, ndx). Without it the
        optimiser calls the system's `curvatures`.
    memory : object
        Whatever the system writes over when this is given back to it as `out`.
    pattern : ndarray of bool (ndx, ndx+nu) or None
        Which entries of ``[A B]`` may differ from zero, at any step, where the system knows: no others are read.
    packed : callable or None
        ``packed(z) -> (N, m (m+1)/2)``, the lower triangles by rows of what `second` returns, of the m inputs and
        states with entries in their columns of the `pattern`: it is less to write and to read.
    """

    A: Array
    B: Array
    second: SecondOrder | None = field(default=None, repr=False)
    memory: Any = field(default=None, repr=False)
    pattern: npt.NDArray[np.bool_] | None = field(default=None, repr=False)
    packed: SecondOrder | None = field(default=None, repr=False)

    def __iter__(self) -> Iterator[Array]:
        """Unpack into A and B."""
        return iter((self.A, self.B))

    def curvature(self, z: Array) -> Array:
        """Return ``z . D2f`` of every step or sample, (N, ndx+nu, ndx+nu).

        Parameters
        ----------
        z : ndarray (N, ndx) or (N+1, ndx)
            Weights on the next state of every step, or on the rate at every sample. Or the adjoint of a
            discrete system, whose first row weighs nothing: no step leads to the first state.

        Raises
        ------
        ArgumentError
            For a wrong shape of `z`.
        NotImplementedError
            If there is no second order.
        """
        if self.second is None:
            raise NotImplementedError("this linearization has no second order: make it as Linearization(A, B, second)")
        return self.second(self._weights(z))

    def packed_curvature(self, z: Array) -> Array:
        """Return the same packed, (N, m (m+1)/2), where the system can; else as it is."""
        return self.curvature(z) if self.packed is None else self.packed(self._weights(z))

    def _weights(self, z: Array) -> Array:
        N, ndx = self.A.shape[:2]
        if z.shape not in ((N, ndx), (N + 1, ndx)):
            raise ArgumentError(
                f"z: got shape {z.shape}, expected ({N}, {ndx}), weights, or ({N + 1}, {ndx}), an adjoint"
            )
        return np.ascontiguousarray(z[-N:])


class System(ABC):
    """What a `DiscreteSystem` and a `ContinuousSystem` share.

    Subclasses set `nx` and `nu` (before they are used) and implement `f`, `derivatives` and, for Newton's
    method, `curvature`. All must be pure: the same arguments give the same result. Arrays that they are given
    are read-only. A system whose methods are pure may serve several threads at once.
    """

    nx: int
    """Number of states."""
    nu: int
    """Number of inputs."""
    entry_names: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    """Names of the entries of state and input, where they have some; else they are called by their places."""

    space: StateSpace | None = None
    """How states differ and move; None where they are plain vectors."""

    by_numbers: ClassVar[bool] = False
    """Whether derivatives and gains are by the numbers of a state, whatever its space, as in continuous time."""

    has_curvature: bool = True
    """Whether `curvature` is available; without it Newton's method is not offered."""

    def __repr__(self) -> str:
        if not (hasattr(self, "nx") and hasattr(self, "nu")):
            return f"<{type(self).__name__}>"  # not made yet
        names = f"states {listed(self.state_names)}; inputs {listed(self.input_names) or 'none'}"
        horizon = self.own_horizon()
        return f"<{type(self).__name__}: {names}{'' if horizon is None else f'; {horizon}'}>"

    def own_horizon(self) -> str | None:
        """Return the horizon in words, of a system that has one."""

    @cached_property
    def ndx(self) -> int:
        """Number of entries of a state that derivatives are by: of a difference, directions in which it moves."""
        return self.nx if self.space is None or self.by_numbers else self.space.ndx

    @abstractmethod
    def f(self, x: Array, u: Array, when: Any, /) -> Array:
        """Return the next state, or the rate of the state (nx,)."""

    @abstractmethod
    def derivatives(self, x: Array, u: Array, when: Any, /) -> tuple[Array, Array]:
        """Return ``A = df/dx`` (ndx, ndx) and ``B = df/du`` (ndx, nu).

        Of states that are no plain vectors they are derivatives of ``difference(f(plus(x, dx), u + du), f(x, u))``.
        """

    def curvature(self, x: Array, u: Array, when: Any, z: Array, /) -> Array | None:
        """Return ``z . D2f``, the symmetric Hessian (ndx+nu, ndx+nu) of ``z'f`` by what `derivatives` are by.

        None of a system that has none.
        """

    def difference(self, x: Array, xbar: Array) -> Array:
        """Return the difference (ndx,) or (n, ndx) of states, as feedback and projection take it."""
        return x - xbar if self.space is None else self.space.difference(x, xbar)

    def plus(self, x: Array, dx: Array) -> Array:
        """Return a state (nx,), or states (n, nx), moved by a difference."""
        return x + dx if self.space is None else self.space.plus(x, dx)

    def charts(self) -> StateSpace | None:
        """Return how states differ and move, with all derivatives; None of plain vectors.

        Of a system with a `difference` and a `plus` of its own, but no `space`, derivatives are differences.
        """
        own = type(self)
        if self.space is not None:
            return space_of(self.space)
        if own.difference is System.difference and own.plus is System.plus:
            return None
        return DifferencedSpace(self.nx, self.ndx, self.difference, self.plus)

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of the state."""
        return self.quantity("state").names

    @cached_property
    def input_names(self) -> tuple[str, ...]:
        """Names of the entries of the input."""
        return tuple(self.input_name(i) for i in range(self.nu))

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the entries of the state, "" where none is known, as here of all."""
        return ("",) * self.nx

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the entries of the input, likewise."""
        return ("",) * self.nu

    def told(self) -> System | None:
        """Return the system that a result keeps, to be pickled and saved with it; it has `motion`.

        None where a result keeps none: of a system of no mechanism.
        """

    def motion(self, result: Any) -> Any:
        """Return the trajectory of the mechanism, given a result; a method of the system that `told` returns."""

    def doubts(self, result: Any) -> list[Warning] | None:
        """Return warnings about the accuracy of the motion of a result; likewise."""

    def dataset(self, result: Any) -> Dataset | None:
        """Return what a file of a result says of the system: its settings, its mechanism, and arrays that it adds."""

    def input_name(self, i: int) -> str:
        """Return the name of entry i of the inputs."""
        found = self.own_input_name(i)
        if found is None:
            found = self.entry_names[1][i] if self.entry_names is not None else f"u[{i}]"
        return found

    def own_input_name(self, i: int) -> str | None:
        """Return the same where it is none of `entry_names`."""

    def unknowns_along(self, dx: Array) -> list[str] | None:
        """Return the names of unknown numbers that a change (nx,) of an initial state changes, if any."""

    def start_directions(self, x: Array, free: Sequence[str] | None) -> Array:
        """Return the directions (ndx, n) in which an initial state x (nx,) may move.

        ``free``: names of the entries of the state that are free, with wildcards; all if None. A system with
        constraints gives a basis of their tangent space.
        """
        found = self.own_start_directions(x, free)
        if found is not None:
            return found
        every = np.eye(self.ndx)
        if free is None:
            return every
        space = self.charts()
        if space is None:
            return every[:, self.free_entries(free)]
        # A direction is free where all is that it moves.
        held = np.ones(self.nx, dtype=np.bool_)
        held[self.free_entries(free)] = False
        return every[:, ~space.pattern[held].any(axis=0)]

    def own_start_directions(self, x: Array, free: Sequence[str] | None) -> Array | None:
        """Return the same of a system whose initial states are not all states."""

    def free_entries(self, free: Sequence[str], what: str = "free_start") -> list[int]:
        """Return the places of the entries of the state with these names; `what` they are given for, in messages.

        The name of a joint that is a rotation means its quaternion, and with ``"p_"`` or ``"v_"`` its momenta or rates.

        Raises
        ------
        ArgumentError
            A name that no entry has.
        """
        places: set[int] = set()
        for pattern in free:
            found = matching(self.state_names, pattern) or matching(self.state_names, f"{pattern}{_TURNS}")
            if not found:
                known = closest(pattern, self.state_names, what="entries of the state")
                raise ArgumentError(f"{what}: unknown name {pattern!r}; {known}")
            places.update(found)
        return sorted(places)

    def own_state(self, given: Any) -> Row | None:
        """Return the numbers of a state (nx,), or numbers by name, given in the system's own way; None of others."""

    def state_given(self, given: Any, what: str = "x") -> Array:
        """Return a state (nx,) that was given by numbers, by name, or in the system's own way, or complain."""
        found = self.own_state(given)
        return as_array(given if found is None else found, what, (self.nx,), names=self.state_names)

    def check_start(self, x: Array) -> None:
        """Raise a `ProjectionError` for an initial state that is fixed and none of the system."""

    def moved_start(self, x: Array, dx: Array) -> Array:
        """Return an initial state moved by dx along `start_directions`, and projected onto the initial states."""
        found = self.own_moved_start(x, dx)
        return self.plus(x, dx) if found is None else found

    def own_moved_start(self, x: Array, dx: Array) -> Array | None:
        """Return the same of a system whose initial states are not all states."""

    def returning_entries(self, names: Sequence[str], what: str) -> list[int] | None:
        """Return the places of entries with these names that are the same again in a periodic motion; None: all."""

    def returning_name(self, place: int) -> str | None:
        """Return the name of one of them, where it is none of `state_names`."""

    def idle_directions(self, x: Array) -> Array | None:
        """Return the directions (ndx, n) of an initial state on which no motion depends, if there are any."""

    # ---- Parameters: what can be found together with a motion ---------------------------------------

    parameters: Mapping[str, float] = _NOTHING
    """Values by name of the numbers that can be found together with a motion; of most systems there are none."""

    def conditions_of(self, names: Sequence[str]) -> list[Quantity] | None:
        """Return what must not be negative of some parameters, as states (n, P), for such a system to exist."""

    def start_by_parameters(self, x: Array, names: Sequence[str], free: bool | Sequence[str]) -> Array | None:
        """Return the derivatives (ndx, len(names)) of an initial state x (nx,) by parameters; None: they are zero.

        ``free``: whether it may move, or the names of its entries that may.
        """

    # ---- What can be limited ------------------------------------------------------------------------

    quantities: tuple[str, ...] = ("input", "state", "input rate")
    """The kinds of quantities that can be limited, in the order in which names are looked for."""
    beside: Mapping[str, str] = _NO_KINDS
    """Kinds of quantities that know names which another kind does not, by that kind."""

    def quantity(self, kind: str, t: Array | None = None) -> Quantity:
        """Return the quantities of a kind, by name; in continuous time those that depend on it, at the instants t."""
        found = self.own_quantity(kind, t)
        if found is None and kind == "input rate":
            found = self.input_rates()
        if found is not None:
            return found
        of_state = kind != "input"
        count = self.nx if of_state else self.nu
        if self.entry_names is not None:
            return Entries(self.entry_names[0 if of_state else 1], range(count), of_state=of_state)
        return Entries([f"{'x' if of_state else 'u'}[{i}]" for i in range(count)], range(count), of_state=of_state)

    def own_quantity(self, kind: str, t: Array | None) -> Quantity | None:
        """Return the same of a kind of the system's own; None of input and state where they have no other names."""

    def input_rates(self) -> Quantity | None:
        """Return the rates of the inputs, where time goes in steps."""


def second_derivative(system: System, x: Array, u: Array, when: Any, z: Array) -> Array:
    """Return `System.curvature`, or raise a `NotImplementedError` that says what is missing."""
    found = system.curvature(x, u, when, z)
    if found is None:
        raise NotImplementedError(
            f"{type(system).__name__} has no second derivative: implement `curvature`, or set "
            "`has_curvature = False` and use a method other than 'newton'."
        )
    return found


def missing_unless(found: Found | None, system: System, method: str) -> Found:
    """Return what an optional method of a system returned, or raise a `NotImplementedError` where it is left out."""
    if found is None:
        raise NotImplementedError(f"{type(system).__name__} has no parameters: implement `{method}`.")
    return found


def returning_entries(system: System, names: Sequence[str], what: str) -> list[int]:
    """Return the places of entries with these names that are the same again in a periodic motion."""
    found = system.returning_entries(names, what)
    return system.free_entries(names, what) if found is None else found


def returning_name(system: System, place: int) -> str:
    """Return the name of one of them."""
    found = system.returning_name(place)
    return system.state_names[place] if found is None else found


def keeps(system: System, base: type, *methods: str) -> bool:
    """Whether a system has methods as a class has them: a subclass with others may not be computed as that class."""
    return all(getattr(type(system), name) is getattr(base, name) for name in methods)


def sizes_of(
    nx: int | None, nu: int | None, names: tuple[Sequence[str], Sequence[str]] | None
) -> tuple[int, int, tuple[tuple[str, ...], tuple[str, ...]] | None]:
    """Return the numbers of states and inputs, and their names where there are some, or raise an `ArgumentError`."""
    if names is None:
        return as_count(nx, "nx", 1), as_count(nu, "nu", 1), None
    given: Any = names
    if isinstance(given, str) or len(given) != 2:
        raise ArgumentError(
            f"names: got {brief(repr(names))}, expected those of the states and those of the inputs, such as "
            "(['x', 'v'], ['push'])"
        )
    found = tuple(
        as_names(each, "names", f"names of {what}") for each, what in zip(names, ("states", "inputs"), strict=True)
    )
    twice = {name for name in (*found[0], *found[1]) if (*found[0], *found[1]).count(name) > 1}
    if twice or not all(found):
        raise ArgumentError(f"names: got {brief(repr(names))}, expected different names of states and of inputs")
    for count, each, what in ((nx, found[0], "nx"), (nu, found[1], "nu")):
        if count is not None and as_count(count, what, 1) != len(each):
            raise ArgumentError(f"{what}: got {count} beside {len(each)} names, expected as many, or leave it out")
    return len(found[0]), len(found[1]), (found[0], found[1])


def space_of(where: System | StateSpace | None) -> StateSpace | None:
    """Return how states differ and move, of a system or as it was given; None of plain vectors."""
    if isinstance(where, System):
        return where.charts()
    return None if isinstance(where, Vectors) else where


def check_system(system: object, kinds: tuple[type[System], ...], sizes: tuple[str, ...]) -> None:
    """Complain about what is no system of these kinds, or one whose sizes are not set.

    Raises `ArgumentError`: naming what was given and what would do.
    """
    name = type(system).__name__
    if not isinstance(system, kinds):
        raise ArgumentError(
            f"system: got {name}, expected a {' or a '.join(kind.__name__ for kind in kinds)}. An integrator "
            "becomes one by MidpointSystem(integrator, t), a mechanism in continuous time by "
            "MechanismSystem(mechanism), functions by FunctionSystem or FunctionContinuousSystem."
        )
    for size in sizes:
        value = getattr(system, size, None)
        if value is None:
            raise ArgumentError(f"system: {name}.{size} is not set; set self.{size} in its __init__, before it is used")
        as_count(value, f"system: {name}.{size}", 0 if size == "nu" else 1)
