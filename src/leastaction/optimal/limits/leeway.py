"""Leeway: room that limits are lent at first and give back little by little, so that obstacles grow from nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.sides import Sided

_STEPS = 5  # parts in which leeway is given back
_SHALLOW = 1e-3  # violation, in parts of what is large for it, of a limit that is met without leeway


class Leeway:
    """Room that is added to limits where the start is off by more, and that is given back in stages.

    A start that goes through the middle of an obstacle is pushed back before it and on behind it, and hardly aside: a
    search would leap through it between two instants. An obstacle that is lent as much room as the start misses is a
    point at first. As it grows it pushes aside what passes beside its middle, and what passes through it stands at a
    saddle, from where negative curvature leads aside. This is continuation in the obstacle's size (E. L. Allgower and
    K. Georg, Numerical Continuation Methods (1990), section 6.1), with the barrier's stages as its steps.

    ``whole``: what each side (m,) is lent at first. ``part``: how much of that it still has.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        self.whole = [np.zeros(width) for width in widths]
        self.part = 0.0

    @property
    def is_lent(self) -> bool:
        """Whether any room is lent now."""
        return self.part > 0.0

    def lend(self, rows: Sequence[Rows], curves: Sequence[tuple[Array, Array]]) -> None:
        """Lend all of it to the obstacles that are on some curves (x, u): where a search starts, and where it heads."""
        self.part = 0.0
        for whole in self.whole:
            whole.fill(0.0)
        for i, each in enumerate(rows):
            for x, u in curves:
                if may_be_obstacle(each, x, u):
                    self.whole[i] = np.maximum(self.whole[i], _needed(each, x, u))
                    self.part = 1.0 if self.whole[i].any() else self.part

    def give_back(self) -> None:
        """Have one part less of it."""
        left = round(self.part * _STEPS) - 1
        self.part = max(left, 0) / _STEPS

    def give_all_back(self) -> None:
        """Have none of it any more."""
        self.part = 0.0

    def restore(self, whole: Sequence[Array], part: float) -> None:
        """Have what an earlier run had."""
        self.whole, self.part = [each.copy() for each in whole], part

    def added(self, c: Sided) -> Sided:
        """Return values with what is lent now."""
        return Sided(c.flat + self.part * c.layout.filled(self.whole).flat, c.layout) if self.is_lent else c


def may_be_obstacle(rows: Rows, x: Array, u: Array) -> bool:
    """Whether rows may be those of an obstacle: one-sided, no bounds of the system's own, and not linear."""
    return rows.is_own and not rows.equal and rows.bends(x, u)


def stands_still(rows: Rows, x: Array, u: Array) -> bool:
    """Whether a curve stays where it is, as far as rows of several instants tell."""
    c = rows.values(x, u)
    return len(c) > 1 and bool((np.ptp(c, axis=0) <= _SHALLOW * _large(rows, c)).all())


def _needed(rows: Rows, x: Array, u: Array) -> Array:
    """Return the leeway (m,) of rows along a curve: what obstacles are violated by at most."""
    c = rows.values(x, u)
    off = np.maximum(-c, 0.0).max(axis=0, initial=0.0)
    off[off <= _SHALLOW * _large(rows, c)] = 0.0
    return np.where(rows.rises(c, x, u), off, 0.0) if off.any() else off


def _large(rows: Rows, c: Array) -> Array:
    return np.where(rows.scale > 0.0, rows.scale, np.abs(c).max(axis=0, initial=0.0))
