"""One iteration of the optimiser: what it takes beside the unit, how many calls of Python, and what runs allocate.

``python -m benchmarks.iteration [--rounds N] [--calls]``: a cart-pole over 40 steps, free and with a bounded push. They
are the least times of this thread over many runs of one `Optimizer`, so that what else runs counts little; the
unit is measured right beside them.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse  # noqa: E402
import cProfile  # noqa: E402
import pstats  # noqa: E402
import time  # noqa: E402
import tracemalloc  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks import unit  # noqa: E402
from leastaction.costs import tracking  # noqa: E402
from leastaction.mechanics import MidpointVI  # noqa: E402
from leastaction.models.cart_pendulum import cart_pendulum  # noqa: E402
from leastaction.optimal import Bound, OptimizationResult, Optimizer  # noqa: E402
from leastaction.optimal.limits.limit import Limit  # noqa: E402
from leastaction.systems import MidpointSystem  # noqa: E402

_MORE = 8  # iterations by which the longer of two runs is longer
GOALS = {"free": 0.3e-3, "bounded": 0.6e-3}
"""Seconds that a run of one iteration may take, by the unit at design."""


class Case:
    """A cart-pole that swings its pole up, over some steps; ``bounded``: whether its push is."""

    def __init__(self, steps: int, *, bounded: bool) -> None:
        self.system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), 0.05 * np.arange(steps + 1))
        weights = {"x": 1.0, "theta": 10.0, "p_*": 0.1}
        self.cost = tracking(self.system, weights, {"theta": np.pi}, effort=1e-2)
        self.limits: list[Limit] = [Bound("x-force", -20.0, 20.0)] if bounded else []
        self.start = np.array([0.0, 0.3, 0.0, 0.0]), np.zeros((steps, 1))

    def optimizer(self, iterations: int) -> Optimizer:
        """Return an optimiser that ends after so many iterations at the most."""
        return Optimizer(self.system, self.cost, self.limits, max_iterations=iterations, tolerance=1e-14)

    def run(self, optimizer: Optimizer) -> OptimizationResult:
        """Return what it leads to from the start."""
        return optimizer.run(self.start)


def timed(case: Case, rounds: int) -> tuple[float, float, float]:
    """Return the seconds of a run of one iteration, of one of the iterations that follow, and of the unit."""
    short, long = case.optimizer(1), case.optimizer(1 + _MORE)
    least = [np.inf, np.inf]
    units = []
    more = case.run(long).iterations - 1
    for _ in range(rounds):
        for i, optimizer in enumerate((short, long)):
            for _ in range(10):
                began = time.thread_time()
                case.run(optimizer)
                least[i] = min(least[i], time.thread_time() - began)
        found = unit.measure(0.05, time.thread_time)
        if not isinstance(found, str):
            units.append(found.best)
    return least[0], (least[1] - least[0]) / more, min(units, default=np.nan)


def calls(case: Case, iterations: int) -> pstats.Stats:
    """Return the profile of a run."""
    optimizer = case.optimizer(iterations)
    case.run(optimizer)
    profile = cProfile.Profile()
    profile.enable()
    case.run(optimizer)
    profile.disable()
    return pstats.Stats(profile)


def peak(case: Case, iterations: int) -> int:
    """Return the bytes that a second run has allocated at its peak, beside what the first left."""
    optimizer = case.optimizer(iterations)
    case.run(optimizer)
    tracemalloc.start()
    try:
        case.run(optimizer)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.iteration", description=__doc__)
    parser.add_argument("--rounds", type=int, default=40, help="of ten runs each")
    parser.add_argument("--calls", action="store_true", help="where the calls of one iteration are")
    arguments = parser.parse_args()
    for name, goal in GOALS.items():
        case = Case(40, bounded=name == "bounded")
        counts: list[Any] = [calls(case, n) for n in (1, 1 + _MORE)]
        first, each, own = timed(case, arguments.rounds)
        more = case.run(case.optimizer(1 + _MORE)).iterations - 1
        by = unit.AT_DESIGN / own
        print(
            f"{name:8s} run of one iteration {1e3 * first:.3f} ms, by the unit {1e3 * first * by:.3f} of "
            f"{1e3 * goal:.3f}; one more {1e3 * each:.3f} ms, by the unit {1e3 * each * by:.3f}"
        )
        print(f"{'':8s} unit {1e6 * own:.1f} us")
        total = [each.total_calls for each in counts]
        print(f"{'':8s} {total[0]} calls; one more iteration {(total[1] - total[0]) / more:.0f}")
        allocated = [peak(Case(steps, bounded=name == "bounded"), 3) / 1024 for steps in (40, 4000)]
        print(
            f"{'':8s} allocated by a second run, of 40 and of 4000 steps: {allocated[0]:.0f} and {allocated[1]:.0f} KiB"
        )
        if arguments.calls:
            counts[1].sort_stats("tottime").print_stats(45)


if __name__ == "__main__":
    main()
