"""Chains of n links, lifts of n segments: how the time of a step grows with their length."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.cases import DT
from benchmarks.settings import MICRO, Settings
from benchmarks.timing import Absent, Row, best_of, timed
from leastaction.mechanics import MidpointVI
from leastaction.models.chain import pendulum_chain
from leastaction.models.scissor_lift import at_angle, scissor_lift
from leastaction.numerics.arrays import Array

GROUP = "chain"
DISSERTATION = {40: 19.5e-3, 80: 413e-3}
_STEPS = 30


def rows(settings: Settings) -> list[Row | Absent]:
    """Measure every length: chains let go straight, tilted by half a radian, lifts with their links at one radian."""
    return [
        _building(),
        *_growth("chain", "links", settings.chain_links, _chain, settings, 1.1, MICRO),
        *_growth("lift", "segments", settings.lift_segments, _lift, settings, 1.15, None),
    ]


def _chain(links: int) -> tuple[MidpointVI, Array]:
    integrator = MidpointVI(pendulum_chain(links), threads=1)
    q = np.zeros(links)
    q[0] = 0.5
    return integrator, integrator.start(q).x


def _lift(segments: int) -> tuple[MidpointVI, Array]:
    lift = scissor_lift(segments)
    integrator = MidpointVI(lift, threads=1)
    return integrator, integrator.start(*at_angle(lift, 1.0)).x


def _growth(
    kind: str,
    parts: str,
    counts: tuple[int, ...],
    make: Callable[[int], tuple[MidpointVI, Array]],
    settings: Settings,
    steepest: float,
    goal: float | None,
) -> list[Row | Absent]:
    result: list[Row | Absent] = []
    lengths, times = [], []
    for n in counts:
        integrator, x0 = make(n)
        t, u = DT * np.arange(_STEPS + 1), np.zeros((_STEPS, len(integrator.mechanism.inputs)))
        core = integrator.core
        out = core.roll_out(t, x0, None, u, None)
        if out.steps < _STEPS:
            result.append(Absent(GROUP, f"{kind} of {n} {parts}", f"failed after {out.steps} steps"))
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
                f"{kind} of {n} {parts}",
                timing / _STEPS,
                "step",
                target=None if goal is None else n * goal,
                dissertation=DISSERTATION.get(n) if kind == "chain" else None,
                note=f"{seconds / n / MICRO:.2f} us each, {out.iterations / _STEPS:.2f} Newton iterations",
                details={parts: n, "seconds_each": seconds / n},
            )
        )
    if len(lengths) > 1:
        slope = float(np.polyfit(np.log(lengths), np.log(times), 1)[0])
        local = np.diff(np.log(times)) / np.diff(np.log(lengths))
        result.append(
            Row(
                GROUP,
                f"{kind}: slope in log-log, {lengths[0]} to {lengths[-1]} {parts}",
                slope,
                unit="",
                target=settings.target(steepest),
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
