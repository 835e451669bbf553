"""Limits as the optimiser takes them: rows ``c >= 0`` at some instants, with their derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leastaction import _core
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.quantity import Entries, Instants, Quantity, Samples, as_slice

_OFF = 1e-6  # of what is large for it a limit may be off at a fixed initial state
_ROUNDING = 1e-9  # part of a bound over time by which it may differ and be told as one number


class Weights:
    """What rows that are no single entries add to the second derivative of a cost.

    In memory that is used again by the next sum after `clear`. ``columns`` (m,): the places in ``(x, u)`` by which they
    depend on them, ascending. ``matrices`` (N+1, m, m): by the columns, of all instants.
    """

    def __init__(self, N: int, columns: Instants) -> None:
        self.columns = columns
        self.matrices = np.zeros((N + 1, len(columns), len(columns)))

    def clear(self) -> None:
        """Begin another sum."""
        self.matrices.fill(0.0)

    def add(self, k: Instants, columns: Instants, jacobian: Array, sigma: Array, bent: Array | None) -> None:
        """Add ``J' sigma J - bent`` (n, c, c) by some of the columns, at instants; J (n, m, c), sigma (n, m)."""
        places = np.searchsorted(self.columns, columns)
        _core.add_limit_rows(np.ascontiguousarray(jacobian), sigma, bent, k, places, self.matrices)


