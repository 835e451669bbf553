"""Exact derivatives of every discrete step, and of momenta, by the named parameters of the mechanism.

`differentiate_by` is a method of `MidpointVI`, which is ``vi`` here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.description.tree import WORLD
from leastaction.mechanics.discrete.derivatives import linearize, linearize_arrays
from leastaction.mechanics.discrete.impulses import impulses_along
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.arguments import rates, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.parameters import (
    BodyNumber,
    ElementNumber,
    JointNumber,
    Length,
    Place,
    Prescribed,
    inertia_slope,
    parameter_value,
)
from leastaction.mechanics.mechanism.turns import plain_values
from leastaction.numerics.arrays import Array, Row, require_instance
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class StepSensitivity:
    """Derivatives of every step by parameters, its start and its inputs held. Threads may share it.

    Attributes
    ----------
    names : tuple of str
        The parameters.
    x : ndarray, shape (N, ndx, len(names))
        Of the state at the end of each step.
    lam : ndarray, shape (N, nc, len(names))
        Of its multipliers.
    """

    names: tuple[str, ...]
    x: Array
    lam: Array


def differentiate_by(vi: Integrator, trajectory: Trajectory, names: Sequence[str]) -> StepSensitivity:
    """Return the exact first derivatives of every step by some parameters.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism.
    names : sequence of str
        Parameters, among the names of `Mechanism.parameters`.

    Raises
    ------
    ArgumentError
        For an unknown parameter, or a trajectory of a mechanism with other variables.
    StepError
        Where the arrays are not a trajectory of the mechanism.
    """
    linearize(vi, trajectory, multipliers=False)  # its checks
    return steps_by(vi, trajectory.t, trajectory.x, trajectory.u, names)


def steps_by(
    vi: Integrator, t: Array, x: Array, u: Array, names: Sequence[str], *, first_share: float = 1.0
) -> StepSensitivity:
    """Differentiate every step along arrays of a trajectory, which are not checked, by parameters.

    Numbers of elements are differentiated by one dual evaluation each, inertias through the linearity of
    the Lagrangian in them, lengths as what they are: prescribed variables that do not move, and numbers of joints as
    prescribed motions. ``first_share``: the part of the first step for which forces at the instants act at its start.
    """
    m = vi.mechanism
    each, sums = m.members_of(names)
    places = m.parameter_places(each)
    by_x = np.zeros((len(u), m.ndx, len(places)))
    by_lam = np.zeros((len(u), m.nc, len(places)))
    lengths = {name: place for name, place in places.items() if isinstance(place, Prescribed)}
    columns = {name: column for column, name in enumerate(places)}
    if lengths:
        chosen = [columns[name] for name in lengths]
        by_x[:, :, chosen], by_lam[:, :, chosen] = _by_lengths(vi, t, x, u, lengths, first_share)
    others = {name: place for name, place in places.items() if name not in lengths}
    if others:
        directions, inertias = _directions(m, others)
        out = vi.core.by_parameters(t, x, u, directions, inertias, threads=vi.threads, first_share=first_share)
        chosen = [columns[name] for name in others]
        by_x[:, :, chosen], by_lam[:, :, chosen] = out.x, out.lam
    if len(each) > len(names):
        by_x, by_lam = by_x @ sums, by_lam @ sums
    return StepSensitivity(tuple(names), by_x, by_lam)


def by_time_step(vi: Integrator, t: Array, x: Array, u: Array, *, first_share: float = 1.0) -> StepSensitivity:
    """Differentiate every step along arrays by its length, and by the time at its start.

    Its start, its inputs and its prescribed end are held; the time at its start matters where an element changes with
    the time.
    """
    nothing = np.zeros((2, len(vi.mechanism.core.numbers)))
    out = vi.core.by_parameters(t, x, u, nothing, [], time_step=0, time=1, threads=vi.threads, first_share=first_share)
    return StepSensitivity(("dt", "t"), out.x, out.lam)


@public
def momentum_by(mechanism: Mechanism, q: Row, v: Row, names: Sequence[str]) -> Array:
    """Return the derivatives (nd, len(names)) of the momentum dL/dv by parameters, q and v held.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like, shape (nq,) and (nv,)
    names : sequence of str
        Parameters, among the names of `Mechanism.parameters`.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    each, sums = mechanism.members_of(names)
    places = mechanism.parameter_places(each)
    q0, v0 = single(mechanism, q), rates(mechanism, v)
    out = np.zeros((mechanism.nd, len(places)))
    lengths = {name: place for name, place in places.items() if isinstance(place, Prescribed)}
    if lengths:
        nv = mechanism.nv
        freed = mechanism.with_free_lengths(_as_variables(mechanism, lengths))
        q, v = np.append(q0, _held(mechanism, lengths)), np.append(v0, np.zeros(len(lengths)))
        _, by_q, by_v = freed.core.hessian(q, v)
        factors, constant = _growth(mechanism, lengths)
        by = by_q[:nv, nv:] * (factors @ plain_values(mechanism, q0) + constant) + by_v[:nv, nv:] * (factors @ v0)
        by += factors.T * freed.momentum(q, v)[nv:]
    for column, (name, place) in enumerate(places.items()):
        if isinstance(place, BodyNumber):
            joint, slope = inertia_slope(mechanism.tree, place)
            if joint != WORLD:
                out[:, column] = mechanism.core.inertia_slope(q0, v0, joint, list(slope))[1][: mechanism.nd]
        elif isinstance(place, Prescribed):
            out[:, column] = by[: mechanism.nd, list(lengths).index(name)]
    return out @ sums


