"""Derivatives of steps that are given as plain functions, of states that are no plain vectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import central_differences
from leastaction.optimal.discrete.charts import StepInCharts
from leastaction.optimal.functions import Functions, sized
from leastaction.optimal.space import StateSpace


class ChartFunctions:
    """A step ``f(x, u, k)`` and its derivatives by charts: given as such, or obtained as asked for.

    The complex step and differences are by the entries of a state: f takes such that are none of the space, as a
    quaternion of another length, whatever it makes of them.
    """

    def __init__(self, functions: Functions, space: StateSpace) -> None:
        self.functions, self.space = functions, space
        self.f = functions.f

    def derivatives(self, x: Array, u: Array, when: Any) -> tuple[Array, Array]:
        """Return A (ndx, ndx) and B (ndx, nu)."""
        space, given = self.space, self.functions.derivatives_given
        if given is not None:
            A, B = given(x, u, when)
            return sized("A", A, (space.ndx, space.ndx)), sized("B", B, (space.ndx, self.functions.nu))
        A, B = self.functions.derivatives(x, u, when)
        # What a direction moves, the other way round.
        read = np.linalg.pinv(space.plus_derivative(self.f(x, u, when)))
        return read @ A @ space.plus_derivative(x), read @ B

    def curvature(self, x: Array, u: Array, when: Any, z: Array) -> Array:
        """Return ``z . D2f`` (ndx+nu, ndx+nu)."""
        n, given = self.space.ndx + self.functions.nu, self.functions.curvature_given
        if given is not None:
            return sized("curvature", given(x, u, when, z), (n, n))
        step = StepInCharts(
            self.space, lambda x, u: self.f(x, u, when), lambda x, u: self.derivatives(x, u, when), x, u
        )
        at = np.concatenate([np.zeros(self.space.ndx), u])
        H = central_differences(lambda y: z @ step.derivatives(y), at, step=1e-5)
        return np.asarray(0.5 * (H + H.T))
