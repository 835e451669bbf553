"""Where states live: how two of them differ, and how one is moved.

States that are plain vectors are subtracted and added. Those on a circle, or with a rotation in them, are not: a unit
quaternion has four numbers and moves in three directions. A `StateSpace` says for such states

    ``dx = difference(x, xbar)`` (ndx,)  and  ``x = plus(xbar, dx)``,  inverse to each other: the chart about xbar,

and the optimiser is one over charts: A (ndx, ndx), B (ndx, nu), gains (nu, ndx), gradients and second derivatives of
costs and limits are by the dx of ``plus(x, dx)`` at zero, those of a step read in the chart about the state that it
leads to. So all of them are derivatives between vector spaces.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array, as_count
from leastaction.numerics.differences import fourth_order
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public

Pattern = npt.NDArray[np.bool_]
Flags = npt.NDArray[np.bool_]

_STEP, _SECOND = 1e-3, 1e-2  # steps of first and second differences of charts, of fourth order
_UNIT = 1e-6  # largest error of the length of a unit quaternion


class StateSpace(ABC):
    """How states differ and move; all methods take any number of rows at once. Pure, so threads may share it.

    Subclasses set `nx` and `ndx`, and implement what is abstract.
    """

    __repr__ = printed

    nx: int
    """Numbers of a state."""
    ndx: int
    """Numbers of a difference, directions in which a state moves."""

    @abstractmethod
    def difference(self, x: Array, xbar: Array) -> Array:
        """Return what leads from xbar to x, (..., ndx): ``plus(xbar, difference(x, xbar))`` is x."""

    @abstractmethod
    def plus(self, x: Array, dx: Array) -> Array:
        """Return states x (..., nx) moved by dx (..., ndx)."""

    @abstractmethod
    def plus_derivative(self, x: Array) -> Array:
        """Return the derivatives (..., nx, ndx) of ``plus(x, dx)`` by dx at zero."""

    @abstractmethod
    def plus_curvature(self, x: Array, w: Array) -> Array:
        """Return the second derivatives (..., ndx, ndx) of ``w . plus(x, dx)`` at zero; w (..., nx)."""

    @abstractmethod
    def difference_derivative(self, x: Array, xbar: Array) -> Array:
        """Return the derivatives (..., ndx, ndx) of ``difference(plus(x, dx), xbar)`` by dx at zero."""

    @abstractmethod
    def difference_curvature(self, x: Array, xbar: Array, w: Array) -> Array:
        """Return the second derivatives (..., ndx, ndx) of ``w . difference(plus(x, dx), xbar)``; w (..., ndx)."""

    def changes(self, x: Array) -> Array:
        """Return the derivatives (..., ndx, nx) of ``difference(y, x)`` by the numbers of y at x.

        Numbers may be of no state, as those of a quaternion that an integrator has made longer: what is normal to the
        states is without effect.
        """
        N = self.plus_derivative(x)
        normal = np.swapaxes(N, -1, -2)
        return np.asarray(np.linalg.solve(normal @ N, normal))

    def changes_curvature(self, x: Array, w: Array) -> Array:
        """Return the second derivatives (..., nx, nx) of ``w . difference(y, x)`` by the numbers of y at x."""
        found = self.own_changes_curvature(x, w)
        if found is not None:
            return found
        back = self.changes(x)
        bent = self.plus_curvature(x, np.einsum("...ia,...i->...a", back, w))
        return np.asarray(-np.swapaxes(back, -1, -2) @ bent @ back)

    def own_changes_curvature(self, x: Array, w: Array) -> Array | None:
        """Return the same with what is normal to the states; None where that is without effect here too."""

    @cached_property
    def pattern(self) -> Pattern:
        """Which entries (nx, ndx) of a state a direction may move: all of them, if nothing else is known."""
        return np.ones((self.nx, self.ndx), dtype=np.bool_)

    @cached_property
    def curved(self) -> Flags:
        """In which directions (ndx,) states are more than subtracted and added: all, if nothing else is known.

        By and of the others derivatives of differences are those of plain vectors.
        """
        return np.ones(self.ndx, dtype=np.bool_)

    def check(self, x: Array, what: str) -> None:
        """Raise an `ArgumentError` for states (..., nx) that are none of the space; `what` they are, in messages."""


@public
class Vectors(StateSpace):
    """Plain vectors: subtracted and added. ``n``: their numbers."""

    def __init__(self, n: int) -> None:
        self.nx = self.ndx = as_count(n, "n", 0)
        self.pattern, self.curved = np.eye(self.nx, dtype=np.bool_), np.zeros(self.nx, dtype=np.bool_)

    def difference(self, x: Array, xbar: Array) -> Array:
        return np.asarray(x - xbar)

    def plus(self, x: Array, dx: Array) -> Array:
        return np.asarray(x + dx)

    def plus_derivative(self, x: Array) -> Array:
        return np.broadcast_to(np.eye(self.nx), (*x.shape, self.nx))

    def plus_curvature(self, x: Array, w: Array) -> Array:  # noqa: ARG002
        return np.zeros((*x.shape, self.nx))

    def difference_derivative(self, x: Array, xbar: Array) -> Array:  # noqa: ARG002
        return np.broadcast_to(np.eye(self.nx), (*x.shape, self.nx))

    def difference_curvature(self, x: Array, xbar: Array, w: Array) -> Array:  # noqa: ARG002
        return np.zeros((*x.shape, self.nx))


@public
class Rotations(StateSpace):
    """Rotations as unit quaternions ``[w, x, y, z]``, moved in their own axes: ``plus(q, phi) = q exp(phi)``.

    ``difference(q, qbar)`` is the vector (rad) of the rotation that is missing, smooth up to half a turn.
    """

    nx, ndx = 4, 3

    def difference(self, x: Array, xbar: Array) -> Array:
        return rotations.logarithm(rotations.product(rotations.inverse(xbar), x))

    def plus(self, x: Array, dx: Array) -> Array:
        moved = rotations.product(x, rotations.exponential(dx))
        # Rounding adds up over thousands of steps.
        return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))

    def plus_derivative(self, x: Array) -> Array:
        turns = np.eye(4)[1:]
        return np.stack([0.5 * rotations.product(x, turn) for turn in turns], axis=-1)

    def plus_curvature(self, x: Array, w: Array) -> Array:
        along = np.sum(np.asarray(w) * x, axis=-1)
        return np.asarray(-0.25 * along[..., None, None] * np.eye(3))

    def difference_derivative(self, x: Array, xbar: Array) -> Array:
        return rotations.logarithm_derivative(self.difference(x, xbar))

    def difference_curvature(self, x: Array, xbar: Array, w: Array) -> Array:
        return rotations.logarithm_curvature(self.difference(x, xbar), w)

    def own_changes_curvature(self, x: Array, w: Array) -> Array:
        # x^-1 y = (1 + s, v) is the rotation by 2 v / (1 + s) + O(|v|^3), whatever its length.
        back = _from(x)
        along = np.einsum("...a,...aj->...j", -2.0 * np.asarray(w), back[..., 1:, :])
        bent = back[..., 0, :, None] * along[..., None, :]
        return np.asarray(bent + np.swapaxes(bent, -1, -2))

    def check(self, x: Array, what: str) -> None:
        length = np.linalg.norm(x, axis=-1)
        off = np.abs(length - 1.0)
        if not (off <= _UNIT).all():
            worst = float(np.ravel(length)[int(np.argmax(off))])
            raise ArgumentError(
                f"{what}: got a quaternion of length {worst:.6g}, expected a unit quaternion [w, x, y, z]; divide it "
                "by its length"
            )


@public
class ProductSpace(StateSpace):
    """States of parts: those of the first space, then those of the second, and so on.

    Parameters
    ----------
    *parts : StateSpace
        Such as ``Rotations(), Vectors(3)``.

    Raises
    ------
    ArgumentError
        If there are none, or what is none.
    """

    def __init__(self, *parts: StateSpace) -> None:
        if not parts or not all(isinstance(part, StateSpace) for part in parts):
            got = ", ".join(type(part).__name__ for part in parts) or "nothing"
            raise ArgumentError(f"parts: got {got}, expected spaces such as Rotations(), Vectors(3)")
        self.parts = parts
        self.nx, self.ndx = sum(part.nx for part in parts), sum(part.ndx for part in parts)
        self._at = _slices([part.nx for part in parts])
        self._moved = _slices([part.ndx for part in parts])
        self.curved = np.concatenate([part.curved for part in parts])
        self.pattern = np.zeros((self.nx, self.ndx), dtype=np.bool_)
        for part, at, by in zip(parts, self._at, self._moved, strict=True):
            self.pattern[at, by] = part.pattern

    def difference(self, x: Array, xbar: Array) -> Array:
        each = zip(self.parts, self._at, strict=True)
        return np.concatenate([part.difference(x[..., at], xbar[..., at]) for part, at in each], axis=-1)

    def plus(self, x: Array, dx: Array) -> Array:
        each = zip(self.parts, self._at, self._moved, strict=True)
        return np.concatenate([part.plus(x[..., at], dx[..., by]) for part, at, by in each], axis=-1)

    def plus_derivative(self, x: Array) -> Array:
        return self._blocks([part.plus_derivative(x[..., at]) for part, at in self._each()], self._at)

    def plus_curvature(self, x: Array, w: Array) -> Array:
        return self._blocks([part.plus_curvature(x[..., at], w[..., at]) for part, at in self._each()], self._moved)

    def difference_derivative(self, x: Array, xbar: Array) -> Array:
        found = [part.difference_derivative(x[..., at], xbar[..., at]) for part, at in self._each()]
        return self._blocks(found, self._moved)

    def difference_curvature(self, x: Array, xbar: Array, w: Array) -> Array:
        each = zip(self.parts, self._at, self._moved, strict=True)
        found = [part.difference_curvature(x[..., at], xbar[..., at], w[..., by]) for part, at, by in each]
        return self._blocks(found, self._moved)

    def own_changes_curvature(self, x: Array, w: Array) -> Array:
        each = zip(self.parts, self._at, self._moved, strict=True)
        whole = np.zeros((*x.shape, self.nx))
        for part, at, by in each:
            whole[..., at, at] = part.changes_curvature(x[..., at], w[..., by])
        return whole

    def check(self, x: Array, what: str) -> None:
        for part, at in self._each():
            part.check(x[..., at], what)

    def _each(self) -> list[tuple[StateSpace, slice]]:
        return list(zip(self.parts, self._at, strict=True))

    def _blocks(self, parts: list[Array], rows: list[slice]) -> Array:
        """Return matrices (..., n, ndx) of blocks along the diagonal."""
        whole = np.zeros((*parts[0].shape[:-2], rows[-1].stop, self.ndx))
        for part, at, by in zip(parts, rows, self._moved, strict=True):
            whole[..., at, by] = part
        return whole


class DifferencedSpace(StateSpace):
    """A space of which two functions are all that is known: derivatives are differences of fourth order.

    Good to about ten digits, second ones to seven. ``difference``, ``plus``: for one state at least; for any number of
    rows at once, which is much faster, where they do for rows what they do for each.
    """

    def __init__(self, nx: int, ndx: int, difference: Callable[..., Any], plus: Callable[..., Any]) -> None:
        self.nx, self.ndx = nx, ndx
        self._difference, self._plus = difference, plus

    def difference(self, x: Array, xbar: Array) -> Array:
        return self._rows(self._difference, self.ndx, x, xbar)

    def plus(self, x: Array, dx: Array) -> Array:
        return self._rows(self._plus, self.nx, x, dx)

    def plus_derivative(self, x: Array) -> Array:
        return self._differences(lambda dx: self.plus(x, dx), x.shape[:-1])

    def plus_curvature(self, x: Array, w: Array) -> Array:
        return self._second(lambda dx: np.sum(w * self.plus(x, dx), axis=-1), x.shape[:-1])

    def difference_derivative(self, x: Array, xbar: Array) -> Array:
        return self._differences(lambda dx: self.difference(self.plus(x, dx), xbar), x.shape[:-1])

    def difference_curvature(self, x: Array, xbar: Array, w: Array) -> Array:
        return self._second(lambda dx: np.sum(w * self.difference(self.plus(x, dx), xbar), axis=-1), x.shape[:-1])

    def _rows(self, function: Callable[..., Any], n: int, a: Array, b: Array) -> Array:
        """Call a function that may be one of single states."""
        a, b = np.asarray(a), np.asarray(b)
        shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
        rows = [np.broadcast_to(each, (*shape, each.shape[-1])).reshape(-1, each.shape[-1]) for each in (a, b)]
        if not shape:
            return np.asarray(function(a, b), dtype=np.float64)
        ends = {i: np.asarray(function(rows[0][i], rows[1][i]), dtype=np.float64) for i in (0, len(rows[0]) - 1)}
        try:
            found = np.asarray(function(*rows), dtype=np.float64)
            at_once = found.shape == (len(rows[0]), n)
            at_once = at_once and all(np.allclose(found[i], end, rtol=1e-12, atol=1e-14) for i, end in ends.items())
        except (TypeError, ValueError, IndexError, ArithmeticError):
            at_once = False
        if not at_once:
            found = np.array([function(one, other) for one, other in zip(*rows, strict=True)], dtype=np.float64)
        return np.asarray(found.reshape(*shape, n))

    def _differences(self, function: Callable[[Array], Array], shape: tuple[int, ...]) -> Array:
        eye = np.eye(self.ndx)

        def along(j: int) -> Array:
            return fourth_order(lambda by: function(np.broadcast_to(by * eye[j], (*shape, self.ndx))), _STEP)

        return np.stack([along(j) for j in range(self.ndx)], axis=-1)

    def _second(self, function: Callable[[Array], Array], shape: tuple[int, ...]) -> Array:
        eye, n = np.eye(self.ndx), self.ndx

        def slope(i: int, at: Array) -> Array:
            return fourth_order(lambda by: function(np.broadcast_to(by * eye[i] + at, (*shape, n))), _SECOND)

        def mixed(i: int, j: int, by: float) -> Array:
            return slope(i, by * eye[j])

        bent = np.empty((*shape, n, n))
        for i in range(n):
            for j in range(i, n):
                bent[..., i, j] = bent[..., j, i] = fourth_order(partial(mixed, i, j), _SECOND)
        return bent


def _from(x: Array) -> Array:
    """Return the matrices (..., 4, 4) of ``x^-1 y`` by the numbers of y."""
    square = np.sum(x * x, axis=-1)[..., None, None]
    return np.asarray(np.stack([rotations.product(rotations.inverse(x), e) for e in np.eye(4)], axis=-1) / square)


def _slices(sizes: Sequence[int]) -> list[slice]:
    return [slice(start, stop) for start, stop in pairwise(np.cumsum([0, *sizes]).tolist())]


def parts_of(space: StateSpace) -> list[StateSpace]:
    """Return the parts that a space is made of, one after the other, none of them a product."""
    if not isinstance(space, ProductSpace):
        return [space]
    return [inner for part in space.parts for inner in parts_of(part)]


def of_unit_length(space: StateSpace | None, x: Array) -> Array:
    """Return a state (nx,) whose quaternions are divided by their lengths, as where they were measured."""
    x, first = x.copy(), 0
    for part in [] if space is None else parts_of(space):
        if isinstance(part, Rotations):
            x[first : first + 4] /= np.linalg.norm(x[first : first + 4])
        first += part.nx
    return x


# ---- What follows from charts -----------------------------------------------------------------------------------


def apart(space: StateSpace | None, x: Array, xbar: Array) -> Array:
    """Return the differences of states; of plain vectors where there is no space."""
    return x - xbar if space is None else space.difference(x, xbar)


def moved_by(space: StateSpace | None, x: Array, dx: Array) -> Array:
    """Return states moved by differences, likewise."""
    return x + dx if space is None else space.plus(x, dx)


def sizes_of(space: StateSpace | None, x: Array) -> Array:
    """Return what is large for the entries of differences (ndx,) along states x (n, nx): 1 and their largest."""
    size = np.abs(x)
    if space is not None:
        size = np.einsum("kai,ka->ki", np.abs(space.plus_derivative(x)), size)
    return np.asarray(1.0 + size.max(axis=0))


# ---- Derivatives by the numbers of states, as continuous time takes them ----------------------------------------


def by_numbers(space: StateSpace | None, x: Array, J: Array) -> Array:
    """Return derivatives (n, m, nx + k) by the numbers of states x (n, nx) of those (n, m, ndx + k) by differences."""
    if space is None:
        return J
    own, rest = J[..., : space.ndx], J[..., space.ndx :]
    return np.concatenate([own @ space.changes(x), rest], axis=-1)


def bent_by_numbers(space: StateSpace | None, x: Array, slope: Array, H: Array) -> Array:
    """Return second derivatives (n, nx + k, nx + k) likewise, of a function with this slope (n, ndx + k)."""
    if space is None:
        return H
    nx, ndx = space.nx, space.ndx
    half = by_numbers(space, x, H)
    out = by_numbers(space, x, np.swapaxes(half, -1, -2))
    out[..., :nx, :nx] += space.changes_curvature(x, slope[..., :ndx])
    return out
