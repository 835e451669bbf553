"""Derivatives of both orders along random directions, held to differences of sixth order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction import MidpointVI, _core
from leastaction.numerics import Array

# Weights of the values one, two and three steps away, on either side: of the slope, and of the second derivative, in
# which the value in the middle has the last.
_SLOPE, _BEND, _MIDDLE = (0.75, -0.15, 1.0 / 60.0), (1.5, -0.15, 1.0 / 90.0), -49.0 / 18.0


def check_along(
    function: Callable[[Array], Array],
    first: Array,
    second: Array,
    z: Array,
    rng: np.random.Generator,
    *,
    step: float = 4e-3,
) -> None:
    """Hold the first derivatives (m, n) of a function at zero, and second ones (n, n) of ``z'f``, to differences."""
    n = first.shape[1]
    middle = function(np.zeros(n))
    for _ in range(6):
        e = rng.standard_normal(n) / np.sqrt(n)
        plus, minus = ([function(side * k * step * e) for k in (1, 2, 3)] for side in (1, -1))
        slope = sum(w * (a - b) for w, a, b in zip(_SLOPE, plus, minus, strict=True)) / step
        bend = sum(w * (a + b) for w, a, b in zip(_BEND, plus, minus, strict=True))
        bend = (bend + _MIDDLE * middle) / step**2
        assert np.abs(first @ e - slope).max() < 1e-8 * np.abs(first).max()
        assert abs(e @ second @ e - z @ bend) < 1e-7 * max(1.0, np.abs(second).max())


def check_step(vi: MidpointVI, x0: Array, u: Array, rng: np.random.Generator, *, step: float = 4e-3) -> None:
    """Hold the derivatives of a step of 50 ms, and of its multipliers, to differences in the charts of its states."""
    m, t = vi.mechanism, np.array([0.0, 0.05])
    x1 = vi.core.roll_out(t, x0, None, u[None], None).x[1]

    def end(d: Array) -> Array:
        start = _core.plus(m.core, x0[None], d[None, : m.ndx])[0]
        out = vi.core.roll_out(t, start, None, (u + d[m.ndx :])[None], None)
        assert out.steps == 1
        return np.concatenate([_core.difference(m.core, out.x[1:], x1[None])[0], out.lam[0]])

    core = _core.Linearization(vi.core, 1, True)
    assert core.along(t, np.stack([x0, x1]), u[None]) == 1
    first = np.hstack([core.A[0][:, : m.ndx], core.B[0]])
    z = rng.standard_normal(m.ndx + m.nc)
    check_along(end, first, core.curvature(z[None])[0], z, rng, step=step)
