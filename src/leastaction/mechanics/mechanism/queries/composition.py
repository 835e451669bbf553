"""Functions of a mechanism as functions of something else, with derivatives of any order.

Of ``f(z(y))`` the derivative along directions is the sum, over the ways to put them into groups, of the derivative of f
along what z changes by along each group (Faa di Bruno). The classes evaluate, see
`leastaction.mechanics.mechanism.queries.function_derivatives.Evaluate`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from leastaction.mechanics.mechanism.queries.function_derivatives import Evaluate
from leastaction.mechanics.mechanism.queries.turn_charts import Jets
from leastaction.numerics.arrays import Array
from leastaction.numerics.jets import Jet

Group = tuple[int, ...]
Places = NDArray[np.intp]

_ZERO: Array = np.zeros(())


@dataclass(frozen=True)
class Turns:
    """The entries ``z`` (n, a) that tell of n quaternions, as functions of entries ``y`` (n, b), at ``at`` (n, b)."""

    function: Callable[[Jets], Jets]
    z: Places
    y: Places
    at: Array

    def orders(self, directions: Array) -> dict[int, Array]:
        """Return derivatives (n, a, ..) along sets of directions, the last two bits for entries of y: axes of b."""
        jets = self.function(self.moving(directions))[: self.z.shape[1]]
        found = _orders(jets, len(directions), self.y.shape)
        return {key: each[:, :, 0] for key, each in found.items()}

    def moving(self, directions: Array) -> Jets:
        """Return the entries y, which move along k directions, by one of their own, and by another."""
        k, (n, b) = len(directions), self.y.shape
        jets = []
        for own, place, at in zip(np.eye(b), self.y.T, self.at.T, strict=True):
            parts = {1 << i: along[place].reshape(n, 1, 1, 1) for i, along in enumerate(directions)}
            parts |= {0: at.reshape(n, 1, 1, 1), 1 << k: own.reshape(1, 1, b, 1), 2 << k: own.reshape(1, 1, 1, b)}
            jets.append(Jet(parts))
        return jets


def _orders(jets: Jets, k: int, shape: tuple[int, ...]) -> dict[int, Array]:
    """Return the derivatives (n, a, c, ..) of a jets by set of directions, the last of which are for b entries each."""
    out, (n, b) = {}, shape
    for key in set().union(*(jet.parts for jet in jets)):
        wide = np.broadcast_shapes(*(jet.part(key).shape for jet in jets), (n, 1, 1, 1))
        each = np.stack([np.broadcast_to(jet.part(key), wide) for jet in jets], axis=1)
        out[key] = each.reshape(*each.shape[:3], *[b] * (key >> k).bit_count())
    return out


class Moves:
    """What z changes by along groups of directions, by further entries of y, and by two of them."""

    def __init__(self, by: Array, turns: Turns | None, directions: Array) -> None:
        """Of what is not turned ``z = by y``."""
        self._by, self._turns, self._directions = by, turns, directions
        self._orders = {} if turns is None else turns.orders(directions)

    def value(self, group: Group) -> Array:
        """Return the derivative (nz,) along a group."""
        moved = self._by @ self._directions[group[0]] if len(group) == 1 else np.zeros(len(self._by))
        for places, _, part in self._of(group, 0):
            moved[places] = part
        return moved

    def slope(self, group: Group) -> Array:
        """Return its derivative (nz, ny) by y."""
        slope = np.zeros_like(self._by) if group else self._by.copy()
        for places, by, part in self._of(group, 1):
            slope[np.ix_(places, by)] = part
        return slope

    def bend(self, group: Group, weights: Array) -> Array:
        """Return the second one (ny, ny), of the sum with weights (nz,)."""
        bend = np.zeros((self._by.shape[1], self._by.shape[1]))
        for places, by, part in self._of(group, 3):
            bend[np.ix_(by, by)] += np.tensordot(weights[places], part, 1)
        return bend

    def _of(self, group: Group, entries: int) -> Iterator[tuple[Places, Places, Array]]:
        key = sum(1 << i for i in group) | entries << len(self._directions)
        if self._turns is not None and key in self._orders:
            yield from zip(self._turns.z, self._turns.y, self._orders[key], strict=True)


@dataclass(frozen=True)
class Composed:
    """A function of z as one of y, times a factor: ``z = by y`` but for what turns say."""

    inner: Evaluate
    by: Array
    factor: float = 1.0
    turns: Turns | None = None

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        moves = Moves(self.by, self.turns, directions)
        values, gradients, hessian = _ZERO, _ZERO, _ZERO
        for rest, groups in _ways(len(directions), linear=self.turns is None):
            along = np.array([moves.value(group) for group in groups]).reshape(-1, len(self.by))
            value, gradient, second = self.inner(along, weights)
            values = values if rest else values + self.factor * value
            gradients = gradients + gradient @ (self.factor * moves.slope(rest))
            if self.turns is not None:
                hessian = hessian + moves.bend(rest, self.factor * (weights @ gradient))
            for first, other in _halves(rest):
                hessian = hessian + moves.slope(first).T @ second @ (self.factor * moves.slope(other))
        return values, gradients, hessian


@dataclass(frozen=True)
class PushedBack:
    """Forces on z as forces on y, by what they do where y moves.

    Both have the rows ``rows`` (n, 3) of turns, and the same rows otherwise, times a factor. ``pushes``: how turns of
    the second kind count in the first.
    """

    inner: Evaluate
    turns: Turns
    pushes: Callable[[Jets, Jets], Jets]
    rows: Places
    factor: float = 1.0

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        count = len(directions)
        units = [Jet({0: each.reshape(1, 3, 1, 1)}) for each in np.eye(3)]
        jets = self.pushes(self.turns.moving(directions), units)
        # Axes: quaternions, rows of z, rows of y, entries of y.
        orders = _orders(jets, count, self.turns.y.shape)
        own, other, both = 0, 1 << count, 3 << count
        values, gradients, hessian = _ZERO, _ZERO, _ZERO
        for some in _subsets(range(count)):
            rest = [i for i in range(count) if i not in some]
            key = sum(1 << i for i in some)
            map_ = self._map(orders.get(key | own), 0.0 if some else self.factor, len(weights))
            value, gradient, second = self.inner(directions[rest], map_ @ weights)
            values, gradients, hessian = values + map_.T @ value, gradients + map_.T @ gradient, hessian + second
            for ball, (row, by) in enumerate(zip(self.rows, self.turns.y, strict=True)):
                if key | other in orders:
                    push = orders[key | other][ball]
                    gradients[np.ix_(row, by)] += np.tensordot(value[row], push, 1)
                    bent = np.einsum("aui,u,az->iz", push, weights[row], gradient[row])
                    hessian[by] += bent
                    hessian[:, by] += bent.T
                if key | both in orders:
                    hessian[np.ix_(by, by)] += np.einsum(
                        "auij,u,a->ij", orders[key | both][ball], weights[row], value[row]
                    )
        return values, gradients, hessian

    def _map(self, turned: Array | None, factor: float, size: int) -> Array:
        """Return rows of z by rows of y (size, size)."""
        out = factor * np.eye(size)
        for ball, row in enumerate(self.rows):
            out[np.ix_(row, row)] = 0.0 if turned is None else turned[ball]
        return out


def _ways(count: int, *, linear: bool) -> Iterator[tuple[Group, list[Group]]]:
    """Yield the ways to put directions into groups and a rest: where all is linear, one by one and no rest."""
    if linear:
        yield (), [(i,) for i in range(count)]
        return
    for some in _subsets(range(count)):
        rest = tuple(i for i in range(count) if i not in some)
        yield from ((rest, groups) for groups in _groups(some))


def _groups(members: Group) -> Iterator[list[Group]]:
    """Yield the ways to put members into groups."""
    if not members:
        yield []
        return
    first, others = members[0], members[1:]
    for more in _subsets(others):
        rest = tuple(i for i in others if i not in more)
        yield from ([(first, *more), *groups] for groups in _groups(rest))


def _subsets(members: Sequence[int]) -> Iterator[Group]:
    return chain.from_iterable(combinations(members, size) for size in range(len(members) + 1))


def _halves(members: Group) -> Iterator[tuple[Group, Group]]:
    """Yield the ways to hand members to one of two."""
    return ((some, tuple(i for i in members if i not in some)) for some in _subsets(members))
