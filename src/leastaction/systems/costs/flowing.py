"""Costs in the user's words in continuous time: wanted motions and weights by name, as functions of the time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.arguments import configuration_on
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.numerics.time_functions import TimeFunction
from leastaction.optimal.continuous.cost import ContinuousQuadraticCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.costs.words import places_of, prices_of_effort, rotations_of, weights_by_name
from leastaction.systems.orientations import quaternions_of

_SAMPLES = "PiecewisePolynomial.through(times, values)"


@dataclass(frozen=True, eq=False)
class _WantedOverTime:
    """What is wanted at a time: ``row`` (n,), with the entries and the rotations that are functions of the time."""

    row: Array
    mechanism: Mechanism | None
    entries: tuple[tuple[list[int], TimeFunction], ...]
    rotations: tuple[tuple[int, str, Callable[[float], Any]], ...] = ()

    def __call__(self, t: float) -> Array:
        out = self.row.copy()
        for places, function in self.entries:
            out[places] = as_array(function.at(t), f"{function.name} at t = {t:g} s", (), meaning="a number")
        for first, what, function_of in self.rotations:
            out[first : first + 4] = quaternions_of(function_of, what, np.array([t]))[0]
        if self.mechanism is not None:
            nq = self.mechanism.nq
            out[:nq] = configuration_on(self.mechanism, out[:nq], "wanted")
        return out


@dataclass(frozen=True, eq=False)
class _WeightsDuring:
    """Weights that are zero before and after some time."""

    weights: Array
    first: float
    last: float

    def __call__(self, t: float) -> Array:
        return self.weights if self.first <= t < self.last else np.zeros_like(self.weights)


def tracking_over_time(
    system: ContinuousSystem,
    weights: Mapping[str, float],
    wanted: Any,
    *,
    effort: float | Mapping[str, float],
    inputs: Any,
    final: Mapping[str, float] | None,
    during: tuple[float, float] | None,
) -> ContinuousQuadraticCost:
    """Return the cost of being off a wanted motion in continuous time; see `tracking`."""
    m = system.mechanism if isinstance(system, MechanismSystem) else None
    if m is None and system.charts() is not None:
        raise ArgumentError("system: its states are no plain vectors; give a ContinuousQuadraticCost with its `space`")
    x = np.zeros(system.nx)
    names, variables, first_rate = system.state_names, m.variables if m is not None else (), 0
    if m is not None:
        x[: m.nq] = m.configuration()
        names, first_rate = (*variables, *names[m.nq :]), m.nv  # of differences

    def weighed(given: Mapping[str, float], what: str) -> Array:
        return weights_by_name(given, names, variables, first_rate, what)

    Q = weighed(weights, "weights")
    weights_over_time: Array | _WeightsDuring = Q
    jumps: list[float] = []
    if during is not None:
        first, last = (as_number(each, "during (s)") for each in during)
        if first >= last:
            raise ArgumentError(f"during: got {first:g} to {last:g} s, expected a time and a later one")
        weights_over_time, jumps = _WeightsDuring(Q, first, last), [first, last]
    x_wanted = _wanted(wanted, x, system.state_names, m, "wanted", jumps)
    u_wanted = _wanted(inputs, np.zeros(system.nu), system.input_names, None, "inputs", jumps)
    return ContinuousQuadraticCost(
        x_wanted,
        u_wanted,
        Q=weights_over_time,
        R=prices_of_effort(system, effort),
        Q_final=None if final is None else weighed(final, "final"),
        jumps=jumps,
        space=system if m is not None and system.space is not None else None,
    )


def _wanted(given: Any, row: Array, names: Sequence[str], m: Mechanism | None, what: str, jumps: list[float]) -> Any:
    """Return what is wanted as a row or a function of the time, and note where it jumps."""
    if given is None:
        return row
    if not isinstance(given, Mapping):
        if isinstance(given, PiecewisePolynomial) or callable(given):
            return given
        row = np.array(as_array(given, what, row.shape, names=names, meaning=f"one row, a function, or {_SAMPLES}"))
        return _WantedOverTime(row, m, ())(0.0)
    variables, first_rate = (() if m is None else m.variables), (0 if m is None else m.nq)
    firsts = {} if m is None else rotations_of(m)
    entries, turns = [], []
    for name, value in given.items():
        told = f"{what}[{name!r}]"
        if isinstance(value, PiecewisePolynomial):
            jumps.extend(value.jumps())
        if name in firsts and callable(value):
            turns.append((firsts[name], told, value))
        elif name in firsts:
            row[firsts[name] : firsts[name] + 4] = quaternions_of(value, told, np.zeros(1))[0]
        elif callable(value):
            entries.append((places_of(name, names, variables, first_rate, what), TimeFunction(value, told)))
        else:
            places = places_of(name, names, variables, first_rate, what)
            row[places] = as_array(value, told, (), meaning=f"a number, a function of the time, or {_SAMPLES}")
    found = _WantedOverTime(row, m, tuple(entries), tuple(turns))
    return found if entries or turns else found(0.0)
