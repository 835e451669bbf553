"""Numbers that carry their derivatives along several directions at once, of any order, each direction once.

A `Jet` is ``sum over sets S of directions: x_S e_S`` with ``e_S`` the product of units of square zero, one for each
direction. At ``x + e_1 d_1 + e_2 d_2 + ...`` the part of a function that goes with a set is its derivative along the
directions in it. Parts are arrays of any shapes that go together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import factorial
from typing import TypeAlias, Union

import numpy as np

from leastaction.numerics.arrays import Array

Number: TypeAlias = Union["Jet", Array, float]


@dataclass(frozen=True, eq=False)
class Jet:
    """The parts by set of directions, a bit mask; those that are missing are zero."""

    parts: Mapping[int, Array]

    __array_ufunc__ = None  # arrays leave arithmetic to it

    def __add__(self, other: Number) -> Jet:
        total = dict(self.parts)
        for key, part in _parts(other).items():
            total[key] = total[key] + part if key in total else part
        return Jet(total)

    __radd__ = __add__

    def __mul__(self, other: Number) -> Jet:
        total: dict[int, Array] = {}
        for key, part in self.parts.items():
            for more, factor in _parts(other).items():
                if not key & more:
                    both = key | more
                    total[both] = total[both] + part * factor if both in total else part * factor
        return Jet(total)

    __rmul__ = __mul__

    def __neg__(self) -> Jet:
        return self * -1.0

    def __sub__(self, other: Number) -> Jet:
        return self + -other

    def __rsub__(self, other: Number) -> Jet:
        return other + -self

    @property
    def value(self) -> Array:
        """The part without a direction."""
        return self.part(0)

    def part(self, directions: int) -> Array:
        """Return the derivative along a set of directions."""
        return self.parts.get(directions, np.zeros(()))

    def along(self, direction: int) -> Jet:
        """Return the derivative along one direction (a mask of one bit), as a function along the others."""
        return Jet({key ^ direction: part for key, part in self.parts.items() if key & direction})

    def through(self, derivatives: Sequence[Array | float]) -> Jet:
        """Return a function of it, given the value and derivatives at `value`, as many as there are directions."""
        step = Jet({key: part for key, part in self.parts.items() if key})
        total, power = Jet({0: np.asarray(derivatives[0])}), Jet({0: np.ones(())})
        for order, derivative in enumerate(derivatives[1:], 1):
            power = power * step
            total = total + power * (derivative / factorial(order))
        return total

    def power(self, exponent: float, highest: int = 4) -> Jet:
        """Return it to a power; its value is positive."""
        factors = np.cumprod([1.0, *(exponent - k for k in range(highest))])
        return self.through([f * self.value ** (exponent - k) for k, f in enumerate(factors)])


def _parts(x: Number) -> Mapping[int, Array]:
    return x.parts if isinstance(x, Jet) else {0: np.asarray(x)}