@dataclass(frozen=True, eq=False)
class Rows:
    """``sign (quantity - bounds) >= 0`` at the instants k.

    Attributes
    ----------
    limit : str
        What they came from.
    quantity : Quantity
        Of m functions.
    sign : float
        1 for least values, -1 for largest ones.
    bounds : ndarray (n, m)
    k : ndarray of int (n,)
        Instants of a quantity of the state, steps of any other.
    scale : ndarray (m,)
        What is large, in the quantity's unit; 0 where that is to be seen from where the optimisation starts.
    equal : bool
        Whether these are one side of equations, whose other side follows.
    is_own : bool
        Whether the quantity is one of the user's own, and not the system's.
    start : ndarray (m,) or None
        Bounds that the fixed initial state has to keep to; None where nothing is asked of it.
    is_asked : bool
        Whether a user asked for it; else there is no such system beyond it.
    worth : ndarray (m,) or None
        What a unit of the quantity itself costs, so that an excess has to be dearer; None where that is not known.
    """

    limit: str
    quantity: Quantity
    sign: float
    bounds: Array
    k: Instants
    scale: Array
    equal: bool = False
    is_own: bool = False
    start: Array | None = None
    is_asked: bool = True
    worth: Array | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column says."""
        return self._labels(self.bounds)

    def _labels(self, bounds: Array) -> tuple[str, ...]:
        if self.quantity.says_all and not bounds.any():
            return self.quantity.names
        relation = "=" if self.equal else ">=" if self.sign > 0.0 else "<="
        least, most = bounds.min(axis=0), bounds.max(axis=0)
        unit = f" {self.quantity.unit}" if self.quantity.unit else ""
        kind = f"{self.quantity.kind} " if self.quantity.kind else ""
        same = np.abs(most - least) <= _ROUNDING * np.abs(most)  # of times that are no round numbers
        return tuple(
            f"{kind}{name} {relation} {a:.6g}{unit}" if once else f"{kind}{name} {relation} {a:.4g} .. {b:.4g}{unit}"
            for name, a, b, once in zip(self.quantity.names, least, most, same.tolist(), strict=True)
        )

    def values(self, x: Array, u: Array) -> Array:
        """Return c (n, m) along a trajectory."""
        return np.asarray(self.sign * (self.quantity.values(self._at(x, u)) - self.bounds))

    def check(self, x: Array, u: Array) -> None:
        """Ask a quantity for its derivatives, so that what is wrong with them is said before the first step.

        Raises
        ------
        ArgumentError
            From the quantity.
        """
        if isinstance(self.quantity, Entries):
            return  # nothing can be wrong with these
        k, x, u, x_next = self._at(x, u)
        at = Samples(k[:1], x[:1], u[:1], x_next[:1])
        self.quantity.jacobian(at)
        self.quantity.curvature(at, np.ones((1, len(self.quantity.names))))

    def check_values(self, c: Array, when: Callable[[int], str]) -> None:
        """Complain about values (n, m) along the motion to start from that are no numbers.

        ``when``: how to speak of an instant.

        Raises
        ------
        ArgumentError
            If there are some.
        """
        if np.isfinite(c).all():
            return
        i, j = np.argwhere(~np.isfinite(c))[0]
        raise ArgumentError(
            f"{self.limit}: {self.labels[j]!r} got {c[i, j]} at {when(int(self.k[i]))} of the motion to start from, "
            "expected a finite number. Start where its function is defined, or state it as one that is defined "
            "everywhere"
        )

    def check_start(self, x: Array) -> None:
        """Complain about a fixed initial state (nx,) that is outside of the limit.

        Raises
        ------
        ArgumentError
            It is off by more than rounding.
        """
        if self.start is None:
            return
        nothing = np.empty((1, 0))
        value = self.quantity.values(Samples(np.zeros(1, dtype=np.intp), x[None], nothing, nothing))[0]
        size = np.where(self.scale > 0.0, self.scale, 1.0 + np.abs(self.start))
        room = self.sign * (value - self.start)
        j = int(np.argmin(room / size))
        if room[j] < -_OFF * size[j]:
            unit = f" {self.quantity.unit}" if self.quantity.unit else ""
            label = self._labels(self.start[None])[j]
            raise ArgumentError(
                f"{self.limit}: the initial state is fixed and violates {label!r} by {-room[j]:.4g}{unit}. Begin where "
                "it holds, have the initial state found too (free_start), or ask for it at later instants only (`at`, "
                "or bounds over the instants from the second on)"
            )

    def bends(self, x: Array, u: Array) -> bool:
        """Whether the quantity is not linear."""
        k, x, u, x_next = self._at(x, u)
        at = Samples(k[:1], x[:1], u[:1], x_next[:1])
        return self.quantity.curvature(at, np.ones((1, len(self.quantity.names)))) is not None

    def rises(self, c: Array, x: Array, u: Array) -> NDArray[np.bool_]:
        """Return which columns (m,) bend upwards where their values c (n, m) are least: as those of an obstacle do."""
        found = np.zeros(c.shape[1], dtype=np.bool_)
        for j, _, _, bent in self._bent_where_least(c, x, u):
            found[j] = np.trace(bent) > 0.0
        return found

    def depths(self, c: Array, x: Array, u: Array) -> Array:
        """Return how deep columns (m,) are that bend upwards where their values c (n, m) are least; infinity of others.

        Along its gradient, to second order: of a ball that is twice what its middle violates, its radius.
        """
        found = np.full(c.shape[1], np.inf)
        for j, least, here, bent in self._bent_where_least(c, x, u):
            g = self.quantity.jacobian(here)[0, j]
            bend = float(g @ bent @ g)
            if bend > 0.0:
                depth = float(g @ g) ** 2 / bend - 2.0 * least
                found[j] = depth if depth > 0.0 else np.inf
        return found

    def _bent_where_least(self, c: Array, x: Array, u: Array) -> Iterator[tuple[int, float, Samples, Array]]:
        """Yield each column that bends: its index, its least value, where that is, and its second derivative there."""
        k, *values = self._at(x, u)
        for j, at in enumerate(np.argmin(c, axis=0)):
            here = Samples(k[at : at + 1], *(each[at : at + 1] for each in values))
            bent = self.quantity.curvature(here, self.sign * np.eye(c.shape[1])[j : j + 1])
            if bent is not None:
                yield j, float(c[at, j]), here, bent[0]

    def jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the quantity along a trajectory (n, m, ...), without the sign."""
        return self.quantity.jacobian(self._at(x, u))

    def add_gradient(self, jacobian: Array, y: Array, q: Array, r: Array) -> None:
        """Subtract ``y . dc`` from the gradients q (N+1, nx), r (N, nu)."""
        nx, nu = q.shape[1], r.shape[1]
        pull = np.einsum("kmi,km->ki", jacobian, self.sign * y)
        columns, nz = self.columns(nx, nu), nx + nu
        at, after = self._part, self._part_after
        for target, k, low, high in ((q, at, 0, nx), (r, at, nx, nz), (q, after, nz, nz + nx)):
            here = (columns >= low) & (columns < high)
            if here.any():
                index = _index(k, columns[here] - low)
                if self.quantity.looks_ahead:  # a place may come twice
                    np.subtract.at(target, index, pull[:, here])
                else:
                    target[index] -= pull[:, here]

    def add_hessian(
        self,
        x: Array,
        u: Array,
        jacobian: Array,
        y: Array | None,
        sigma: Array,
        to: Weights,
        dynamics: Array | None,
        *,
        nx: int | None = None,
    ) -> None:
        """Add ``dc' sigma dc - y . d2c``.

        Parameters
        ----------
        x, u : ndarray
        jacobian : ndarray
            Of the quantity along them.
        y : ndarray (n, m) or None
            Duals; None to leave out what bends.
        sigma : ndarray (n, m)
            Stiffness.
        to : Weights
        dynamics : ndarray (N, nx, nx+nu) or None
            ``[A B]``, for what looks ahead.
        nx : int, optional
            Entries of a difference of states; those of a state if left out.
        """
        nx = x.shape[1] if nx is None else nx
        nz = nx + u.shape[1]
        columns = self.columns(nx, u.shape[1])
        bent = None if y is None else self.quantity.curvature(self._at(x, u), self.sign * y)
        ahead = columns >= nz
        if ahead.any():
            assert dynamics is not None
            moves = np.zeros((len(self.k), len(columns), nz))
            moves[:, np.flatnonzero(~ahead), columns[~ahead]] = 1.0
            moves[:, ahead] = dynamics[self.k][:, columns[ahead] - nz]
            jacobian, columns = jacobian @ moves, np.arange(nz)
            bent = None if bent is None else moves.transpose(0, 2, 1) @ bent @ moves
        to.add(self.k, columns, jacobian, sigma, bent)

    def along(self, jacobian: Array, dx: Array, du: Array) -> Array:
        """Return ``dc (n, m)`` along a direction."""
        nx, nu, at, after = dx.shape[1], du.shape[1], self._part, self._part_after
        columns, nz = self.columns(nx, nu), nx + nu
        moved = np.empty((len(self.k), len(columns)))
        for source, k, low, high in ((dx, at, 0, nx), (du, at, nx, nz), (dx, after, nz, nz + nx)):
            here = (columns >= low) & (columns < high)
            if here.any():
                moved[:, here] = source[_index(k, columns[here] - low)]
        return np.asarray(self.sign * np.einsum("kmi,ki->km", jacobian, moved))

    def weighs(self, nx: int, nu: int) -> Instants:
        """Return the places in (x, u) by which it adds to second derivatives: all of them where it looks ahead."""
        columns = self.columns(nx, nu)
        return np.arange(nx + nu) if (columns >= nx + nu).any() else columns

    def columns(self, nx: int, nu: int) -> Instants:
        """Return the places in (x, u, x_next) in which derivatives are given."""
        return self.quantity.all_columns(nx, nu)

    def _at(self, x: Array, u: Array) -> Samples:
        k, at, after = self.k, self._part, self._part_after
        # What a quantity is given cannot be written to.
        if self.quantity.of_state:
            nothing = np.empty((len(k), 0))
            return Samples(k, read_only(x[at]), nothing, nothing)
        return Samples(k, read_only(x[at]), read_only(u[at]), read_only(x[after]))

    @cached_property
    def _part(self) -> Instants | slice:
        """The instants."""
        return as_slice(self.k)

    @cached_property
    def _part_after(self) -> Instants | slice:
        """The instants after them."""
        at = self._part
        return slice(at.start + 1, at.stop + 1) if isinstance(at, slice) else at + 1


