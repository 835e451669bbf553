"""Elastic strings that pull and do not push: how far they are stretched, and what that does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

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


class Strings(NamedTuple):
    """The m strings of a mechanism that only pull, along configurations.

    ``names``: of them. ``slopes`` (N+1, m, nq): derivatives of their stretches by the configuration. ``room`` (N+1, m):
    by how much the stretch of each may shrink until it pulls no more (m), were it a spring; zero where it is slack.
    ``reeled`` (m,): whether its length is a prescribed variable.
    """

    names: tuple[str, ...]
    slopes: Array
    room: Array
    reeled: Array

    @classmethod
    def along(cls, m: Mechanism, q: Array) -> Strings:
        """Return those of a mechanism along configurations (N+1, nq)."""
        found, numbers = _pulling(m), m.parameters
        if not found:
            return cls((), np.empty((len(q), 0, m.nq)), np.empty((len(q), 0)), np.empty(0, dtype=np.bool_))
        # The stretch is the constraint that an inextensible string would be.
        rigid = _exchanged(m, {name: PathLength(each.frames, each.length, name=name) for name, each in found.items()})
        rows = [rigid.constraints.index(name) for name in found]
        stretch = rigid.constraint_values(q)[:, rows]
        stiffness, smoothing = (
            np.array([numbers[f"{name}.{what}"] for name in found]) for what in ("stiffness", "smoothing")
        )
        slopes = np.array([rigid.constraint_jacobian(each)[rows] for each in q])
        reeled = np.array([isinstance(each.length, str) for each in found.values()])
        return cls(tuple(found), slopes, tension_of(stretch, stiffness, smoothing) / stiffness, reeled)


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
