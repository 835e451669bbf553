"""The time of a problem in continuous time: its horizon, and the mesh to begin with."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import as_array
from leastaction.numerics.ode import segments
from leastaction.numerics.piecewise import Mesh


def as_horizon(horizon: tuple[float, float]) -> tuple[float, float]:
    """Return the horizon (t0, tf) as floats, or complain."""
    times = as_array(horizon, "horizon", (2,), meaning="(t0, tf)")
    if not times[0] < times[1]:
        raise ArgumentError(f"horizon: got {tuple(times.tolist())}, expected t0 < tf.")
    return float(times[0]), float(times[1])


def first_mesh(t0: float, tf: float, jumps: Sequence[float], pieces: int) -> Mesh:
    """Return a mesh of about equal pieces that has the jumps among its ends."""
    stops = segments(t0, tf, jumps)
    breaks = [stops[0]]
    for begin, end in itertools.pairwise(stops):
        count = max(1, round(pieces * (end - begin) / (tf - t0)))
        breaks.extend(np.linspace(begin, end, count + 1)[1:].tolist())
    return Mesh(np.array(breaks))
