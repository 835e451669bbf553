"""The problems of the robustness set with limits that their free optima do not keep to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.robustness_problems import Given
from leastaction.optimal import Bound, Equal, Limit, OptimizationResult

__all__ = ["CASES", "Case", "Limited"]


@dataclass(frozen=True)
class Limited:
    """A problem with limits, for both solvers.

    Attributes
    ----------
    given : Given
    limits : sequence of Limit
    lower, upper : tuple of arrays
        The same as bounds on states, inputs and multipliers, each to be broadcast over time.
    """

    given: Given
    limits: Sequence[Limit]
    lower: tuple[Any, Any, Any]
    upper: tuple[Any, Any, Any]


@dataclass(frozen=True)
class Case:
    """A problem of the robustness set, and what its limits are, given the free optimum."""

    name: str
    of: str
    limit: Callable[[Given, OptimizationResult], Limited]


def _push(part: float) -> Callable[[Given, OptimizationResult], Limited]:
    """Limit all inputs to a part of the most that the free optimum uses of each."""

    def limit(given: Given, free: OptimizationResult) -> Limited:
        names = given.system.quantity("input").names
        most = np.full(given.system.nu, np.inf)  # prescribed variables are inputs too, and free
        most[: len(names)] = part * np.abs(free.u[:, : len(names)]).max(axis=0)
        limits = [Bound(name, -most[i], most[i], of="input") for i, name in enumerate(names)]
        return Limited(given, limits, (-np.inf, -most, -np.inf), (np.inf, most, np.inf))

    return limit


def _place(part: float, variable: int = 0) -> Callable[[Given, OptimizationResult], Limited]:
    """Limit a variable to a part of the way that it goes in the free optimum."""

    def limit(given: Given, free: OptimizationResult) -> Limited:
        name = given.system.quantity("variable").names[variable]
        x = free.x[:, variable]
        low, high = part * min(x.min(), -1e-3), part * max(x.max(), 1e-3)
        lower, upper = np.full(given.system.nx, -np.inf), np.full(given.system.nx, np.inf)
        lower[variable], upper[variable] = low, high
        return Limited(
            given, [Bound(name, low, high, of="variable")], (lower, -np.inf, -np.inf), (upper, np.inf, np.inf)
        )

    return limit


def _end(given: Given, free: OptimizationResult) -> Limited:  # noqa: ARG001
    """Ask for the wanted configuration at the end exactly, at rest."""
    system, goal = given.system, given.cost.x_wanted[-1]
    lower, upper = np.full((system.N + 1, system.nx), -np.inf), np.full((system.N + 1, system.nx), np.inf)
    lower[-1] = upper[-1] = goal
    return Limited(given, [Equal("*", goal, of="state")], (lower, -np.inf, -np.inf), (upper, np.inf, np.inf))


CASES = (
    Case("cart, swing-up, push at most 60 %", "cart, swing-up, R 0.01, final 10000, rest", _push(0.6)),
    Case("cart, swing-up, place at most 50 %", "cart, swing-up, R 0.01, final 10000, rest", _place(0.5)),
    Case("cart, swing-up, upright and at rest at the end", "cart, swing-up, R 0.01, final 1, rest", _end),
    Case("cart, tracking, push at most 70 %", "cart, tracking, R 0.01, final 100, noise", _push(0.7)),
    Case("double cart, balance, push at most 60 %", "double cart, balance, R 0.01, final 100, rest", _push(0.6)),
    Case("double cart, balance, place at most 80 %", "double cart, balance, R 0.01, final 100, rest", _place(0.8)),
    Case("acrobot, swing-up, torque at most 70 %", "acrobot, swing-up, R 0.01, final 100, rest 0", _push(0.7)),
    Case("pendubot, swing-up, torque at most 70 %", "pendubot, swing-up, R 0.01, final 100, rest 0", _push(0.7)),
    Case("planar arm, reaching, torques at most 50 %", "planar arm, reaching, R 0.01, final 10000, rest", _push(0.5)),
    Case("spatial arm, reaching, torques at most 60 %", "spatial arm, reaching, R 0.01, final 10000, rest", _push(0.6)),
    Case("spatial arm, tracking, torques at most 80 %", "spatial arm, tracking, R 0.001, final 10, rest", _push(0.8)),
    Case("quadrotor, flight, thrusts at most 70 %", "quadrotor, flight, R 0.1, final 100, rest", _push(0.7)),
    Case("chain of 4, curling, torques at most 80 %", "chain of 4, curling, R 0.01, final 10000, random", _push(0.8)),
)
