"""Quaternions among the columns of a motion, by their names: those of a joint end in .qw, .qx, .qy and .qz."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.mechanics import Mechanism
from leastaction.numerics import Array


def body_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the numbers that say how the body of a marionette stands: the first ones of q."""
    return mechanism.coordinates[: mechanism.first_rho]


def quaternions_among(names: Sequence[str]) -> list[list[int]]:
    """Return where the quaternions stand among columns of some names, scalars first."""
    places = {name: i for i, name in enumerate(names)}
    joints = [name.removesuffix(".qw") for name in names if name.endswith(".qw")]
    return [[places[f"{joint}.q{letter}"] for letter in "wxyz"] for joint in joints]


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
