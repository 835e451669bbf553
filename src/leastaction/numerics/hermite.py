"""Quintics between points with given slopes and curvatures, and such that rise and fall only as the points do.

On one interval of width h, with slopes d and curvatures a at its ends times h and h^2, the Bernstein coefficients are::

    y0,  y0 + d0/5,  y0 + 2 d0/5 + a0/20,  y1 - 2 d1/5 + a1/20,  y1 - d1/5,  y1

The quintic is monotone where these are (it is a mean of them, and its derivative one of their differences): where the
slopes have the sign of the secant s = y1 - y0 and, for a rising one::

    a0 >= -4 d0,   a1 <= 4 d1,   a0 - a1 <= 20 s - 8 (d0 + d1).
"""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array

_STEEPEST = 1.25  # times the secant: with both slopes so steep the third condition leaves no curvature


def quintics(x: Array, y: Array, slopes: Array, curvatures: Array) -> Array:
    """Return the coefficients (n-1, 6) of the quintics between points (n,), in ascending powers from each point."""
    h = np.diff(x)
    d0, d1 = slopes[:-1] * h, slopes[1:] * h
    a0, a1 = curvatures[:-1] * h**2, curvatures[1:] * h**2
    s = np.diff(y)
    c3 = 10.0 * s - 6.0 * d0 - 4.0 * d1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * s + 8.0 * d0 + 7.0 * d1 + 1.5 * a0 - a1
    c5 = 6.0 * s - 3.0 * d0 - 3.0 * d1 - 0.5 * a0 + 0.5 * a1
    ends = [y[:-1], slopes[:-1], 0.5 * curvatures[:-1]]
    # One by one: a power of a short interval alone would not be a number.
    return np.stack([*ends, c3 / h / h / h, c4 / h / h / h / h, c5 / h / h / h / h / h], axis=1)


def suggested_curvatures(x: Array, y: Array, slopes: Array) -> Array:
    """Return curvatures (n,) at points of given slopes: harmonic means of those of the cubics on both sides, or none.

    Where these bend to the same side; a long interval beside a short one does not swing then.
    """
    h, s = np.diff(x), np.diff(y) / np.diff(x)
    left = (6.0 * s - 4.0 * slopes[:-1] - 2.0 * slopes[1:]) / h  # at the start of each interval
    right = (-6.0 * s + 2.0 * slopes[:-1] + 4.0 * slopes[1:]) / h
    before, after = right[:-1], left[1:]
    same = before * after > 0.0
    mean = 2.0 * before * after / np.where(same, before + after, 1.0)
    return np.concatenate([left[:1], np.where(same, mean, 0.0), right[-1:]])


def monotone(x: Array, y: Array) -> tuple[Array, Array]:
    """Return slopes and curvatures (n,) at points for which the quintics between them are monotone."""
    h, secant = np.diff(x), np.diff(y) / np.diff(x)
    if len(x) == 2:
        return np.repeat(secant, 2), np.zeros(2)
    # Of the parabola through a point and its neighbours; at the ends of that through the last three.
    bend = 2.0 * np.diff(secant) / (h[:-1] + h[1:])
    inner = (h[1:] * secant[:-1] + h[:-1] * secant[1:]) / (h[:-1] + h[1:])
    slopes = np.concatenate([[inner[0] - h[0] * bend[0]], inner, [inner[-1] + h[-1] * bend[-1]]])
    curvatures = np.concatenate([bend[:1], bend, bend[-1:]])
    before, after = np.append(secant[:1], secant), np.append(secant, secant[-1:])
    gentle = _STEEPEST * np.minimum(np.abs(before), np.abs(after))
    turns = before * after <= 0.0
    sign = np.sign(before)
    slopes = np.where(turns, 0.0, sign * np.clip(sign * slopes, 0.0, gentle))
    # In each interval as if it rose; at its start, and at its end.
    way = np.sign(secant)
    d0, d1 = way * slopes[:-1] * h, way * slopes[1:] * h
    for _ in range(2):  # the second round has nothing to do but for rounding
        a0, a1 = way * curvatures[:-1] * h**2, way * curvatures[1:] * h**2
        left = np.where(way == 0.0, 0.0, _share(-a0, 4.0 * d0))
        right = np.where(way == 0.0, 0.0, _share(a1, 4.0 * d1))
        both = _share(np.maximum(a0, 0.0) + np.maximum(-a1, 0.0), 20.0 * np.abs(secant) * h - 8.0 * (d0 + d1))
        left = np.where(a0 > 0.0, np.minimum(left, both), left)
        right = np.where(a1 < 0.0, np.minimum(right, both), right)
        curvatures = curvatures * np.minimum(np.append(left, 1.0), np.insert(right, 0, 1.0))
    return slopes, curvatures


def _share(wanted: Array, allowed: Array) -> Array:
    """Return which parts of what is wanted are allowed."""
    too_much = wanted > allowed
    return np.where(too_much, np.maximum(allowed, 0.0) / np.where(too_much, wanted, 1.0), 1.0)
