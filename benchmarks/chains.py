"""Chains of n links: how the time of a step grows with their length."""

from __future__ import annotations

import numpy as np

from benchmarks.cases import DT
from benchmarks.settings import MICRO, Settings
from benchmarks.timing import Absent, Row, best_of, timed
from leastaction.mechanics import MidpointVI
from leastaction.models.chain import pendulum_chain

GROUP = "chain"
DISSERTATION = {40: 19.5e-3, 80: 413e-3}
_STEPS = 30


def rows(settings: Settings) -> list[Row | Absent]:
    """Measure every length; the chain is let go straight, tilted by half a radian."""
    result: list[Row | Absent] = [_building()]
    lengths, times = [], []
    for n in settings.chain_links:
        integrator = MidpointVI(pendulum_chain(n), threads=1)
        q = np.zeros(n)
        q[0] = 0.5
        x0 = integrator.start(q).x
        t, u = DT * np.arange(_STEPS + 1), np.empty((_STEPS, 0))
        core = integrator.core
        out = core.roll_out(t, x0, None, u, None)
        if out.steps < _STEPS:
            result.append(Absent(GROUP, f"chain of {n} links", f"failed after {out.steps} steps"))
            continue
        timing = best_of(
            lambda core=core, t=t, x0=x0, u=u: core.roll_out(t, x0, None, u, None),
            budget=settings.budget,
            least=1,
        )
        seconds = timing.best / _STEPS
        lengths.append(n)
        times.append(seconds)
        result.append(
            timed(
                GROUP,
                f"chain of {n} links",
                timing / _STEPS,
                "step",
                target=n * MICRO,
                dissertation=DISSERTATION.get(n),
                note=f"{seconds / n / MICRO:.2f} us per link, {out.iterations / _STEPS:.2f} Newton iterations",
                details={"links": n, "seconds_per_link": seconds / n},
            )
        )
    if len(lengths) > 1:
        slope = float(np.polyfit(np.log(lengths), np.log(times), 1)[0])
        local = np.diff(np.log(times)) / np.diff(np.log(lengths))
        result.append(
            Row(
                GROUP,
                f"slope in log-log, {lengths[0]} to {lengths[-1]} links",
                slope,
                unit="",
                target=settings.target(1.1),
                note=f"steepest between neighbours: {local.max():.2f}",
                details={"local": [float(s) for s in local]},
            )
        )
    return result


def _building() -> Row:
    """Measure how long a mechanism of many joints takes from its description on."""
    joints = 3000
    short, long = (best_of(lambda n=n: pendulum_chain(n), budget=1.0, least=2) for n in (joints // 4, joints))
    return timed(
        GROUP,
        f"building {joints} joints",
        long,
        "mechanism",
        target=0.5,
        note=f"{long.best / short.best:.1f} times as long as {joints // 4}",
        details={"joints": joints},
    )
