"""Which instants a picture needs: many where things move fast and curved, few where they rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array


def needed(t: Array, tracks: Array, tolerance: Array) -> NDArray[np.intp]:
    """Return the indices of the instants between which straight lines meet all tracks to their tolerances.

    By Ramer, Douglas and Peucker (Comput. Graph. Image Process. 1, 1972): where a line misses a track, the instant at
    which it misses most is kept, and both halves are looked at. First and last are always kept.

    ``t`` (n,): times. ``tracks`` (n, m): values over time; m is 0 where nothing moves. ``tolerance``
    (m,): of each, positive.
    """
    last = len(t) - 1
    keep = np.zeros(len(t), dtype=bool)
    keep[[0, last]] = True
    scaled = tracks / tolerance
    stack = [(0, last)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        share = ((t[a + 1 : b] - t[a]) / (t[b] - t[a]))[:, None]
        off = np.abs(scaled[a] + share * (scaled[b] - scaled[a]) - scaled[a + 1 : b]).max(axis=1, initial=0.0)
        worst = int(off.argmax())
        if off[worst] > 1.0:
            middle = a + 1 + worst
            keep[middle] = True
            stack += [(a, middle), (middle, b)]
    return np.flatnonzero(keep)


def refined(t: Array, misses: Array, tolerance: float, most: int = 16) -> Array:
    """Return times with more of them where straight lines between two instants miss what moves between them.

    ``t`` (n,): times. ``misses`` (n-1,): how far a straight line is off in the middle of each interval (m). ``most``:
    into how many parts an interval is divided at the most. In equal parts of a curve it is off by their square.
    """
    parts = np.clip(np.ceil(np.sqrt(np.maximum(misses, 0.0) / tolerance)), 1, most).astype(int)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(t[:-1], t[1:], parts, strict=True)]
    return np.concatenate([*pieces, t[-1:]])
