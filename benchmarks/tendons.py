"""A hand of 25 joints: moved by 25 tendons over via-points, and by 25 motors."""

from __future__ import annotations

import numpy as np

from benchmarks.settings import Settings
from benchmarks.timing import Absent, Row, best_of, timed
from leastaction.mechanics import Mechanism, MidpointVI
from leastaction.models.hand import hand

GROUP = "tendons"
_DT = 2e-3


def rows(settings: Settings) -> list[Row | Absent]:
    """Measure both with the same motion: the motors get the torques that the tendons give."""
    N = max(50, settings.steps // 5)
    drawn, driven = hand(joints=25), hand(joints=25, tendons=False)
    t = _DT * np.arange(N + 1)
    rng = np.random.default_rng(1)
    # Slow tensions around what holds the fingers; the extensors balance the flexors.
    phase, rate = rng.uniform(0.0, 2.0 * np.pi, drawn.nu), rng.uniform(0.5, 1.5, drawn.nu)
    tension = 0.6 + 0.4 * np.sin(2.0 * np.pi * rate * t[:-1, None] + phase)
    q0 = np.full(drawn.nq, 0.2)
    first, run = _measure(drawn, q0, t, tension, settings)
    q, v = 0.5 * (run[1:] + run[:-1]), np.diff(run, axis=0) / _DT
    torque = np.array(
        [drawn.core.force(a, b, u) - drawn.core.force(a, b, 0 * u) for a, b, u in zip(q, v, tension, strict=True)]
    )
    order = [driven.variables.index(name) for name in driven.inputs]
    second, other = _measure(driven, q0, t, np.ascontiguousarray(torque[:, order]), settings)
    apart = float(np.abs(run - other).max())
    points = sum(len(e.frames) for e in drawn.elements.values() if hasattr(e, "frames") and e.frames)
    return [
        timed(
            GROUP,
            "hand with 25 tendons",
            first / N,
            "step",
            note=f"over {points} via-points; {drawn.nd} joints",
        ),
        timed(
            GROUP,
            "hand with 25 joint torques",
            second / N,
            "step",
            note=f"the same motion, within {apart:.0e} rad",
        ),
        Row(GROUP, "tendons / torques", first.best / second.best, unit="", target=3.0),
    ]


def _measure(m: Mechanism, q0, t, u, settings: Settings):
    integrator = MidpointVI(m, threads=1)
    x0 = integrator.start(q0).x
    out = integrator.core.roll_out(t, x0, None, u, None)
    if out.steps < len(t) - 1:
        raise RuntimeError(f"the roll-out failed after {out.steps} of {len(t) - 1} steps")
    timing = best_of(lambda: integrator.core.roll_out(t, x0, None, u, None), budget=settings.budget)
    return timing, out.x[:, : m.nq]
