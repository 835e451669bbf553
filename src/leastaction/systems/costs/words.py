"""How names in a cost are read, in both kinds of time: of states and their rates, of inputs, with wildcards."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number, require_mapping
from leastaction.numerics.names import matching
from leastaction.optimal.system import System

_TURNS = ".w[xyz]"  # pattern of the names of what a rotation turns by, behind its own
_LEAST_EFFORT = 1e-9  # price of an input that has none: without one there need be no minimum


def places_of(name: str, names: Sequence[str], variables: Sequence[str], first_rate: int, what: str) -> list[int]:
    """Return the places of a name among `names`, or of a rate ``"x.v"`` behind `first_rate`.

    A joint that is a rotation has no entry of its own name: this means what it turns by about all three axes.

    Raises `ArgumentError`: where there is none, with the nearest name.
    """
    places = matching(names, name) or matching(names, f"{name}{_TURNS}")
    if name.endswith(".v"):
        stem = name.removesuffix(".v")
        places += [first_rate + i for i in matching(variables, stem) or matching(variables, f"{stem}{_TURNS}")]
    if not places:
        raise unknown("name", name, (*names, *(f"{each}.v" for each in variables)), what)
    return places


def weights_by_name(
    weights: Mapping[str, float], names: Sequence[str], variables: Sequence[str], first_rate: int, what: str
) -> Array:
    """Return weights of all names, and of the rates of all variables from `first_rate` on.

    A later name overrides an earlier one. Raises `ArgumentError`: unknown names, negative weights.
    """
    require_mapping(weights, what, "{'elbow': 100.0, '*.v': 1.0}")
    out = np.zeros(max(len(names), first_rate + len(variables)))
    for name, given in weights.items():
        out[places_of(name, names, variables, first_rate, what)] = as_number(given, f"{what}[{name!r}]", least=0.0)
    return out


def prices_of_effort(system: System, effort: float | Mapping[str, float]) -> Array:
    """Return the weights (nu,) of the inputs; `ArgumentError` for unknown names, or none above zero."""
    prices = {"*": effort} if not isinstance(effort, Mapping) else effort
    R = np.full(system.nu, _LEAST_EFFORT)
    for name, weight in prices.items():
        places = matching(system.input_names, name)
        if not places:
            raise unknown("input", name, system.input_names, "effort")
        R[places] = as_number(weight, f"effort[{name!r}]", above=0.0)
    return R


def weights_of_axes(weights: Mapping[str, ArrayLike], frames: Iterable[str]) -> Array:
    """Return weights of frames by their names, along or about the axes of each, (n, 3); 1 where none is given.

    Raises `ArgumentError` for wrong shapes and negative weights.
    """
    rows = []
    for name in frames:
        weight = as_array(weights.get(name, 1.0), f"weights: {name!r}", (), (3,))
        if (weight < 0.0).any():
            raise ArgumentError(f"weights: {name!r}: got {weight.tolist()}, expected no negative number")
        rows.append(np.broadcast_to(weight, (3,)))
    return np.array(rows).reshape(-1, 3)


def rotations_of(m: Mechanism) -> dict[str, int]:
    """Return where the quaternions of joints begin in a configuration, by the names of the joints."""
    return {rotation.name: m.coordinates.index(rotation.quaternion[0]) for rotation in m.tree.rotations}
