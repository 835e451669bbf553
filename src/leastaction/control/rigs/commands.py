"""What is commanded of a rig whose strings stretch: a plan with strings that are shorter by that."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from leastaction.control.rigs.strings import stretch_of
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.rig import Rig


class ReeledIn(NamedTuple):
    """A plan with strings that are shorter by what they are stretched.

    ``x`` (N+1, nx), ``u`` (N, nu): the states without multipliers and the inputs. ``shorter``: the parameters of
    strings whose lengths are numbers, and by how much these are shorter (m): what they are stretched in the mean.
    ``least``: by how much each string is stretched at the least (m), 0 for one that pushes.
    """

    x: Array
    u: Array
    shorter: Mapping[str, float]
    least: Mapping[str, float]


def reeled_in(system: MidpointSystem, x: Array, u: Array, rig: Rig) -> ReeledIn:
    """Return what is planned on strings that do not stretch as it would be on those of a rig."""
    m = system.mechanism
    planned, u = np.array(x[:, : m.nx]), np.array(u)
    if rig.stiffness is None or not m.nc:
        return ReeledIn(planned, u, {}, {})
    shorter, least = dict[str, float](), dict[str, float]()
    for name, pull in system.trajectory(x, u).tensions().items():
        pull[0] *= 2.0  # the first impulse is that of half a step
        by = stretch_of(np.append(pull, pull[-1]), rig.stiffness, rig.smoothing)
        least[name] = max(float(pull.min()), 0.0) / rig.stiffness
        variable = m.elements[name].length_variable
        if variable is None:
            shorter[f"{name}.length"] = float(by.mean())
        else:
            planned[:, m.coordinates.index(variable)] -= by
    q, p, v_rho = np.split(planned, [m.nq, m.nq + m.nd], axis=1)
    u[:, m.n_inputs :] = q[1:, m.first_rho :]
    return ReeledIn(system.states_along(q, p, v_rho[0])[:, : m.nx], u, shorter, least)


def with_lengths(mechanism: Mechanism, shorter: Mapping[str, float]) -> Mechanism:
    """Return a mechanism whose strings are shorter by so much, by the parameters of their lengths."""
    numbers = mechanism.parameters
    return (
        mechanism.with_parameters({name: numbers[name] - by for name, by in shorter.items()}) if shorter else mechanism
    )
