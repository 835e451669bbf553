"""What runs and results have over time, by name, in the units in which it is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.queries.units import input_units, state_units
from leastaction.mechanics.mechanism.trajectory import BaseTrajectory
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import matching
from leastaction.optimal.result import OptimizationResult
from leastaction.systems.closed_loop import ClosedLoop
from leastaction.systems.rig import Played

Source = Trajectory | ContinuousTrajectory | OptimizationResult
Drawn = Source | Played | ClosedLoop
Key = tuple[str, str]  # kind and name of a signal

_DEGREES: Final = 180.0 / np.pi
# What a unit measures, for the axis.
_MEASURES: Final = {
    "rad": "angle",
    "rad/s": "angular velocity",
    "rad/s^2": "angular acceleration",
    "m": "length",
    "m/s": "velocity",
    "m/s^2": "acceleration",
    "N": "force",
    "N m": "torque",
    "N/m": "force by length",
    "kg m/s": "momentum",
    "kg m^2/s": "angular momentum",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """A number over time.

    ``kind``: what its axis says if the unit is not known. ``name``, ``unit``: as of the run. ``t``, ``values`` (n,):
    the instants. ``end``: until when the last value is held (s), as each is until the next instant; None of what goes
    from one instant to the next.
    """

    name: str
    unit: str
    t: Array
    values: Array
    end: float | None = None
    kind: str = "state"

    @property
    def key(self) -> Key:
        """Kind and name: a variable and an input may share a name."""
        return self.kind, self.name

    @property
    def held(self) -> bool:
        """Whether each value is held until the next instant."""
        return self.end is not None

    def drawn(self, values: Array | None = None) -> tuple[Array, Array]:
        """Return times and values as they are drawn, or others at the same instants."""
        shown = drawn_unit(self.unit)[0] * (self.values if values is None else values)
        if self.end is None:
            return self.t, shown
        return np.append(self.t, self.end), np.append(shown, shown[-1:])


def drawn_unit(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which a unit is drawn: angles in degrees."""
    if unit == "rad" or unit.startswith("rad/"):
        return _DEGREES, pretty("°" + unit[3:])
    return 1.0, pretty(unit)


def pretty(unit: str) -> str:
    """Return a unit with raised exponents."""
    return unit.replace("^2", "²").replace("^3", "³")


def axis_label(unit: str, otherwise: str = "") -> str:
    """Return what an axis says: what is measured, and its unit; or something else where there is none."""
    shown = drawn_unit(unit)[1] if unit != "1" else ""
    return f"{_MEASURES.get(unit, otherwise)} ({shown})".strip() if shown else otherwise


def check_source(source: object, what: str) -> None:
    """Raise unless this is a run or a result."""
    if not isinstance(source, BaseTrajectory | OptimizationResult | Played | ClosedLoop):
        raise ArgumentError(
            f"{what}: got {type(source).__name__}, expected a run of simulate() or a result of optimize()"
        )


def motion_of(source: Source, what: str) -> Trajectory | ContinuousTrajectory:
    """Return the motion of the mechanism; an error says where there is none."""
    check_source(source, what)
    if isinstance(source, Played | ClosedLoop):
        whose = "a rig" if isinstance(source, Played) else "a closed loop"
        raise ArgumentError(f"{what}: got what {whose} did, which has no multipliers, expected a run or a result")
    found: Trajectory | ContinuousTrajectory = source.trajectory if isinstance(source, OptimizationResult) else source
    if found.steps < 2:
        raise ArgumentError(f"{what}: got a run of {found.steps} steps, expected two at least: {found.message}")
    return found


def states_of(source: Drawn) -> list[Signal]:
    """Return everything in the state, by name."""
    if isinstance(source, OptimizationResult | ClosedLoop):
        names, units = source.state_names, source.state_units
    else:
        m = source.mechanism
        if not isinstance(source, ContinuousTrajectory):
            rates = (*(f"p_{name}" for name in m.dynamic), *(f"v_{name}" for name in m.kinematic))
        else:
            rates = tuple(f"v_{name}" for name in m.variables)
        names, units = (*m.coordinates, *rates), state_units(m, momenta=not isinstance(source, ContinuousTrajectory))
    columns = zip(names, units, source.x.T, strict=True)
    return [Signal(name=name, unit=unit, t=source.t, values=values) for name, unit, values in columns]


def inputs_of(source: Drawn) -> list[Signal]:
    """Return the inputs, by name; not those that are states at the next instant."""
    if isinstance(source, OptimizationResult | ClosedLoop):
        # What is prescribed is a state at the next instant, in the same unit; others may share no more than a name.
        known = dict(zip(source.state_names, source.state_units, strict=True))
        pairs = zip(source.input_names, source.input_units, strict=True)
        kept = [i for i, (name, unit) in enumerate(pairs) if known.get(name) != unit]
        names, values = [source.input_names[i] for i in kept], source.u[:, kept]
        units = [source.input_units[i] for i in kept]
    else:
        m = source.mechanism
        names, values = list(m.inputs), source.u[:, : m.n_inputs]
        units = list(input_units(m))
    end = float(source.t[-1]) if len(values) < len(source.t) else None
    return [
        Signal(name=name, unit=unit, t=source.t[: len(values)], values=column, end=end, kind="input")
        for name, unit, column in zip(names, units, values.T, strict=True)
    ]


def chosen(signals: Sequence[Signal], names: str | Sequence[str], what: str) -> list[Signal]:
    """Return the signals whose names match, in the order of the patterns."""
    known = [signal.name for signal in signals]
    patterns = [names] if isinstance(names, str) else list(names)
    found: list[int] = []
    for pattern in patterns:
        places = matching(known, pattern)
        if not places:
            raise ArgumentError(f"{what}: unknown name {pattern!r}; {closest(pattern, known, what='names')}")
        found += [i for i in places if i not in found]
    if not found:
        raise ArgumentError(
            f"{what}: got no names, expected some of {', '.join(known[:6])}, ... or a pattern such as '*'"
        )
    return [signals[i] for i in found]
