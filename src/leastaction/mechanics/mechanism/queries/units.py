"""The units of what a mechanism names: methods of `Mechanism`, which is ``m`` here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from leastaction.mechanics.elements.units import common, force_along, impulse_along, momentum_along, rate_of
from leastaction.mechanics.mechanism.arguments import Compiled


def units_of(m: Compiled) -> Mapping[str, str]:
    """Return the unit of each variable, input and constraint equation; see `Mechanism.units`."""
    variables = _moved(m)
    others = _of_elements(m, variables)
    equations: dict[str, str] = {}
    for name, element in m.elements.items():
        suffixes = zip(element.equations, element.equation_units(variables), strict=True)
        equations.update({name + suffix: unit for suffix, unit in suffixes})
    inputs = {name: others.get(name, "") for name in m.inputs}
    named = {name: variables.get(name) or others.get(name, "") for name in m.variables}
    return MappingProxyType({**equations, **inputs, **named})


def input_units(m: Compiled) -> tuple[str, ...]:
    """Return the units of the inputs, also of those that have the name of a variable."""
    others = _of_elements(m, _moved(m))
    return tuple(others.get(name, "") for name in m.inputs)


def _moved(m: Compiled) -> dict[str, str]:
    """Return the units of the variables that move joints."""
    moved: dict[str, set[str]] = {}
    for joint in m.tree.joints:
        unit = "rad" if joint.twist[3:].any() else "m"
        for name in joint.variables:
            moved.setdefault(name, set()).add(unit)
    return {name: common(units) for name, units in moved.items()}


def _of_elements(m: Compiled, variables: Mapping[str, str]) -> dict[str, str]:
    """Return the units of what elements name: inputs, and variables that prescribe numbers of them."""
    found: dict[str, set[str]] = {}
    for element in m.elements.values():
        for name, unit in element.units(variables).items():
            found.setdefault(name, set()).add(unit)
    return {name: common(units) for name, units in found.items()}


def state_units(m: Compiled, *, momenta: bool) -> tuple[str, ...]:
    """Return the units of the entries of a state: of ``[q; rho; p; v_rho]`` with momenta, else of ``[q; rho; v]``."""
    units = units_of(m)
    rates = [rate_of(units[name]) for name in m.variables]
    if momenta:
        rates[: m.nd] = [momentum_along(units[name]) for name in m.dynamic]
    return (*(units.get(name, "1") for name in m.coordinates), *rates)


def multiplier_units(m: Compiled, *, impulses: bool) -> tuple[str, ...]:
    """Return the units of the multipliers: forces along the equations, or impulses, which steps of time have."""
    along = impulse_along if impulses else force_along
    units = units_of(m)
    return tuple(along(units[name]) for name in m.constraints)
