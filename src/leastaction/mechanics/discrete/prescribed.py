"""What is prescribed, as inputs of steps: a variable at their ends, of a rotation the vector that a step turns by.

A rotation that is a quaternion is prescribed as a curve of quaternions, and a step from R1 to R2 is given
``log(R1^-1 R2)``: three numbers without a constraint, in the place of the three turns, so inputs are plain vectors.
"Places" are the prescribed part of a configuration, (nq - first_rho,), with all four numbers of a quaternion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.mechanics.mechanism.arguments import configuration_on
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import prescribed_rotations, turns_for_quaternions
from leastaction.numerics.arrays import Array, as_array, shape_of
from leastaction.numerics.rotations import continued, exponential, inverse, logarithm, product
from leastaction.numerics.signals import Signal, signal_rows

Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]


def prescribed_rows(m: Mechanism, rho: Signal, t: Array, start: Array) -> Array:
    """Return the places at the ends of steps (N, nq - first_rho), checked.

    ``rho``: as of `simulate`. ``t``: times of the ends. ``start`` (nq,): the first configuration, of whose quaternions
    a first row may have the other sign.
    """
    first, names, rotations = m.first_rho, m.coordinates[m.first_rho :], prescribed_rotations(m)
    begin = start[first:].copy()
    if rotations and shape_of(rho) == (len(t) + 1, len(names)):
        row = as_array(rho, "rho", names=names)[0]
        for _, place, _ in rotations:
            here = slice(place, place + 4)
            begin[here] = continued(np.stack([row[here], begin[here]]))[1]
    rows = signal_rows(rho, t, names, "rho", begin, extra_row=True)
    if not rotations:
        return rows
    whole = np.hstack([np.tile(start[:first], (len(rows), 1)), rows])
    return configuration_on(m, whole, "rho")[:, first:]


def step_to(m: Mechanism, q: Array, rho_next: ArrayLike) -> Array:
    """Return the inputs (nrho,) of a step from a configuration (nq,) to places that are given by a user."""
    first, names = m.first_rho, m.coordinates[m.first_rho :]
    given = as_array(rho_next, "rho_next", (len(names),), names=names)
    if not prescribed_rotations(m):
        return given
    whole = configuration_on(m, np.concatenate((q[:first], given)), "rho_next")
    return np.asarray(inputs_along(m, np.stack((q[first:], whole[first:])))[0])


def places_of(m: Mechanism) -> tuple[Indices, Flags]:
    """Return where prescribed variables are in a configuration (nrho,), and which of them are turns.

    Of a turn where its quaternion begins: it has no value of its own, and an input is by how much it changes.
    """
    at = {name: i for i, name in enumerate(m.coordinates)}
    for rotation, place, _ in prescribed_rotations(m):
        at |= dict.fromkeys(rotation.variables, m.first_rho + place)
    places = np.array([at[name] for name in m.kinematic], dtype=np.intp)
    return places, np.array([name not in m.coordinates for name in m.kinematic], dtype=np.bool_)


def inputs_along(m: Mechanism, places: Array) -> Array:
    """Return the inputs (N, nrho) of steps between instants with these places (N+1, nq - first_rho)."""
    rotations = prescribed_rotations(m)
    if not rotations:
        return places[1:]
    u = held(m, places[1:])
    for _, place, turn in rotations:
        q = places[:, place : place + 4]
        u[:, turn : turn + 3] = logarithm(product(inverse(q[:-1]), q[1:]))
    return u


def held(m: Mechanism, places: Array) -> Array:
    """Return the inputs (..., nrho) of steps over which places (..., nq - first_rho) stay."""
    return turns_for_quaternions(m, places)


def reached(m: Mechanism, places: Array, u: Array, share: float = 1.0) -> Array:
    """Return the places (nq - first_rho,) after a share of a step from places under inputs (nrho,)."""
    rotations = prescribed_rotations(m)
    if not rotations:
        return np.asarray(places + share * (u - places))
    out = np.empty_like(places)
    plain = np.ones(len(places), dtype=bool), np.ones(m.nrho, dtype=bool)
    for _, place, turn in rotations:
        out[place : place + 4] = product(places[place : place + 4], exponential(share * u[turn : turn + 3]))
        plain[0][place : place + 4] = plain[1][turn : turn + 3] = False
    out[plain[0]] = places[plain[0]] + share * (u[plain[1]] - places[plain[0]])
    return out


def divided(m: Mechanism, places: Array, u: Array, parts: int) -> Array:
    """Return the inputs (parts, nrho) of equal parts of a step from places under inputs (nrho,): all goes evenly."""
    before = held(m, places)
    rows = np.asarray(before + np.arange(1, parts + 1)[:, None] / parts * (u - before))
    for _, _, turn in prescribed_rotations(m):
        rows[:, turn : turn + 3] = u[turn : turn + 3] / parts
    return rows
