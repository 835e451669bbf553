"""Errors of derivatives, found by central differences."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import central_differences
from leastaction.optimal.system import System


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
        nx, at = x.size, np.concatenate([x, u])
        A, B = system.derivatives(x, u, when)
        J = central_differences(lambda y: system.f(y[:nx], y[nx:], when), at)
        self.note("A", A, J[:, :nx])
        self.note("B", B, J[:, nx:])
        if system.has_curvature:
            H = system.curvature(x, u, when, z)
            slopes = central_differences(lambda y: z @ np.hstack(system.derivatives(y[:nx], y[nx:], when)), at)
            self.note("curvature", H, slopes)
            self.note("curvature symmetry", H, H.T)
