"""Errors of derivatives, found by central differences."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import central_differences
from leastaction.optimal.discrete.charts import StepInCharts
from leastaction.optimal.space import StateSpace
from leastaction.optimal.system import System, second_derivative


def relative_error(got: Array, expected: Array) -> float:
    """Return the largest difference, relative to one plus the largest value expected."""
    if got.shape != expected.shape:
        raise ArgumentError(f"a derivative has shape {got.shape}, expected {expected.shape}.")
    error = float(np.abs(got - expected).max(initial=0.0)) / (1.0 + float(np.abs(expected).max(initial=0.0)))
    return error if np.isfinite(error) else np.inf


class Errors(dict[str, float]):
    """The largest relative error found under each name."""

    def note(self, name: str, got: Array, expected: Array) -> None:
        """Compare two arrays under a name."""
        self[name] = max(self.get(name, 0.0), relative_error(got, expected))

    def compare(self, system: System, x: Array, u: Array, when: Any, z: Array) -> None:
        """Compare the derivatives of a system at one step or time, second ones weighted with z (nx,)."""
        space = system.charts()
        if space is not None:
            self._compare_charts(system, space, x, u, when, z)
        else:
            self.compare_numbers(system, x, u, when, z)

    def compare_numbers(self, system: System, x: Array, u: Array, when: Any, z: Array) -> None:
        """Compare those by the numbers of the state, as all are in continuous time."""
        n, at = x.size, np.concatenate([x, u])
        A, B = system.derivatives(x, u, when)
        J = central_differences(lambda y: system.f(y[:n], y[n:], when), at)
        self.note("A", A, J[:, :n])
        self.note("B", B, J[:, n:])
        if system.has_curvature:
            H = second_derivative(system, x, u, when, z)
            slopes = central_differences(lambda y: z @ np.hstack(system.derivatives(y[:n], y[n:], when)), at)
            self.note("curvature", H, slopes)
            self.note("curvature symmetry", H, H.T)

    def _compare_charts(self, system: System, space: StateSpace, x: Array, u: Array, when: Any, z: Array) -> None:
        """Compare those of a step between states that are no plain vectors, and the space's own."""
        n, at = space.ndx, np.concatenate([np.zeros(space.ndx), u])
        step = StepInCharts(space, lambda x, u: system.f(x, u, when), lambda x, u: system.derivatives(x, u, when), x, u)
        A, B = system.derivatives(x, u, when)
        J = central_differences(step.value, at)
        self.note("A", A, J[:, :n])
        self.note("B", B, J[:, n:])
        if system.has_curvature:
            H = second_derivative(system, x, u, when, z)
            self.note("curvature", H, central_differences(lambda y: z @ step.derivatives(y), at))
            self.note("curvature symmetry", H, H.T)
