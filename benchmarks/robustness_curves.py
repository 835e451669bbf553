"""Starts that are known but no trajectories, for `benchmarks.robustness --curves`: with gaps, or projected?

The straight line to the goal, at rest and with no inputs, for motions that are unstable over a long time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.robustness_further import gymnast
from benchmarks.robustness_problems import Problem, cart, chain, constant, double_pendulum, named
from leastaction.mechanics import Mechanism

__all__ = ["CURVES"]

CURVES: list[Problem] = []
"""As many again with twice the time, and with inputs that are a hundred times as dear."""

_TASKS: list[tuple[str, Callable[[], Mechanism], str, dict[str, float], dict[str, float]]] = [
    ("double cart", lambda: cart(2), "swing-up", {}, {"pole0": np.pi}),
    ("triple cart", lambda: cart(3), "swing-up", {}, {"pole0": np.pi}),
    ("triple cart", lambda: cart(3), "balance", {"pole0": np.pi - 0.2, "pole1": 0.3}, {"pole0": np.pi}),
    ("quadruple cart", lambda: cart(4), "balance", {"pole0": np.pi - 0.1, "pole1": 0.1}, {"pole0": np.pi}),
    ("gymnast", gymnast, "swing-up", {}, {"hands": np.pi}),
    ("acrobot", lambda: double_pendulum("elbow"), "swing-up", {}, {"shoulder": np.pi}),
    ("chain of 3", lambda: chain(3, "pushed"), "swing-up", {}, {"link0": np.pi}),
    ("chain of 4", lambda: chain(4, "pushed"), "swing-up", {}, {"link0": np.pi}),
]
for _R in (1e-4, 1e-2):
    for _N in (150, 300):
        CURVES += [
            named(name, mechanism, f"{task} in {_N} steps", at, constant(**goal), "line", N=_N, Q=0.1, final=1e4, R=_R)
            for name, mechanism, task, at, goal in _TASKS
        ]
