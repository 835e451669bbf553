"""Derivatives of any order of poses and velocities of frames by the configuration (dissertation 2.4.2).

The pose of a frame is a product of motions, one for each joint on the way to it. A derivative by a joint's coordinate
puts the matrix ``X_j`` of its world twist into the product. So of any order, with the joints nearest to the world first
(i <= j <= ... <= k)::

    dG / ds_i ds_j ... ds_k = X_i X_j ... X_k G,    dG^-1 / ds_i ds_j ... = G^-1 ... (-X_j) (-X_i)

The same holds for velocities: in world axes a joint's axis is turned by the joints before it, in those of the frame
its twist is carried by the joints behind it. This one rule stands for the cases of (2.11) to (2.15), and where the
coordinate of a joint is a sum of variables it is applied to all its terms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from leastaction.mechanics.mechanism.queries.path_motion import PathMotion, inverted
from leastaction.numerics.arrays import Array

Slots = Sequence[Array]
"""By what is differentiated, one after the other: (1, n, nq) the coordinates of n joints by all variables, or (N, n, 1)
along a direction."""


def pose_derivative(motion: PathMotion, slots: Slots, *, inverse: bool) -> Array:
    """Return the derivative (N, 4, 4, ...) of the poses of a frame, or of their inverses, by the slots."""
    hats, poses = _hats(motion.twists), motion.poses
    if inverse:
        total = _ordered_products(-hats[:, ::-1], [slot[:, ::-1] for slot in slots])
        found = inverted(poses).reshape(len(poses), *[1] * len(slots), 4, 4) @ total
    else:
        found = _ordered_products(hats, slots) @ poses.reshape(len(poses), *[1] * len(slots), 4, 4)
    return np.moveaxis(found, (-2, -1), (1, 2))


def jacobian_derivative(motion: PathMotion, slots: Slots) -> Array:
    """Return the derivative (N, 6, ...) of velocities by those of the variables, slot 0, and by the others.

    Of the point and in the axes that `motion` says.
    """
    by, more = slots[0], slots[1:]
    if motion.turn is None:
        angular = motion.twists[:, :, 3:]
        turned = _ordered_vectors(_cross(angular), angular, by, more)
        moved = pose_derivative(motion, slots, inverse=False)
        linear = np.einsum("nab...,b->na...", moved, np.append(motion.point, 1.0))[:, :3]
        return np.concatenate([linear, np.moveaxis(turned, -1, 1)], axis=1)
    own = motion.in_axes().swapaxes(1, 2)
    carried = _ordered_vectors(-_brackets(own)[:, ::-1], own[:, ::-1], by[:, ::-1], [slot[:, ::-1] for slot in more])
    return np.moveaxis(carried, -1, 1)


def _ordered_products(factors: Array, slots: Slots) -> Array:
    """Sum the products of factors (N, n, m, m) over the ways to hand out the slots in order: (N, ..., m, m).

    Each slot chooses a factor, with the weight that it has there; the factors that were chosen are multiplied in the
    order in which they stand.
    """
    last = None
    for _, partial in _partial_products(factors, slots):
        last = partial
    return _complete(last, len(slots))


def _ordered_vectors(factors: Array, vectors: Array, by: Array, slots: Slots) -> Array:
    """Sum the same products of the factors before each vector (N, n, m), times that vector, weighted `by`."""
    N, n, m = vectors.shape
    result = np.zeros((N, *(slot.shape[2] for slot in (by, *slots)), m))
    for j, partial in _partial_products(factors, slots):
        if j == n:
            break
        before = _complete(partial, len(slots))
        at = vectors[:, j].reshape(N, *[1] * len(slots), m, 1)
        term = (before @ at)[..., 0]
        for column, weight in _entries(by, j):
            result[:, column] += _spread(weight, term.ndim) * term
    return result


def _complete(partial: dict[int, Array] | None, count: int) -> Array:
    """Return the product in which all of `count` slots have chosen."""
    assert partial is not None
    return partial[(1 << count) - 1]


def _partial_products(factors: Array, slots: Slots) -> Iterator[tuple[int, dict[int, Array]]]:
    """Yield j = 0 to n, and the products of the first j factors by the set of slots (a bit mask) that have chosen."""
    N, n, m, _ = factors.shape
    count = len(slots)
    masks = range(1 << count)
    members = [[s for s in range(count) if mask >> s & 1] for mask in masks]
    partial = {mask: np.zeros((N, *(slots[s].shape[2] for s in members[mask]), m, m)) for mask in masks}
    partial[0] = np.broadcast_to(np.eye(m), (N, m, m))
    for j in range(n):
        yield j, partial
        powers = [np.broadcast_to(np.eye(m), (N, m, m))]
        for _ in range(count):
            powers.append(powers[-1] @ factors[:, j])
        entries = [list(_entries(slot, j)) for slot in slots]
        # Larger sets first: what they are made of is still that of the factors before.
        for mask in reversed(masks):
            chosen = mask
            while chosen:
                rest = mask ^ chosen
                before = partial[rest]
                term = (before.reshape(N, -1, m) @ powers[len(members[chosen])]).reshape(before.shape)
                for choice in product(*(entries[s] for s in members[chosen])):
                    place = dict(zip(members[chosen], choice, strict=True))
                    weight = np.ones(1)
                    for _, factor in choice:
                        weight = weight * factor
                    index = tuple(place[s][0] if s in place else slice(None) for s in members[mask])
                    partial[mask][(slice(None), *index)] += _spread(weight, term.ndim) * term
                chosen = (chosen - 1) & mask
    yield n, partial


def _entries(slot: Array, j: int) -> Iterator[tuple[int, Array]]:
    """Yield the columns of a slot that a joint's coordinate depends on, with the factors (N,) or (1,)."""
    for column in np.flatnonzero(slot[:, j].any(axis=0)):
        yield int(column), slot[:, j, column]


def _spread(weight: Array, ndim: int) -> Array:
    return weight.reshape(-1, *[1] * (ndim - 1))


def _cross(w: Array) -> Array:
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    out = np.zeros((*w.shape, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = w[..., 0], w[..., 1], w[..., 2]
    return out - out.swapaxes(-1, -2)


def _hats(twists: Array) -> Array:
    """Return twists (..., 6) as matrices (..., 4, 4)."""
    out = np.zeros((*twists.shape[:-1], 4, 4))
    out[..., :3, :3], out[..., :3, 3] = _cross(twists[..., 3:]), twists[..., :3]
    return out


def _brackets(twists: Array) -> Array:
    """Return the matrices (..., 6, 6) of the Lie bracket with twists (..., 6)."""
    out = np.zeros((*twists.shape[:-1], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = _cross(twists[..., 3:])
    out[..., :3, 3:] = _cross(twists[..., :3])
    return out
