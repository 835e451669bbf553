"""How long a mechanism's calls take on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from leastaction.mechanics import ContinuousDynamics, Mechanism, MidpointVI
from leastaction.numerics.arrays import Array
from leastaction.systems import MidpointSystem

STEPS = 200


def timings(m: Mechanism, q: Array, dt: float, seconds: float = 0.5) -> dict[str, float]:
    """Return the time of a step and of what an optimiser asks of it, best of many (us), by name.

    ``seconds``: how long each is repeated, about. The mechanism moves from rest at ``q`` in steps of ``dt`` (s).
    """
    vi, t = MidpointVI(m, threads=1), dt * np.arange(STEPS + 1)
    start = vi.start(q)
    run = vi.simulate(start, t)
    steps = max(run.steps, 1)
    t = t[: steps + 1]
    system = MidpointSystem(vi, t)
    linear = system.linearize(run.x, run.u)
    z = np.ones((steps + 1, m.ndx))
    dynamics = ContinuousDynamics(m)
    v, u = np.zeros((steps + 1, m.nv)), np.zeros((steps + 1, m.n_inputs))
    return {
        "a step": _best(lambda: vi.simulate(start, t, inputs=run.inputs), seconds) / steps,
        "its derivatives A, B": _best(lambda: system.linearize(run.x, run.u), seconds) / steps,
        "its second derivatives, contracted": _best(lambda: linear.curvature(z), seconds) / steps,
        "accelerations": _best(lambda: dynamics.accelerations(run.q, v, u), seconds) / (steps + 1),
        "their derivatives": _best(lambda: dynamics.linearize(run.q, v, u), seconds) / (steps + 1),
    }


def _best(call: Callable[[], object], seconds: float) -> float:
    """Return the least time of a call (us)."""
    best, end = np.inf, time.perf_counter() + seconds
    while True:
        start = time.perf_counter()
        call()
        now = time.perf_counter()
        best = min(best, now - start)
        if now > end:
            return 1e6 * best
