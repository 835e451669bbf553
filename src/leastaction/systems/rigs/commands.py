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
# They can follow whatever strings are stretched by where, all along, the least that they move strings by is more than
# this part of the most. Else they follow what is smoothed over some seconds, for tensions come at once, and a length is
# rather off by some metres than that its end moves by one, or turns by a radian; what moves strings by less than that
# part is left where it is.
_FIRM, _SMOOTH, _BEYOND = 1e-2, 0.1, 0.1


def reeled_in(system: MidpointSystem, x: Array, u: Array, rig: Rig) -> tuple[Array, Array, Mapping[str, float]]:
    """Return the states without multipliers and the inputs with strings shorter by what their tensions stretch them.

    The third are the parameters of strings whose lengths are numbers, and by how much these are shorter: by what the
    strings are stretched in the mean. What is left of that is made up for by the prescribed variables, as nearly as
    they can.
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
        _follow_stretch(m, planned, left, _SMOOTH / float(np.diff(system.t).mean()))
    q, p, v_rho = np.split(planned, [m.nq, m.nq + m.nd], axis=1)
    u[:, m.n_inputs :] = q[1:, m.nd :]
    return system.states_along(q, p, v_rho[0])[:, : m.nx], u, shorter


def _follow_stretch(m: Mechanism, planned: Array, longer: Mapping[str, Array], smooth: float) -> None:
    """Move the prescribed variables of states (N+1, nx) so that strings of given lengths are longer by (N+1,).

    Where they cannot, as nearly as they do without going far, what is wanted being smoothed over some steps: seven
    strings would throw a bar of six numbers about.
    """
    rows = [m.constraints.index(name) for name in longer]
    lengths = [f"{name}.length" for name in longer]
    q = np.ascontiguousarray(planned[:, : m.nq])
    # Of a longer string a constraint has less, by a square or a line of its length, wherever its ends are.
    wanted = np.empty((len(q), len(rows)))
    for i, (row, name, by) in enumerate(zip(rows, lengths, longer.values(), strict=True)):
        length = m.parameters[name]
        less, same, more = (
            m.with_parameters({name: factor * length}).constraint_values(q[0])[row]
            for factor in (1.0 - _VARIED, 1.0, 1.0 + _VARIED)
        )
        share = by / (_VARIED * length)
        wanted[:, i] = -0.5 * share * ((more - less) + share * (more - 2.0 * same + less))
    reeled = {m.elements[name].length_variable for name in m.constraints if name in m.elements}
    moved = [m.variables.index(name) for name in m.kinematic if name not in reeled]
    by_each = [np.linalg.svd(m.constraint_jacobian(at)[np.ix_(rows, moved)], compute_uv=False) for at in q]
    beyond = 0.0
    if len(rows) > len(moved) or any(moves[-1] < _FIRM * moves[0] for moves in by_each):
        from scipy.ndimage import gaussian_filter1d  # here: what is not asked for need not be loaded

        beyond, wanted = _BEYOND, gaussian_filter1d(wanted, smooth, axis=0, mode="nearest")
    for at, goal, row in zip(q, wanted, planned, strict=True):
        before = m.constraint_values(at)[rows]
        for _ in range(_CORRECTIONS):
            missing = goal - (m.constraint_values(at)[rows] - before)
            left, moves, right = np.linalg.svd(m.constraint_jacobian(at)[np.ix_(rows, moved)], full_matrices=False)
            firm = moves > _FIRM * moves[0]
            gain = moves[firm] / (moves[firm] ** 2 + beyond**2)
            at[moved] += right[firm].T @ (gain * (left[:, firm].T @ missing))
        row[moved] = at[moved]


def with_lengths(mechanism: Mechanism, shorter: Mapping[str, float]) -> Mechanism:
    """Return a mechanism whose strings are shorter by so much, by the parameters of their lengths."""
    numbers = mechanism.parameters
    return (
        mechanism.with_parameters({name: numbers[name] - by for name, by in shorter.items()}) if shorter else mechanism
    )