def _index(k: Instants | slice, columns: Instants) -> Any:
    """Return the index of some columns at instants."""
    return (k, columns) if isinstance(k, slice) else np.ix_(k, columns)


def _said(rows: Rows) -> str:
    """Return what rows say, in short."""
    return " & ".join(repr(label) for label in rows.labels[:2]) + ", ..." * (len(rows.labels) > 2)


def _is_positive(rows: Rows) -> bool:
    """Whether rows ask for no more than that their quantity is not negative."""
    return rows.sign > 0.0 and not rows.equal and not rows.bounds.any()


def check_agreement(rows: Sequence[Rows], when: Callable[[int], str]) -> None:
    """Look for two limits that no value of the same quantity of the system can meet at some instant, nor any place.

    ``when``: how to speak of an instant.

    Raises
    ------
    ArgumentError
        If there are some.
    """
    # Of entries nothing is known of the kind.
    kinds = [row for row in rows if _is_positive(row) and not isinstance(row.quantity, Entries)]
    for one, other in itertools.combinations(kinds, 2):
        common = np.intersect1d(one.k, other.k)
        apart = one.quantity.apart(other.quantity, common)
        if apart is not None and (apart > _OFF).any():
            at = int(np.argmax(apart > _OFF))
            raise ArgumentError(
                f"limits: {_said(one)} and {_said(other)} exclude each other at {when(int(common[at]))}: what they ask "
                f"for is {apart[at]:.4g} apart; expected limits that can be met together"
            )
    stated = [row for row in rows if not row.is_own]  # what users have may share a name
    lows, highs = ([row for row in stated if sign * row.sign > 0.0] for sign in (1.0, -1.0))
    for low, high in itertools.product(lows, highs):
        below, above = low.quantity, high.quantity
        names = [name for name in below.names if name in above.names]
        if not names or (below.kind, below.of_state) != (above.kind, above.of_state) or low.bounds is high.bounds:
            continue
        of_low: Any = slice(None)
        of_high: Any = slice(None)
        if not np.array_equal(low.k, high.k):
            _, of_low, of_high = np.intersect1d(low.k, high.k, return_indices=True)
        least = low.bounds[of_low][:, [below.names.index(name) for name in names]]
        most = high.bounds[of_high][:, [above.names.index(name) for name in names]]
        crossed = np.argwhere(least > most + _OFF * (1.0 + np.abs(most)))
        if crossed.size:
            at, j = crossed[0]
            raise ArgumentError(
                f"limits: {low.limit} asks for {names[j]!r} of {least[at, j]:.6g} or more at "
                f"{when(int(low.k[of_low][at]))}, and {high.limit} for {most[at, j]:.6g} or less; expected limits "
                "that can be met together"
            )
