"""Simulations from the command line: in parts, so that progress shows and Ctrl-C keeps what was made."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism, MidpointVI, SimulationStatus, Trajectory
from leastaction.numerics.arrays import Array

_PART = 500  # steps between two looks at the progress


def times(until: float, dt: float) -> Array:
    """Return instants from 0 to an end, dt apart (s).

    Raises
    ------
    ArgumentError
        For numbers that make no grid.
    """
    if not (np.isfinite(until) and np.isfinite(dt) and 0.0 < dt <= until):
        raise ArgumentError(f"got --until {until:g} and --dt {dt:g} s, expected 0 < dt <= until")
    if until / dt > 1e8:
        raise ArgumentError(f"--until {until:g} s in steps of {dt:g} s are {until / dt:.3g} steps: take longer ones")
    return np.asarray(dt * np.arange(round(until / dt) + 1), dtype=float)


def simulated(
    m: Mechanism, q: Array, t: Array, inputs: Mapping[str, float], told: Callable[[int], object]
) -> Trajectory:
    """Return the motion from rest at a configuration (nq,), with constant inputs by name.

    ``told``: is called with the number of steps that were made.
    """
    vi = MidpointVI(m)
    constant = np.array([inputs.get(name, 0.0) for name in m.inputs])
    parts: list[Trajectory] = []
    state = vi.start(q)
    for first in range(0, len(t) - 1, _PART):
        span = t[first : first + _PART + 1]
        parts.append(vi.simulate(state, span, inputs=np.tile(constant, (len(span) - 1, 1))))
        told(first + parts[-1].steps)
        if parts[-1].status is not SimulationStatus.COMPLETED:
            break
        state = parts[-1].last
    return parts[0] if len(parts) == 1 else joined(vi, parts)


def joined(vi: MidpointVI, parts: list[Trajectory]) -> Trajectory:
    """Return parts of a motion, each of which begins where the one before ends, as one."""
    last = parts[-1]
    looked = [part.worst_step for part in parts if part.worst_step is not None]
    steps = sum(part.steps for part in parts)
    completed = last.status is SimulationStatus.COMPLETED
    return vi.trajectory(
        np.concatenate([parts[0].t, *(part.t[1:] for part in parts[1:])]),
        np.concatenate([parts[0].x, *(part.x[1:] for part in parts[1:])]),
        np.concatenate([part.u for part in parts]),
        np.concatenate([part.lam for part in parts]),
        status=last.status,
        message=f"completed {steps} steps" if completed else last.message,
        rank_deficient=any(part.rank_deficient for part in parts),
        worst_step=max(looked, key=lambda each: each.coarseness, default=None),
        singularities=tuple(dict.fromkeys(line for part in parts for line in part.singularities)),
    )
