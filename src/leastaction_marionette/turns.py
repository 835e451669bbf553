"""Turns of the puppet's ball joints, whose quaternions end in .qw, .qx, .qy and .qz: of poses and motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.mechanics import Mechanism
from leastaction.numerics import Array
from leastaction.optimal import ProductSpace, Rotations, StateSpace, Vectors


def body_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the numbers that say how the body of a marionette stands: the first ones of q."""
    return mechanism.coordinates[: mechanism.first_rho]


def quaternions_among(names: Sequence[str]) -> list[list[int]]:
    """Return where the quaternions stand among columns of some names, scalars first."""
    places = {name: i for i, name in enumerate(names)}
    joints = [name.removesuffix(".qw") for name in names if name.endswith(".qw")]
    return [[places[f"{joint}.q{letter}"] for letter in "wxyz"] for joint in joints]


def space_of(mechanism: Mechanism) -> ProductSpace:
    """Return how configurations of a mechanism differ and move."""
    parts = list[StateSpace]()
    for name in mechanism.coordinates:
        if name.endswith(".qw"):
            parts.append(Rotations())
        elif not name.endswith((".qx", ".qy", ".qz")):
            parts.append(Vectors(1))
    return ProductSpace(*parts)


def differences(mechanism: Mechanism, q: Array, qbar: Array) -> Array:
    """Return configurations (..., nq) less others, (..., nv): of quaternions the rotation vectors between them."""
    return space_of(mechanism).difference(q, qbar) if mechanism.tree.rotations else q - qbar


def moved(mechanism: Mechanism, q: Array, dq: Array) -> Array:
    """Return the configurations (..., nq) that are dq (..., nv) from others: what `differences` undoes."""
    return space_of(mechanism).plus(q, dq) if mechanism.tree.rotations else q + dq


def turned(mechanism: Mechanism, dq: Array) -> Array:
    """Return the derivative (nv, nv) of where `moved` leads by dq (nv,), as a move of the place that it led to."""
    if not mechanism.tree.rotations:
        return np.eye(mechanism.nv)
    space, q = space_of(mechanism), mechanism.configuration()
    return np.asarray(np.linalg.inv(space.difference_derivative(space.plus(q, dq), q)))


def rates_along(mechanism: Mechanism, q: Array, t: Array) -> Array:
    """Return the velocities (N+1, nv) of a motion q (N+1, nq) at its instants, which follow in equal steps."""
    if not mechanism.tree.rotations:
        return np.asarray(np.gradient(q, t, axis=0))
    steps = differences(mechanism, q[1:], q[:-1]) / (t[1] - t[0])
    return np.concatenate([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]])


def unit(names: Sequence[str], q: Array) -> Array:
    """Return values (..., n) of columns, their quaternions divided by their lengths."""
    found = np.array(q)
    for at in quaternions_among(names):
        found[..., at] /= np.linalg.norm(found[..., at], axis=-1, keepdims=True)
    return found


def on_the_way(names: Sequence[str], first: Array, q: Array, share: Array | float) -> Array:
    """Return what is a share of the way from first values (n,) of columns to others (N, n).

    ``share``: a number, or one for each row (N, 1). A rotation goes about one axis. Where quaternions have no jumps
    from row to row, what is returned has none either, up to a whole turn.
    """
    found = first + share * (q - first)
    for at in quaternions_among(names):
        w, x, y, z = first[at]
        back = np.array([[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])
        apart = q[:, at] @ back.T
        if apart[0, 0] < 0.0:
            apart = -apart
        sine = np.linalg.norm(apart[:, 1:], axis=1, keepdims=True)
        half = share * np.arctan2(sine, apart[:, :1])
        turned = np.hstack([np.cos(half), np.sin(half) * apart[:, 1:] / np.maximum(sine, 1e-300)])
        found[:, at] = turned @ back
    return found


def as_vectors(mechanism: Mechanism, q: Array) -> Array:
    """Return how the body stands along a motion q (N+1, nq) by its variables (N+1, nd): turns as rotation vectors.

    They go on from instant to instant up to a whole turn.
    """
    names, body = body_of(mechanism), q[:, : mechanism.first_rho]
    columns = {at[0]: at for at in quaternions_among(names)}
    parts = []
    for i, name in enumerate(names):
        if i in columns:
            turn = body[:, columns[i]] * (1.0 if body[0, i] >= 0.0 else -1.0)
            sine = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
            parts.append(2.0 * np.arctan2(sine, turn[:, :1]) * turn[:, 1:] / np.maximum(sine, 1e-300))
        elif not name.endswith((".qx", ".qy", ".qz")):
            parts.append(body[:, i : i + 1])
    return np.hstack(parts)
