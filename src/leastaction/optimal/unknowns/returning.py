"""What of a state returns in a periodic motion: plain entries, and rotations as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array
from leastaction.optimal.limits.charts import NumberedQuantity
from leastaction.optimal.quantity import Instants, Quantity, Samples
from leastaction.optimal.space import ProductSpace, Rotations, StateSpace, Vectors, parts_of
from leastaction.optimal.system import System


class Returning(NamedTuple):
    """Where what returns is in a state.

    ``numbers``, ``moves`` (m,): of plain entries, and the directions of a state that move them. ``turns``: of each
    rotation its first number, and its first direction.
    """

    numbers: Instants
    moves: Instants
    turns: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, system: System, places: Sequence[int], what: str) -> Returning:
        """Return the entries of a system's state at these places, sorted.

        Raises `ArgumentError`: some of the numbers of a rotation without the others, and for states of another space
        than vectors and rotations; `what` asks.
        """
        chosen, numbers, moves, turns = set(places), list[int](), list[int](), list[tuple[int, int]]()
        space: StateSpace = system.charts() or Vectors(system.nx)
        number = move = 0
        for part in parts_of(space):
            among = sorted(chosen.intersection(range(number, number + part.nx)))
            if isinstance(part, Vectors):
                numbers += among
                moves += [i - number + move for i in among]
            elif among and not isinstance(part, Rotations):
                raise ArgumentError(
                    f"{what}: got entries of a {type(part).__name__}, expected some of vectors and rotations "
                    "(`Vectors`, `Rotations`), as a difference from the first state is one of these"
                )
            elif 0 < len(among) < part.nx:
                names = system.quantity("state").names
                raise ArgumentError(
                    f"{what}: {names[among[0]]!r} is one of the four numbers of a rotation, which returns as a whole: "
                    f"expected all of {', '.join(map(repr, names[number : number + 4]))}, or none"
                )
            elif among:
                turns.append((number, move))
            number, move = number + part.nx, move + part.ndx
        return cls(np.array(numbers, dtype=np.intp), np.array(moves, dtype=np.intp), tuple(turns))


class TurnedBack(Quantity):
    """The rotations that are missing of states, each from another that stands in the state as well: ``log(c^-1 q)``.

    ``names``: three of each. ``at``, ``moves`` (n, 2): of each rotation q and of c its first number, and its first
    direction.
    """

    of_state = True
    kind, unit = "return of", "rad"

    def __init__(self, names: Sequence[str], at: Instants, moves: Instants) -> None:
        self.names, self.at, self.moves = tuple(names), at, moves

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        """Return the directions of each rotation, then those of the other."""
        return np.asarray((self.moves[:, :, None] + np.arange(3)).ravel())

    def values(self, at: Samples) -> Array:
        return np.concatenate([self._missing(at, i) for i in range(len(self.at))], axis=1)

    def jacobian(self, at: Samples) -> Array:
        n, m = len(at.k), len(self.at)
        out = np.zeros((n, m, 3, m, 2, 3))
        for i in range(m):
            e = self._missing(at, i)
            out[:, i, :, i, 0] = rotations.logarithm_derivative(e)
            out[:, i, :, i, 1] = -rotations.logarithm_derivative(-e)
        return out.reshape(n, 3 * m, 6 * m)

    def curvature(self, at: Samples, y: Array) -> Array:
        n, m = len(at.k), len(self.at)
        out = np.zeros((n, m, 2, 3, m, 2, 3))
        for i in range(m):
            e, w = self._missing(at, i), y[:, 3 * i : 3 * i + 3]
            mixed = rotations.logarithm_mixed(e, w)
            out[:, i, 0, :, i, 0] = rotations.logarithm_curvature(e, w)
            out[:, i, 1, :, i, 1] = -rotations.logarithm_curvature(-e, w)
            out[:, i, 1, :, i, 0], out[:, i, 0, :, i, 1] = mixed, mixed.swapaxes(1, 2)
        return out.reshape(n, 6 * m, 6 * m)

    def _missing(self, at: Samples, i: int) -> Array:
        q, c = (at.x[:, first : first + 4] for first in self.at[i].tolist())
        return rotations.logarithm(rotations.product(rotations.inverse(c), q))


class TurnedByNumbers(Quantity):
    """The rotation that is missing from ``c`` to ``y + c``, by the numbers of y and c: ``log(c^-1 (y + c))``.

    ``names``: three. ``places`` (8,): of y and of c in the state.
    """

    of_state = by_entries = True
    kind, unit = "return of", "rad"

    def __init__(self, names: Sequence[str], places: Instants) -> None:
        self.names, self.places = tuple(names), places
        both = TurnedBack(names, np.array([[0, 4]]), np.array([[0, 3]]))
        self._turned = NumberedQuantity(both, ProductSpace(Rotations(), Rotations()))
        self._moves = np.block([[np.eye(4), np.eye(4)], [np.zeros((4, 4)), np.eye(4)]])

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        """Return the places of y, then of c."""
        return self.places

    def values(self, at: Samples) -> Array:
        return self._turned.values(self._both(at))

    def jacobian(self, at: Samples) -> Array:
        return np.asarray(self._turned.jacobian(self._both(at)) @ self._moves)

    def curvature(self, at: Samples, y: Array) -> Array:
        return np.asarray(self._moves.T @ self._turned.curvature(self._both(at), y) @ self._moves)

    def _both(self, at: Samples) -> Samples:
        """Return the samples with both rotations, y + c and c, for their states."""
        return at._replace(x=at.x[:, self.places] @ self._moves.T)
