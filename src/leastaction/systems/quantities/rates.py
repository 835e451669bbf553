"""Mean rates of variables over steps, those of turns among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants, Quantity, Samples


class Rates(Quantity):
    """Mean rates of variables over steps, ``(q_{k+1} - q_k) / dt``.

    Of turns of a rotation that is a quaternion ``log(q_k^-1 q_{k+1}) / dt``. ``which``: places of the variables.
    ``moved``: the directions of a state that they depend on.
    """

    kind = "rate of"
    looks_ahead = True

    def __init__(self, mechanism: Mechanism, which: Instants, dt: Array) -> None:
        m = mechanism
        self.mechanism, self.which, self.dt = m, which, dt
        self.names = tuple(m.variables[i] for i in which)
        turns = {m.variables.index(each.variables[0]): each for each in m.tree.rotations}
        of = {first + axis: first for first in turns for axis in range(3)}
        plain = [row for row, i in enumerate(which) if i not in of]
        self._plain = np.array(plain, dtype=np.intp)
        self._coordinates = np.array([m.coordinates.index(self.names[row]) for row in plain], dtype=np.intp)
        turned = list(dict.fromkeys(of[i] for i in which.tolist() if i in of))
        moved = {*which[self._plain].tolist(), *(first + axis for first in turned for axis in range(3))}
        self.moved = np.array(sorted(moved), dtype=np.intp)
        # Of each rotation: its quaternion's place, its rows, their axes, and its directions among those that count.
        self._turned = []
        for first in turned:
            rows = [row for row, i in enumerate(which) if of.get(int(i)) == first]
            place = m.coordinates.index(turns[first].quaternion[0])
            here = int(np.searchsorted(self.moved, first))
            self._turned.append((slice(place, place + 4), rows, which[rows] - first, slice(here, here + 3)))

    def values(self, at: Samples) -> Array:
        out = np.empty((len(at.k), len(self.names)))
        out[:, self._plain] = at.x_next[:, self._coordinates] - at.x[:, self._coordinates]
        for e, (_, rows, axes, _) in zip(self._turns(at), self._turned, strict=True):
            out[:, rows] = e[:, axes]
        return np.asarray(out / self.dt[at.k, None])

    def columns(self, nx: int, nu: int) -> Instants:
        return np.concatenate([self.moved, nx + nu + self.moved])

    def jacobian(self, at: Samples) -> Array:
        n, moved = len(self.names), len(self.moved)
        out = np.zeros((len(at.k), n, 2, moved))
        place = np.searchsorted(self.moved, self.which[self._plain])
        out[:, self._plain, 0, place], out[:, self._plain, 1, place] = -1.0, 1.0
        for e, (_, rows, axes, by) in zip(self._turns(at), self._turned, strict=True):
            out[:, rows, 0, by] = -rotations.logarithm_derivative(-e)[:, axes]
            out[:, rows, 1, by] = rotations.logarithm_derivative(e)[:, axes]
        return np.asarray(out.reshape(len(at.k), n, 2 * moved) / self.dt[at.k, None, None])

    def curvature(self, at: Samples, y: Array) -> Array | None:
        """Return the second derivatives of turns; None where there are none, as all else is linear."""
        if not self._turned:
            return None
        moved = len(self.moved)
        out = np.zeros((len(at.k), 2, moved, 2, moved))
        for e, (_, rows, axes, by) in zip(self._turns(at), self._turned, strict=True):
            w = (y[:, rows] / self.dt[at.k, None]) @ np.eye(3)[axes]
            mixed = rotations.logarithm_mixed(e, w)
            out[:, 0, by, 0, by] = -rotations.logarithm_curvature(-e, w)
            out[:, 0, by, 1, by], out[:, 1, by, 0, by] = mixed, mixed.swapaxes(1, 2)
            out[:, 1, by, 1, by] = rotations.logarithm_curvature(e, w)
        return out.reshape(len(at.k), 2 * moved, 2 * moved)

    def joined(self, others: Sequence[Quantity]) -> Rates:
        return Rates(self.mechanism, np.concatenate([part.which for part in self.among(others)]), self.dt)

    def own_select(self, rows: Sequence[int]) -> Rates:
        return Rates(self.mechanism, self.which[list(rows)], self.dt)

    def own_is_like(self, other: Quantity) -> bool:
        return isinstance(other, Rates) and np.array_equal(self.dt, other.dt)

    def _turns(self, at: Samples) -> Iterator[Array]:
        """Yield the vectors (n, 3) of the rotations from the start of a step to its end."""
        for place, *_ in self._turned:
            yield rotations.logarithm(rotations.product(rotations.inverse(at.x[:, place]), at.x_next[:, place]))
