"""Elastic strings that pull and do not push: how far they are stretched, and what that does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from leastaction.mechanics.elements.base import Element
from leastaction.mechanics.elements.constraints.distances import PathLength
from leastaction.mechanics.elements.potentials.springs import ElasticString
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array

_LEAST = 1e-3  # of stiffness times smoothing: the tension that stands for one of none, which no stretch has
_ITERATIONS = 50


def tension_of(stretch: Array, stiffness: Array | float, smoothing: Array | float) -> Array:
    """Return how much elastic strings pull (N): the derivative of ``k/2 r^2`` of `ElasticString` by the stretch (m)."""
    share = stretch / smoothing
    return np.asarray(stiffness * smoothing * np.logaddexp(0.0, share) * _rise(share))


def stretch_of(tension: Array, stiffness: float, smoothing: float) -> Array:
    """Return by how much elastic strings are stretched that pull so much (m); negative where they are nearly slack."""
    wanted = np.maximum(np.asarray(tension) / (stiffness * smoothing), _LEAST)
    # What they pull grows ever faster: Newton's method comes down from the right of the solution and stays there.
    share = wanted + 1.0
    for _ in range(_ITERATIONS):
        length, open_ = np.logaddexp(0.0, share), _rise(share)
        share = share - (length * open_ - wanted) / (open_ * (open_ + length * (1.0 - open_)))
    return np.asarray(smoothing * share)


def _rise(share: Array) -> Array:
    """Return ``1 / (1 + exp(-share))``, without overflow."""
    return np.asarray(np.exp(-np.logaddexp(0.0, -share)))


class Strings:
    """The m strings of a mechanism that only pull. Threads may share it.

    Attributes: ``names``, ``stiffness`` (m,) (N/m), and ``nq``, the number of variables.
    """

    def __init__(self, m: Mechanism) -> None:
        found, numbers = _pulling(m), m.parameters
        self.names, self.nq = tuple(found), m.nq
        # A stretch is the constraint that an inextensible string would be.
        self._rigid = _exchanged(
            m, {name: PathLength(each.frames, each.length, name=name) for name, each in found.items()}
        )
        self._rows = [self._rigid.constraints.index(name) for name in found]
        self.stiffness, self._smoothing = (
            np.array([numbers[f"{name}.{what}"] for name in found]) for what in ("stiffness", "smoothing")
        )

    def stretches(self, q: Array) -> Array:
        """Return by how much each is stretched (n, m) in configurations (n, nq); less than zero where it is slack."""
        return np.asarray(self._rigid.constraint_values(q)[:, self._rows])

    def slopes(self, q: Array) -> Array:
        """Return the derivatives (n, m, nq) of that."""
        return np.array([self._rigid.constraint_jacobian(each)[self._rows] for each in q])

    def room(self, stretch: Array) -> Array:
        """Return by how much strings that are stretched so (n, m) may shrink until they pull no more, as springs do.

        Zero where they are slack.
        """
        return np.asarray(tension_of(stretch, self.stiffness, self._smoothing) / self.stiffness)

    def room_along(self, q: Array) -> Array:
        """Return how much farther than to no stretch they may shrink (n, m) before they pull less than nothing does.

        For springs in the place of strings in configurations (n, nq): a string that is slack there may be that slack.
        """
        stretch = self.stretches(np.ascontiguousarray(q))
        return self.room(stretch) - stretch


def as_springs(m: Mechanism) -> Mechanism:
    """Return a mechanism whose strings that only pull would push as well."""
    return _exchanged(m, {name: replace(each, tension_only=False) for name, each in _pulling(m).items()})


def _pulling(m: Mechanism) -> dict[str, ElasticString]:
    """Return the strings of a mechanism that only pull and whose lengths are numbers or prescribed, by name."""
    return {
        name: each
        for name, each in m.elements.items()
        if isinstance(each, ElasticString)
        and each.tension_only
        and (not isinstance(each.length, str) or each.length in m.kinematic)
    }


def _exchanged(m: Mechanism, elements: Mapping[str, Element]) -> Mechanism:
    """Return a mechanism with other elements of the same names, and the numbers that they have in common."""
    made = m.with_exchanged({name: [each] for name, each in elements.items()})
    own, known = tuple(f"{name}." for name in elements), m.parameters
    return made.with_parameters({n: known[n] for n in made.parameters if n.startswith(own) and n in known})
