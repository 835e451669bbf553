"""The unit: what a fixed piece of rigid-body dynamics costs on this machine now, by Pinocchio."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.timing import Timing, best_of

AT_DESIGN = 17e-6
"""The unit in seconds when the targets were set."""

_CALLS = 200


def measure(budget: float, clock: Callable[[], float] = time.perf_counter) -> Timing | str:
    """Return the time of Pinocchio's computeRNEADerivatives on Talos, or why there is none, by a clock of `best_of`."""
    try:
        import example_robot_data
        import pinocchio
    except ImportError as error:
        return f"{error.name} is not installed"
    model = example_robot_data.load("talos").model
    data = model.createData()
    rng = np.random.default_rng(0)
    q = pinocchio.integrate(model, pinocchio.neutral(model), 0.3 * rng.normal(size=model.nv))
    v, a = rng.normal(size=model.nv), rng.normal(size=model.nv)
    derivatives = pinocchio.computeRNEADerivatives

    def call() -> None:
        for _ in range(_CALLS):
            derivatives(model, data, q, v, a)

    return best_of(call, budget=budget, clock=clock) / _CALLS
