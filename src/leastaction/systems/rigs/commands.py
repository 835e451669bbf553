"""What is commanded of a rig whose strings stretch: a plan with strings that are shorter by that."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.rigs.rig import Rig
from leastaction.systems.rigs.strings import stretch_of

_VARIED = 0.1  # part of a length by which it is varied
_CORRECTIONS = 3  # of prescribed variables
_FIRM = 1e-2  # of the most that prescribed variables move strings by: what moves them by less would go far for them


def reeled_in(system: MidpointSystem, x: Array, u: Array, rig: Rig) -> tuple[Array, Array, Mapping[str, float]]:
    """Return the states without multipliers and the inputs with strings shorter by what their tensions stretch them.

    The third are the parameters of strings whose lengths are numbers, and by how much these are shorter: by what the
    strings are stretched in the mean. What is left of that is made up for by the prescribed variables where they can
    move each of these strings, all along: seven strings would throw a bar of six numbers about.
    """
    m = system.mechanism
    planned, u = np.array(x[:, : m.nx]), np.array(u)
    if rig.stiffness is None or not m.nc:
        return planned, u, {}
    stretched: dict[str, Array] = {}
    for name, pull in system.trajectory(x, u).tensions().items():
        pull[0] *= 2.0  # the first impulse is that of half a step
        by = stretch_of(np.append(pull, pull[-1]), rig.stiffness, rig.smoothing)
        variable = m.elements[name].length_variable
        if variable is None:
            stretched[name] = by
        else:
            planned[:, m.variables.index(variable)] -= by
    shorter = {f"{name}.length": float(by.mean()) for name, by in stretched.items()}
    if stretched and m.nrho:
        left = {name: by - by.mean() for name, by in stretched.items()}
        _follow_stretch(m, planned, left)
    q, p, v_rho = np.split(planned, [m.nq, m.nq + m.nd], axis=1)
    u[:, m.n_inputs :] = q[1:, m.nd :]
    return system.states_along(q, p, v_rho[0])[:, : m.nx], u, shorter


def _follow_stretch(m: Mechanism, planned: Array, longer: Mapping[str, Array]) -> None:
    """Move the prescribed variables of states (N+1, nx) so that strings of given lengths are longer by (N+1,).

    They stay where some string, at some instant, is one that they do not move, or hardly.
    """
    rows = [m.constraints.index(name) for name in longer]
    reeled = {m.elements[name].length_variable for name in m.constraints if name in m.elements}
    moved = [m.variables.index(name) for name in m.kinematic if name not in reeled]
    q = np.ascontiguousarray(planned[:, : m.nq])
    moves = [np.linalg.svd(m.constraint_jacobian(at)[np.ix_(rows, moved)], compute_uv=False) for at in q]
    if len(rows) > len(moved) or any(each[-1] < _FIRM * each[0] for each in moves):
        return
    # Of a longer string a constraint has less, by a square or a line of its length, wherever its ends are.
    wanted = np.empty((len(q), len(rows)))
    for i, (row, name, by) in enumerate(zip(rows, longer, longer.values(), strict=True)):
        parameter = f"{name}.length"
        length = m.parameters[parameter]
        less, same, more = (
            m.with_parameters({parameter: factor * length}).constraint_values(q[0])[row]
            for factor in (1.0 - _VARIED, 1.0, 1.0 + _VARIED)
        )
        share = by / (_VARIED * length)
        wanted[:, i] = -0.5 * share * ((more - less) + share * (more - 2.0 * same + less))
    for at, goal, row in zip(q, wanted, planned, strict=True):
        before = m.constraint_values(at)[rows]
        for _ in range(_CORRECTIONS):
            missing = goal - (m.constraint_values(at)[rows] - before)
            at[moved] += np.linalg.lstsq(m.constraint_jacobian(at)[np.ix_(rows, moved)], missing)[0]
        row[moved] = at[moved]


def with_lengths(mechanism: Mechanism, shorter: Mapping[str, float]) -> Mechanism:
    """Return a mechanism whose strings are shorter by so much, by the parameters of their lengths."""
    numbers = mechanism.parameters
    return (
        mechanism.with_parameters({name: numbers[name] - by for name, by in shorter.items()}) if shorter else mechanism
    )