def _directions(m: Mechanism, places: dict[str, Place]) -> tuple[Array, list[tuple[int, int, list[float]]]]:
    """Return what the core takes: directions of the elements' numbers, and slopes of inertias."""
    directions = np.zeros((len(places), len(m.core.numbers)))
    inertias = []
    for row, (name, place) in enumerate(places.items()):
        if isinstance(place, ElementNumber):
            directions[row, place.slot] = 1.0
        elif isinstance(place, BodyNumber):
            _refuse_partial_gravity(m, name, place)
            joint, slope = inertia_slope(m.tree, place)
            if joint != WORLD:
                inertias.append((row, joint, slope.tolist()))
    return directions, inertias


def _refuse_partial_gravity(m: Mechanism, name: str, place: BodyNumber) -> None:
    if place.field.startswith("inertia"):
        return
    frame = m.tree.frames[place.frame].name
    for label, element in m.elements.items():
        if frame in element.weighed:
            raise ArgumentError(
                f"the parameter {name!r} also sets the weight that {label!r} gives to {frame!r} alone; "
                "derivatives by it are for gravity on all masses, or for none"
            )


def _as_variables(m: Mechanism, lengths: dict[str, Prescribed]) -> dict[str, Prescribed]:
    """Return the places of numbers by names that are no variables of the mechanism yet."""
    renamed = {}
    for name, place in lengths.items():
        while name in m.variables:
            name += "'"
        renamed[name] = place
    return renamed


def _by_lengths(
    vi: Integrator, t: Array, X: Array, U: Array, lengths: dict[str, Prescribed], first_share: float
) -> tuple[Array, Array]:
    """Derivatives of the steps by numbers that a prescribed variable w stands for.

    A length is a variable that stands still. What another number changes is a motion w(q) that is zero and grows with
    the number as c(q) = c_k q_k + c_0: beside what w moves at both ends, its own equation is added to those of the
    variables, c_k times.
    """
    m = vi.mechanism
    freed = vi.like(m.with_free_lengths(_as_variables(m, lengths)))
    count, steps = len(lengths), len(U)
    held = np.tile(_held(m, lengths), (steps + 1, 1))
    x = np.concatenate([X[:, : m.nq], held, X[:, m.nq :], np.zeros_like(held)], axis=1)
    u = np.concatenate([U, held[1:]], axis=1)
    d = linearize_arrays(freed, t, x, u, multipliers=True, first_share=first_share)
    factors, constant = _growth(m, lengths)
    grown = plain_values(m, X[:, : m.nq]) @ factors.T + constant
    nv, nd = m.nv, m.nd
    at_start, at_end = (slice(nv, nv + count), slice(m.n_inputs + m.nrho, m.n_inputs + m.nrho + count))
    by = d.A_all[:, :, at_start] * grown[:-1, None] + d.B_all[:, :, at_end] * grown[1:, None]
    own = factors[:, :nd].T  # (nd, count)
    if own.any():
        momenta = slice(nv + count, nv + count + nd)
        q, inputs = x[:, : freed.mechanism.nq], u[:, : m.n_inputs]
        before, after, held = impulses_along(freed, t, q, inputs, d.lam, first_share=first_share)
        by += d.A_all[:, :, momenta] @ (own * (before - held)[:, None, at_start])
        by[:, momenta] += own * after[:, None, at_start]
    out = by[:, [*range(nv), *range(nv + count, nv + count + nv)]]
    out[:, [*range(nd, nv), *range(nv + nd, m.ndx)]] = 0.0
    return out, by[:, freed.mechanism.ndx :]


def _held(m: Mechanism, lengths: dict[str, Prescribed]) -> Array:
    """Return the values (len(lengths),) of the variables that stand for numbers."""
    numbers, places = m.core.numbers, lengths.values()
    return np.array([parameter_value(m.tree, at, numbers) if isinstance(at, Length) else 0.0 for at in places])


def _growth(m: Mechanism, lengths: dict[str, Prescribed]) -> tuple[Array, Array]:
    """Return how the variables that stand for numbers grow with those: factors (len(lengths), nv), and constants."""
    column = {name: i for i, name in enumerate(m.variables)}
    factors, constant = np.zeros((len(lengths), m.nv)), np.ones(len(lengths))
    for row, place in enumerate(lengths.values()):
        if isinstance(place, JointNumber):
            growth = place.growth(m.tree)
            constant[row] = growth.offset
            for name, factor in growth.terms:
                factors[row, column[name]] = factor
    return factors, constant
