"""Differences of configurations and states: of rotations that are quaternions the rotation vectors between them."""

from __future__ import annotations

import numpy as np

from leastaction import _core
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array


def differences(m: Mechanism, q: Array, qbar: Array) -> Array:
    """Return configurations q (N, nq) less others, (N, nv)."""
    if not m.tree.rotations:
        return q - qbar
    still = np.zeros((len(q), m.nv))
    x, xbar = np.hstack([q, still]), np.hstack([qbar, still])
    return np.asarray(_core.difference(m.core, x, xbar))[:, : m.nv]


def moved(m: Mechanism, q: Array, dq: Array) -> Array:
    """Return configurations that are dq (N, nv) from others (N, nq), (N, nq): what `differences` undoes."""
    if not m.tree.rotations:
        return q + dq
    still = np.zeros((len(q), m.nv))
    return np.asarray(_core.plus(m.core, np.hstack([q, still]), np.hstack([dq, still])))[:, : m.nq]


def middles(m: Mechanism, q: Array) -> Array:
    """Return the configurations (N, nq) in the middle of steps between q (N+1, nq)."""
    if not m.tree.rotations:
        return 0.5 * (q[1:] + q[:-1])
    return moved(m, q[:-1], 0.5 * differences(m, q[1:], q[:-1]))
