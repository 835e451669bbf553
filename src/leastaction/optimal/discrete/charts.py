"""Steps of curves whose states are no plain vectors, and how such states are interpolated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.space import StateSpace
from leastaction.optimal.system import Linearization


def read_at(space: StateSpace, steps: Linearization, ends: Array, following: Array) -> Linearization:
    """Return the derivatives of steps in the charts about the next states of a curve, instead of about their own ends.

    They are those of the gaps ``difference(f(x, u), following)``; of a trajectory both are the same. ``steps``: in the
    charts about their ends. ``ends``, ``following`` (N, nx).
    """
    J = space.difference_derivative(ends, following)
    moved = np.concatenate([steps.A, steps.B], axis=2)

    def second(z: Array) -> Array:
        bent = space.difference_curvature(ends, following, z)
        own = steps.curvature(np.einsum("kij,ki->kj", J, z))
        return np.asarray(own + np.swapaxes(moved, 1, 2) @ bent @ moved)

    return Linearization(J @ steps.A, J @ steps.B, second, memory=steps)


def states_between(space: StateSpace, x: Array, t: Array, times: Array) -> Array:
    """Return states x (n, nx) at times t (n,) at others (N,), along the ways from each to the next."""
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    share = np.clip((times - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0)
    return space.plus(x[k], share[:, None] * space.difference(x[k + 1], x[k]))


def along_charts(space: StateSpace, x: Array, moved: Array, dx: Array) -> Array:
    """Return how states that were moved from x by a difference go on where that changes by dx (..., ndx)."""
    return np.asarray(np.linalg.solve(space.difference_derivative(moved, x), dx[..., None])[..., 0])


class StepInCharts:
    """A step as a function ``[dx; u]`` of a vector, read in the chart about the state that it leads to.

    ``f``, ``derivatives``: of the step, by states and inputs; the latter in the charts about each state and its end.
    """

    def __init__(
        self,
        space: StateSpace,
        f: Callable[[Array, Array], Array],
        derivatives: Callable[[Array, Array], tuple[Array, Array]],
        x: Array,
        u: Array,
    ) -> None:
        self.space, self.f, self.by, self.x = space, f, derivatives, x
        self.end, self.n = f(x, u), space.ndx

    def value(self, y: Array) -> Array:
        """Return where the step leads to, (ndx,)."""
        moved = self.space.plus(self.x, y[: self.n])
        return self.space.difference(self.f(moved, y[self.n :]), self.end)

    def derivatives(self, y: Array) -> Array:
        """Return the derivatives (ndx, ndx + nu)."""
        space, u = self.space, y[self.n :]
        moved = space.plus(self.x, y[: self.n])
        A, B = self.by(moved, u)
        J = space.difference_derivative(self.f(moved, u), self.end)
        back = np.linalg.inv(space.difference_derivative(moved, self.x))
        return np.asarray(J @ np.concatenate([A @ back, B], axis=1))
