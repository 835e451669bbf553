"""The system of a result that is read from a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from leastaction.errors import LeastActionError, ResultFileError
from leastaction.mechanics import ContinuousDynamics, Mechanism, MidpointVI
from leastaction.optimal import OptimizationResult
from leastaction.systems import MechanismSystem, MidpointSystem


class _Midpoint(msgspec.Struct, forbid_unknown_fields=True):
    """Settings of a `MidpointSystem` and its integrator."""

    name: str
    split: Any
    tolerance: float
    max_iterations: int
    threads: int
    at_instants: tuple[str, ...]
    multipliers: bool
    first_share: float


class _Continuous(msgspec.Struct, forbid_unknown_fields=True):
    """Settings of a `MechanismSystem` and its dynamics."""

    name: str
    constraint_damping: float
    constraint_stiffness: float
    threads: int


def system_of(
    source: Path, settings: Mapping[str, Any], mechanism: Mechanism, result: OptimizationResult
) -> MidpointSystem | MechanismSystem:
    """Return the system of a result, from its settings and mechanism.

    Raises `ResultFileError` for settings of no system, and a mechanism whose system has other states or inputs.
    """
    system: MidpointSystem | MechanismSystem
    try:
        if settings.get("name") == "MidpointSystem":
            system = _midpoint(msgspec.convert(dict(settings), _Midpoint), mechanism, result)
        else:
            of = msgspec.convert(dict(settings), _Continuous)
            system = MechanismSystem(
                ContinuousDynamics(
                    mechanism,
                    constraint_damping=of.constraint_damping,
                    constraint_stiffness=of.constraint_stiffness,
                    threads=of.threads,
                )
            )
    except (msgspec.MsgspecError, LeastActionError) as error:
        raise ResultFileError(f"{source}: the system of its result cannot be made: {error}") from error
    if (system.state_names, system.input_names) != (result.state_names, result.input_names):
        raise ResultFileError(
            f"{source}: its result has the states {', '.join(result.state_names)} and the inputs "
            f"{', '.join(result.input_names)}, expected those of the mechanism: {', '.join(system.state_names)}; "
            f"{', '.join(system.input_names)}. Give the result's own mechanism"
        )
    return system


def _midpoint(of: _Midpoint, mechanism: Mechanism, result: OptimizationResult) -> MidpointSystem:
    integrator = MidpointVI(
        mechanism,
        split=of.split,
        tolerance=of.tolerance,
        max_iterations=of.max_iterations,
        threads=of.threads,
        at_instants=of.at_instants,
    )
    system = MidpointSystem(integrator, result.t, multipliers=of.multipliers)
    system.first_share = of.first_share
    return system
