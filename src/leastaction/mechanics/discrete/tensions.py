"""What strings pull with along a run: those that constraints hold, and those that stretch."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.mechanics.elements.base import Element, Potential
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.trajectory import BaseTrajectory
from leastaction.mechanics.mechanism.turns import middles
from leastaction.numerics.arrays import Array


def tensions(run: BaseTrajectory[Any]) -> dict[str, Array]:
    """Return the tension of every string over each step, (N,) by name (N), positive where it pulls.

    Of a `PathLength` ``lam / dt``, whose multiplier is an impulse, and of a `Distance` ``2 L lam / dt`` with the length
    at the step's start, for the constraint ``h = |p1 - p2|^2 - L^2``; of an `ExpressionConstraint` in distances ``dh/ds
    lam / dt`` if h has the same slope by all of them; of an `ElasticString`, and of an `ExpressionPotential` likewise,
    the slope of its energy at the middle of the step.

    An impulse at an instant makes up for the halves of the two steps that meet there. At a start that was given by a
    velocity there is no step before, so the first impulse, and with it the first tension, is half of what follows.
    """
    m, dt = run.mechanism, np.diff(run.t)
    start = dict(zip(m.coordinates, run.q[:-1].T, strict=True))
    impulse = dict(zip(m.constraints, run.lam.T, strict=True))
    first, middle = (run.t[:-1], run.q[:-1]), (0.5 * (run.t[1:] + run.t[:-1]), middles(m, run.q))
    found: dict[str, Array | None] = {}
    for name, element in m.elements.items():
        if name in impulse:
            found[name] = element.tension(impulse[name], dt, start)
            if found[name] is None and (slope := _slope(m, name, element, *first)) is not None:
                found[name] = slope * impulse[name] / dt
        elif isinstance(element, Potential):
            elastic = element.seen_as == "string"
            found[name] = _pull(m, element, middle[1]) if elastic else _slope(m, name, element, *middle)
    return {name: tension for name, tension in found.items() if tension is not None}


def _pull(m: Mechanism, element: Element, q: Array) -> Array | None:
    """Return what an elastic string pulls with in configurations (N, nq)."""
    if len(element.looks) != 1:
        return None
    places = m.positions(q, element.looks[0].frames)
    length = np.linalg.norm(np.diff(places, axis=-2), axis=-1).sum(axis=-1)
    return element.pull(length, np.zeros_like(length), dict(zip(m.coordinates, q.T, strict=True)))


def _slope(m: Mechanism, name: str, element: Element, t: Array, q: Array) -> Array | None:
    """Return the slope of a cord's function at times (N,) in configurations (N, nq); None of what is no cord."""
    frames = element.uses.frames
    if not frames:
        return None
    places = dict(zip(frames, np.moveaxis(m.positions(q, frames), -2, 0), strict=True))
    start = len(name) + 1
    numbers = {key[start:]: value for key, value in m.parameters.items() if key.startswith(f"{name}.")}
    return element.slope(_Pieces(places), {**numbers, **dict(zip(m.coordinates, q.T, strict=True)), "": t})


class _Pieces(dict[tuple[str, str], Array]):
    """Distances of pairs of frames, made when they are asked for."""

    def __init__(self, places: dict[str, Array]) -> None:
        super().__init__()
        self._places = places

    def __missing__(self, pair: tuple[str, str]) -> Array:
        first, second = (self._places[frame] for frame in pair)
        return np.asarray(np.linalg.norm(first - second, axis=-1))
