"""A linear-quadratic regulator along a trajectory that knows that strings do not push."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.optimal.cost import final_of, matrix_of
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.rigs.strings import Strings, as_springs

_AHEAD = 0.4  # s, over which strings are to stay taut: that long a limb falls or flies freely
# Weight of half the square of a spring that pushes (1/m^2), by how much it is shortened; and of one whose length is a
# number, so that all that its end is tied to has to move for it, and with that the other strings there.
_SLACK, _TIED = 1e6, 1e4
_NONE = 1e-9  # m, of a spring that pushes, is none
_MOST, _HALVINGS = 100, 50  # Newton steps, and halvings of the share of one that is best


class Regulator:
    """The regulator of a model in which strings are springs, with inputs added so that none of them pushes.

    Its law ``u = ubar - K z`` for deviations z is the best one where all strings pull. A string that goes slack does
    not follow it: what is commanded then has no effect until it is so long that it is missed when it is needed. So
    the least ``1/2 y'y`` is sought, what ``du = -K z + L^-T y`` costs more than ``-K z``, with ``R + B'PB = L L'``,
    such that the springs' tensions as the linear model foretells them are not negative over the next instants, or
    nearly. Limits that are foretold to be active change with every instant, and only the first inputs are used.

    For one thread at a time: it goes forward along the trajectory.

    Parameters
    ----------
    model : MidpointSystem
    x, u : ndarray (N+1, nx), (N, nu)
        The trajectory.
    Q, R : array_like
        Weights, as of `regulate`.
    """

    def __init__(self, model: MidpointSystem, x: Array, u: Array, Q: ArrayLike, R: ArrayLike) -> None:
        m = model.mechanism
        springs = MidpointSystem(model.integrator.like(as_springs(m)), model.t)
        made = springs.step_each(x, u)
        if not made.complete:
            raise ArgumentError(f"plan: the model cannot go along it: {made.failure}")
        A, B = springs.linearize_each(x, u, made.x)
        Q, R = as_array(Q, "Q"), as_array(R, "R")
        solution = solve_linear_quadratic(A, B, Q=Q, R=R, Q_final=final_of(Q), keep_P=True)
        if not solution.definite or solution.P is None:
            raise ArgumentError(
                f"Q, R: there is no regulator: {solution.message} Give a positive definite R and a positive "
                "semidefinite Q."
            )
        self.K, self.closed = solution.K, A - B @ solution.K
        turned = np.swapaxes(B, 1, 2)
        self.root = np.linalg.cholesky(matrix_of(R) + turned @ solution.P[1:] @ B)
        self.whitened = np.swapaxes(np.linalg.solve(self.root, turned), 1, 2)  # B L^-T
        strings = Strings.along(m, np.ascontiguousarray(x[:, : m.nq]))
        # In metres of those that weigh most.
        share = np.where(strings.reeled, 1.0, np.sqrt(_TIED / _SLACK))
        self.strings = strings._replace(slopes=share[:, None] * strings.slopes, room=share * strings.room)
        self.ahead = max(1, int(np.ceil(_AHEAD / float(np.diff(model.t).mean()) - 1e-9)))
        self.rows: dict[int, Array] = {}

    def correction(self, k: int, z: Array) -> Array:
        """Return what is added to the input of step k for a deviation z (nx,)."""
        du = -self.K[k] @ z
        stop = min(k + self.ahead, len(self.K))
        room = self._foretold(k, stop, z)
        if not (room < -_NONE).any():
            return np.asarray(du)
        y = _keep_taut(self._influence(k, stop), room)
        return np.asarray(du + np.linalg.solve(self.root[k].T, y[: len(du)]))

    def _foretold(self, k: int, stop: int, z: Array) -> Array:
        """Return by how much each string can shrink until it pushes, after each step (n m,), of a deviation at k."""
        nq = self.strings.slopes.shape[2]
        found = []
        for j in range(k, stop):
            z = self.closed[j] @ z
            found.append(self.strings.room[j + 1] + self.strings.slopes[j + 1] @ z[:nq])
        return np.concatenate(found)

    def _influence(self, k: int, stop: int) -> Array:
        """Return the derivatives of that by what is added in the steps (n m, n nu); rows are kept for the next k."""
        m, nu, n = len(self.strings.names), self.K.shape[1], stop - k
        result = np.zeros((n * m, n * nu))
        self.rows = {j: row[:, -(j + 1 - k) * nu :] for j, row in self.rows.items() if j >= k}
        for j in range(k, stop):
            if j not in self.rows or self.rows[j].shape[1] < (j + 1 - k) * nu:
                self.rows[j] = self._row(k, j)
            result[(j - k) * m : (j + 1 - k) * m, : (j + 1 - k) * nu] = self.rows[j]
        return result

    def _row(self, k: int, j: int) -> Array:
        """Return the derivatives of the stretches after step j by what is added in steps k to j."""
        slopes = self.strings.slopes[j + 1]
        back = np.zeros((len(slopes), self.closed.shape[1]))
        back[:, : slopes.shape[1]] = slopes
        found = []
        for i in range(j, k - 1, -1):
            found.append(back @ self.whitened[i])
            back = back @ self.closed[i]
        return np.hstack(found[::-1])


def _keep_taut(influence: Array, room: Array) -> Array:
    """Return y with the least ``1/2 y'y + weight/2 s's`` for ``s = min(0, influence y + room)``.

    Newton's method: where the same strings would push, this is a quadratic function, towards whose minimum y goes as
    far as is best. As the function is convex, that ends after a few.
    """
    y, gap = np.zeros(influence.shape[1]), room
    for _ in range(_MOST):
        pushes = gap < 0.0
        rows = influence[pushes]
        if len(rows) <= len(y):
            aim = rows.T @ np.linalg.solve(rows @ rows.T + np.eye(len(rows)) / _SLACK, -room[pushes])
        else:
            aim = np.linalg.solve(rows.T @ rows + np.eye(len(y)) / _SLACK, -rows.T @ room[pushes])
        way = aim - y
        share = _best_share(y, way, gap, influence @ way)
        y = y + share * way
        gap = influence @ y + room
        if share == 1.0 and np.array_equal(gap < 0.0, pushes):
            break
    return y


def _best_share(y: Array, way: Array, gap: Array, moved: Array) -> float:
    """Return the share of a way that costs least, where ``gap`` changes by ``moved``, by halving towards no slope."""

    def slope(share: float) -> float:
        return float(way @ (y + share * way) + _SLACK * (np.minimum(gap + share * moved, 0.0) @ moved))

    low, high = 0.0, 1.0
    if slope(high) <= _NONE * abs(slope(low)):
        return high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) < 0.0 else (low, middle)
    return high
