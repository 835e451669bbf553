"""What is read of a state, and covariances by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.discrete.trajectory import State
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.differences import central_differences
from leastaction.numerics.names import matching
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.quantity import Quantity, Samples
from leastaction.optimal.system import System

Measured = str | Sequence[str] | Quantity | Callable[[Array], ArrayLike] | ArrayLike
"""Entries of the state by name, a quantity of the state, a function of the state, or a matrix (ny, nx)."""

Stated = ArrayLike | State | Mapping[str, float]
"""A state (nx,) by its numbers, by name (what is not named is zero, or not turned), or the `State` of a mechanism."""

Spread = float | ArrayLike | Mapping[str, float]
"""Standard deviations: one for all, one for each, by name with wildcards; or a covariance matrix (n, n)."""


class Readings:
    """What sensors read of a state, with its derivatives. It has no state of its own.

    ``measure``: Entries of the state by name, with wildcards (``["elbow", "p_*"]``); a `Quantity` of the state, such as
    a `FunctionQuantity`; a function ``y = h(x)`` of the state (nx,), which is differentiated by differences; or a
    matrix (ny, nx). Raises `ArgumentError`: an unknown name, or what is none of these.
    """

    def __init__(self, system: System, measure: Measured) -> None:
        self.nx, self.space = system.nx, system.charts()
        self._quantity: Quantity | None = None
        self._function: Callable[[Array], ArrayLike] | None = None
        self._matrix: Array | None = None
        if isinstance(measure, Quantity):
            if not measure.of_state:
                raise ArgumentError(
                    f"measure: got the quantity {measure.names[0]!r}, which is none of the state alone, expected one "
                    "with of_state=True; or give a function of the state"
                )
            self._quantity, self.names = measure, measure.names
        elif callable(measure):
            self._function = measure
            count = len(as_array(measure(read_only(np.zeros(self.nx))), "measure(x)", (None,), meaning="(ny,)"))
            self.names = tuple(f"y[{i}]" for i in range(count))
        else:
            self.names, self._matrix = _chosen(system, measure)
        self.ny = len(self.names)
        stems = {name.removesuffix(".qw") for name in self.names if name.endswith(".qw")}
        each = ([f"{stem}.q{letter}" for letter in "wxyz"] for stem in stems)
        self._quaternions = [[self.names.index(one) for one in four] for four in each if set(four) <= set(self.names)]

    def __call__(self, x: Array, k: int = 0) -> Array:
        """Return the readings (ny,) of a state, without noise."""
        if self._matrix is not None:
            return np.asarray(self._matrix @ x)
        if self._function is not None:
            return as_array(self._function(read_only(x)), "measure(x)", (self.ny,), meaning="(ny,)")
        assert self._quantity is not None
        return np.asarray(self._quantity.values(self._at(x, k))[0])

    def given(self, y: ArrayLike, x: Array, k: int = 0) -> Array:
        """Return readings (ny,) as an array of their own, given where the state is believed to be.

        A quaternion and its negative are the same rotation: here the nearer of both.

        Raises `ArgumentError`: a wrong shape, or numbers that are not finite.
        """
        out = of_an_instant(y, "y", self.names)
        for four in self._quaternions:
            out[four] *= 1.0 if out[four] @ self(x, k)[four] >= 0.0 else -1.0
        return out

    def jacobian(self, x: Array, k: int = 0) -> Array:
        """Return their derivatives (ny, ndx) by the directions in which a state moves."""
        slopes = self._slopes(x, k)
        directed = self.space is None or (self._quantity is not None and not self._quantity.by_entries)
        return slopes if directed or self.space is None else np.asarray(slopes @ self.space.plus_derivative(x))

    def _slopes(self, x: Array, k: int) -> Array:
        """Return their derivatives (ny, nx) by the numbers of a state, of some quantities (ny, ndx) by directions."""
        if self._matrix is not None:
            return self._matrix
        if self._function is not None:
            function = self._function
            return np.asarray(central_differences(lambda state: np.asarray(function(state)), x))
        assert self._quantity is not None
        n = self.nx if self.space is None or self._quantity.by_entries else self.space.ndx
        return np.asarray(self._quantity.whole_jacobian(self._at(x, k), n, 0)[0])

    def _at(self, x: Array, k: int) -> Samples:
        nothing = np.empty((1, 0))
        return Samples(np.array([k], dtype=np.intp), read_only(x[None]), nothing, nothing)


def of_an_instant(value: ArrayLike, what: str, names: Sequence[str]) -> Array:
    """Return what an estimator is given at one instant, inputs or readings (n,) of these names, as an array of its own.

    Raises `ArgumentError`: a wrong shape, or numbers that are not finite.
    """
    return as_array(value, what, (len(names),), names=names).copy()


def _chosen(system: System, measure: Any) -> tuple[tuple[str, ...], Array]:
    """Return names and matrix of readings that are linear."""
    names = system.state_names
    given = (measure,) if isinstance(measure, str) else measure
    if isinstance(given, (list, tuple)) and given and all(isinstance(name, str) for name in given):
        places = [place for name in given for place in system.free_entries([name], "measure")]
        return tuple(names[i] for i in places), np.eye(system.nx)[places]
    C = as_array(measure, "measure", (None, system.nx), meaning="(ny, nx); or give names of entries of the state")
    return tuple(f"y[{i}]" for i in range(len(C))), C.copy()


def covariance(spread: Spread, names: Sequence[str], what: str, *, definite: bool) -> Array:
    """Return a covariance (n, n) by standard deviations: one, (n,), by name, or a covariance matrix (n, n).

    ``definite``: whether it has to be positive. Raises `ArgumentError`: wrong shapes, unknown names, negative numbers.
    """
    n = len(names)
    if isinstance(spread, Mapping):
        deviations = np.zeros(n)
        for name, value in spread.items():
            places = matching(names, name)
            if not places:
                raise unknown("name", name, names, what)
            deviations[places] = value
        return _checked(np.diag(deviations**2), what, definite=definite and bool((deviations <= 0.0).any()))
    given = as_array(spread, what, (), (n,), (n, n), meaning=f"() or ({n},) standard deviations, or a covariance")
    if given.ndim < 2 and (given < 0.0).any():
        raise ArgumentError(f"{what}: got a standard deviation of {given.min():.3g}, expected none below zero")
    if given.ndim < 2:
        return _checked(np.diag(np.broadcast_to(given, (n,)) ** 2), what, definite=definite)
    return _checked(given, what, definite=definite)


def covariance_of_states(spread: Spread, system: System, what: str) -> Array:
    """Return a covariance (ndx, ndx) of what a state of a system is off by; names are those of its entries.

    Of states that are no plain vectors every direction counts for a name that moves an entry of that name.
    """
    names, space = system.state_names, system.charts()
    if space is None or not isinstance(spread, Mapping):
        count = names if space is None else tuple(f"dx[{i}]" for i in range(system.ndx))
        return covariance(spread, count, what, definite=False)
    deviations = np.zeros(system.ndx)
    for name, value in spread.items():
        places = system.free_entries([name], what)
        deviations[space.pattern[places].any(axis=0)] = value
    return np.diag(deviations**2)


def _checked(matrix: Array, what: str, *, definite: bool) -> Array:
    values = np.linalg.eigvalsh(matrix) if matrix.size else np.ones(1)
    if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-9 * np.abs(matrix).max(initial=0.0):
        raise ArgumentError(f"{what}: got a covariance that is not symmetric, expected a symmetric one")
    if values[0] < -1e-12 * max(values[-1], 0.0) or (definite and values[0] <= 0.0):
        raise ArgumentError(
            f"{what}: got a covariance with the eigenvalue {values[0]:.3g}, expected a positive "
            f"{'definite' if definite else 'semidefinite'} one"
        )
    return matrix.copy()


def step_of(system: DiscreteSystem, k: int) -> int:
    """Return which of a system's steps stands for step k: its last for all that come after its horizon."""
    return min(k, system.N - 1)
