"""Derivatives of any order of poses and velocities of frames by the configuration (dissertation 2.4.2).

The pose of a frame is a product of motions, one for each joint on the way to it. A derivative by a joint's coordinate
puts the matrix ``X_j`` of its world twist into the product. So of any order, with the joints nearest to the world first
(i <= j <= ... <= k)::

    dG / ds_i ds_j ... ds_k = X_i X_j ... X_k G,    dG^-1 / ds_i ds_j ... = G^-1 ... (-X_j) (-X_i)

The same holds for velocities: in world axes a joint's axis is turned by the joints before it, in those of the frame
its twist is carried by the joints behind it. This one rule stands for the cases of (2.11) to (2.15), and where the
coordinate of a joint is a sum of variables it is applied to all its terms.

Of a rotation that is a quaternion three joints stand in one place and turn as one, by ``exp(s_1 X_1 + s_2 X_2 +
s_3 X_3)``: of several derivatives by its turns the mean of the products in all orders stands for the product. Its
angular velocities are about axes of the body, which these turns carry along.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, pairwise, product

import numpy as np
from numpy.typing import NDArray

from leastaction.mechanics.mechanism.queries.path_motion import PathMotion, inverted
from leastaction.numerics.arrays import Array

Slots = Sequence[Array]
"""By what is differentiated, one after the other: (1, n, nv) the coordinates of n joints by all variables, or (N, n, 1)
along a direction."""


def pose_derivative(motion: PathMotion, slots: Slots, *, inverse: bool) -> Array:
    """Return the derivative (N, 4, 4, ...) of the poses of a frame, or of their inverses, by the slots."""
    hats, poses = _hats(motion.twists), motion.poses
    if inverse:
        total = _ordered_products(-hats[:, ::-1], [slot[:, ::-1] for slot in slots], _places(motion.order[::-1]))
        found = inverted(poses).reshape(len(poses), *[1] * len(slots), 4, 4) @ total
    else:
        total = _ordered_products(hats, slots, _places(motion.order))
        found = total @ poses.reshape(len(poses), *[1] * len(slots), 4, 4)
    return np.moveaxis(found, (-2, -1), (1, 2))


def jacobian_derivative(motion: PathMotion, slots: Slots) -> Array:
    """Return the derivative (N, 6, ...) of velocities by those of the variables, slot 0, and by the others.

    Of the point and in the axes that `motion` says.
    """
    by, more = slots[0], slots[1:]
    if motion.turn is None:
        angular, places = motion.twists[:, :, 3:], _places(motion.order)
        turned = _ordered_vectors(_cross(angular), angular, by, more, places, turned=True)
        total = _ordered_products(_hats(motion.twists), slots, places, last=0)
        moved = total @ motion.poses.reshape(len(motion.poses), *[1] * len(slots), 4, 4)
        linear = np.einsum("n...ab,b->n...a", moved, np.append(motion.point, 1.0))[..., :3]
        return np.moveaxis(np.concatenate([linear, turned], axis=-1), -1, 1)
    own, places = motion.in_axes().swapaxes(1, 2)[:, ::-1], _places(motion.order[::-1])
    carried = _ordered_vectors(-_brackets(own), own, by[:, ::-1], [slot[:, ::-1] for slot in more], places)
    return np.moveaxis(carried, -1, 1)


def _places(order: NDArray[np.intp]) -> list[range]:
    """Return which joints stand in one place, one after the other: one each, or the three of a quaternion."""
    ends = [0, *(np.flatnonzero(np.diff(order)) + 1).tolist(), len(order)]
    return [range(*each) for each in pairwise(ends) if each[1]]


def _ordered_products(factors: Array, slots: Slots, places: list[range], last: int | None = None) -> Array:
    """Sum the products of factors (N, n, m, m) over the ways to hand out the slots in order: (N, ..., m, m).

    Each slot chooses a factor, with the weight that it has there; the factors that were chosen are multiplied in the
    order of their places; within one the slot `last` comes last.
    """
    *_, (_, partial) = _partial_products(factors, slots, places, last)
    return partial[(1 << len(slots)) - 1]


def _ordered_vectors(
    factors: Array, vectors: Array, by: Array, slots: Slots, places: list[range], *, turned: bool = False
) -> Array:
    """Sum the same products of the factors before each vector (N, n, m), times that vector, weighted `by`.

    ``turned``: those of its own place too, where several stand there.
    """
    N, _, m = vectors.shape
    result = np.zeros((N, *(slot.shape[2] for slot in (by, *slots)), m))
    for i, partial in _partial_products(factors, slots, places, None):
        all_chosen = partial[(1 << len(slots)) - 1]
        done = [place for place in places[i - 1 : i] if turned and len(place) > 1]
        ahead = [place for place in places[i : i + 1] if not turned or len(place) == 1]
        for j in chain(*done, *ahead):
            at = vectors[:, j].reshape(N, *[1] * len(slots), m, 1)
            term = (all_chosen @ at)[..., 0]
            for column, weight in _entries(by, j):
                result[:, column] += _spread(weight, term.ndim) * term
    return result


def _partial_products(
    factors: Array, slots: Slots, places: list[range], last: int | None
) -> Iterator[tuple[int, dict[int, Array]]]:
    """Yield how many places are done, and the products of their factors by the set of slots (a mask) that chose."""
    N, _, m, _ = factors.shape
    count = len(slots)
    masks = range(1 << count)
    members = [[s for s in range(count) if mask >> s & 1] for mask in masks]
    partial = {mask: np.zeros((N, *(slots[s].shape[2] for s in members[mask]), m, m)) for mask in masks}
    partial[0] = np.broadcast_to(np.eye(m), (N, m, m))
    yield 0, partial
    for done, place in enumerate(places, 1):
        means = _Means(factors)
        entries = [[(j, column, weight) for j in place for column, weight in _entries(slot, j)] for slot in slots]
        # Larger sets first: what they are made of is still that of the factors before.
        for mask in reversed(masks):
            chosen = mask
            while chosen:
                rest = mask ^ chosen
                before = partial[rest].reshape(N, -1, m)
                for choice in product(*(entries[s] for s in members[chosen])):
                    own = dict(zip(members[chosen], choice, strict=True))
                    ending = [own[last][0]] if last in own else []
                    others = sorted(j for s, (j, *_) in own.items() if s != last)
                    term = (before @ means.of(tuple(others), *ending)).reshape(partial[rest].shape)
                    weight = np.ones(1)
                    for _, _, factor in choice:
                        weight = weight * factor
                    index = tuple(own[s][1] if s in own else slice(None) for s in members[mask])
                    partial[mask][(slice(None), *index)] += _spread(weight, term.ndim) * term
                chosen = (chosen - 1) & mask
        yield done, partial


class _Means:
    """Products of factors (N, n, m, m), each made once."""

    def __init__(self, factors: Array) -> None:
        self._factors = factors
        self._known: dict[tuple[int, ...], Array] = {}

    def of(self, chosen: tuple[int, ...], *last: int) -> Array:
        """Return the mean (N, m, m) of the products of some factors in all orders, times another."""
        if last:
            return self.of(chosen) @ self._factors[:, last[0]]
        if not chosen:
            return np.broadcast_to(np.eye(self._factors.shape[2]), (len(self._factors), *self._factors.shape[2:]))
        if chosen not in self._known:
            total = np.zeros(())
            for j in sorted(set(chosen)):
                at = chosen.index(j)
                rest = (*chosen[:at], *chosen[at + 1 :])
                total = total + chosen.count(j) / len(chosen) * (self.of(rest) @ self._factors[:, j])
            self._known[chosen] = total
        return self._known[chosen]


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
