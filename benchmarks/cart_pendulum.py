"""The cart-pendulum's swing-up by dynamic embedding (dissertation 6.6.1 and 6.7.1).

Four optimisations in a row: three with a fictitious torque at the pivot whose cost rises, then the true
mechanism from where they ended.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.cases import DT, Array
from benchmarks.settings import Settings
from benchmarks.timing import Absent, Row, best_of, timed
from leastaction.mechanics import MidpointVI
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import OptimizationResult, QuadraticCost, optimize
from leastaction.systems import MidpointSystem

GROUP = "cart"

# Weights: the pendulum's angle counts, the rest hardly; the torque's rise to where it is not used any more.
_ANGLE, _REST, _FORCE = 100.0, 0.01, 0.01
_TORQUE = (0.01, 10.0, 1000.0)


class Problem(NamedTuple):
    """Both systems, the wanted angle and the times."""

    embedded: MidpointSystem
    true: MidpointSystem
    wanted: Array
    t: Array


def problem(steps: int) -> Problem:
    """Return the problem: hang, stand upright in the middle of the horizon, hang again."""
    t = DT * np.arange(steps + 1)
    x_wanted = np.zeros((steps + 1, 4))
    share = np.clip((t / t[-1] - 0.3) / 0.4, 0.0, 1.0)
    x_wanted[:, 1] = 0.5 * np.pi * (1.0 - np.cos(2.0 * np.pi * share))
    systems = [MidpointSystem(MidpointVI(cart_pendulum(pivot_torque=torque), threads=1), t) for torque in (True, False)]
    return Problem(*systems, x_wanted, t)


def solve(given: Problem) -> list[OptimizationResult]:
    """Make the four optimisations."""
    N = len(given.t) - 1
    Q = np.array([_REST, _ANGLE, _REST, _REST])
    x, u = np.zeros((N + 1, 4)), np.zeros((N, 2))
    results = []
    for torque in _TORQUE:
        cost = QuadraticCost(given.wanted, np.zeros((N, 2)), Q=Q, R=np.array([_FORCE, torque]))
        results.append(optimize(given.embedded, cost, initial=(x, u)))
        x, u = results[-1].x, results[-1].u
    cost = QuadraticCost(given.wanted, np.zeros((N, 1)), Q=Q, R=np.array([_FORCE]))
    results.append(optimize(given.true, cost, initial=(x, u[:, :1].copy())))
    return results


def rows(settings: Settings) -> list[Row | Absent]:
    """Measure all four together, on one thread."""
    given = problem(settings.steps)
    solved: list[list[OptimizationResult]] = []
    timing = best_of(lambda: solved.append(solve(given)), budget=settings.budget, least=settings.repeats)
    runs = solved[-1]
    highest = float(runs[-1].x[:, 1].max())
    iterations = [run.iterations for run in runs]
    return [
        timed(
            GROUP,
            f"cart-pendulum swing-up, four times {settings.steps} steps",
            timing,
            "run",
            target=settings.target(0.1),
            dissertation=settings.target(9.7),
            note=f"{' + '.join(map(str, iterations))} iterations, reaches {np.degrees(highest):.0f} degrees",
            details={
                "iterations": iterations,
                "status": [run.status.name for run in runs],
                "rollouts": [run.rollouts for run in runs],
                "seconds": [dict(run.timings) for run in runs],
                "highest_angle_rad": highest,
            },
        )
    ]
