"""Simulations from the command line, from rest under constant inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism, MidpointVI, Trajectory
from leastaction.numerics.arrays import Array


def times(until: float, dt: float) -> Array:
    """Return instants from 0 to an end, dt apart (s).

    Raises `ArgumentError`: numbers that make no grid.
    """
    if not (np.isfinite(until) and np.isfinite(dt) and 0.0 < dt <= until):
        raise ArgumentError(f"got --until {until:g} and --dt {dt:g} s, expected 0 < dt <= until")
    if until / dt > 1e8:
        raise ArgumentError(f"--until {until:g} s in steps of {dt:g} s are {until / dt:.3g} steps: take longer ones")
    return np.asarray(dt * np.arange(round(until / dt) + 1), dtype=float)


def simulated(m: Mechanism, q: Array, t: Array, inputs: Mapping[str, float], told: Callable[[int], None]) -> Trajectory:
    """Return the motion from rest at a configuration (nq,), with constant inputs by name; up to a Ctrl-C.

    ``told``: is called with the number of steps that were made.
    """
    vi = MidpointVI(m)
    constant = np.tile([inputs.get(name, 0.0) for name in m.inputs], (len(t) - 1, 1))
    return vi.simulate(vi.start(q), t, inputs=constant, progress=lambda done, _: told(done))
