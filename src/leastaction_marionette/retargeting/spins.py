"""Angles without spins: what a joint does near a singularity of its three angles, made bearable.

Where the second of three angles about z, y and x is near 90 degrees, as that of an arm stretched out to the side, the
other two turn about nearly the same axis, and a small motion of the limb may take half a turn of both within a few
frames. No puppet can follow that, and none needs to: a motion through the singularity itself misses the limb by no more
than its distance from it. So where angles turn too fast, those that turn slowly are fitted to the directions of the
bones instead, by least squares over the frames around.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.sparse import block_diag, csc_array, diags_array, kron
from scipy.sparse.linalg import spsolve

from leastaction.numerics import Array

Directions = Callable[[Array], Array]

FASTEST: Final = 15.0
"""Angles that turn faster (rad/s) are fitted anew."""

FURTHEST: Final = 1.3
"""What the second of three angles may be at most (rad): beyond, the other two get too hard to tell apart."""

_SWITCH: Final = np.deg2rad(100.0)  # of the second angle: there the other triple of angles is taken
_SWING: Final = 0.25  # s, in which the first and the third angle go over to it
_AROUND: Final = 0.15  # s, before and after what is too fast
# What a rate, and an acceleration, costs beside the square of an error: 30 rad/s and 400 rad/s^2 as much as 10 degrees.
_RATE, _ACCELERATION = (0.17 / 30.0) ** 2, (0.17 / 400.0) ** 2
_ITERATIONS: Final = 30
_STEP: Final = 1e-6


def without_spins(t: Array, angles: Array, directions: Directions, wanted: Array) -> Array:
    """Return angles (F, n) that nowhere spin; those given where they do not.

    ``t`` (F,): times (s), in equal steps. ``angles`` (F, n): in radians, of which the first three turn about z, y and
    x. ``directions``: from angles (F, n) to directions (F, d, 3) of bones in the frame that the joint is tied to.
    ``wanted`` (F, d, 3): those to be followed.
    """
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    around, last = max(3, round(_AROUND / dt)), len(angles) - 1
    result, done = angles, 0
    while True:
        fast = np.flatnonzero(np.abs(np.diff(result[:, :3], axis=0)).max(axis=1) > FASTEST * dt)
        fast = fast[fast >= done]
        if not fast.size:
            return result
        # One pass after the other: the branch of one decides that of all that follow.
        gaps = np.flatnonzero(np.diff(fast) > 2)
        begin, end = int(fast[0]), int(fast[gaps[0]] if gaps.size else fast[-1]) + 1
        first, final = max(0, begin - around), min(last, end + around)
        fits = [
            _fitted(each, first, final, dt, directions, wanted)
            for each in (result, _through(result, max(0, begin - 1), min(last, end + 1)))
        ]
        result = min(fits, key=lambda fit: fit[0])[1]
        done = end


def beside(t: Array, angles: Array) -> Array:
    """Return angles whose second stays within `FURTHEST`; those given where it does.

    Two triples stand for every rotation, and the second angle of one of them is within 90 degrees. A limb that swings
    through its singularity goes over from one to the other: it waits beside it, at most 20 degrees off, while the first
    and the third angle turn by half a turn about nearly the same axis, which turns the limb hardly at all.

    ``t`` (F,): times (s), in equal steps. ``angles`` (F, n): in radians, continuous, as of `without_spins`.
    """
    second = angles[:, 1]
    if np.abs(second).max(initial=0.0) <= FURTHEST:
        return angles
    # Which triple: by half turns of the second angle, with room for one that lingers about a singularity.
    side = np.empty(len(second))
    now = np.round(second[0] / np.pi)
    for i, value in enumerate(second):
        if abs(value - now * np.pi) > _SWITCH:
            now = np.round(value / np.pi)
        side[i] = now
    dt = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    ramp = np.ones(max(1, round(_SWING / dt))) / max(1, round(_SWING / dt))
    padded = np.concatenate([np.full(len(ramp), side[0]), side, np.full(len(ramp), side[-1])])
    swung = np.convolve(padded, ramp, mode="same")[len(ramp) : -len(ramp)]
    result = angles.copy()
    folded = np.where(side % 2.0 == 0.0, 1.0, -1.0) * (second - side * np.pi)
    result[:, 1] = np.clip(folded, -FURTHEST, FURTHEST)
    # About the axis that they share, the first and the third angle turn against each other, by the sign of the second.
    turns = np.zeros((len(second), 2))
    turns[0] = side[0]
    for i in range(1, len(second)):
        change = swung[i] - swung[i - 1]
        turns[i] = turns[i - 1] + change * np.array([1.0, np.sign(result[i, 1])])
    result[:, 0] += np.pi * turns[:, 0]
    result[:, 2] += np.pi * turns[:, 1]
    result[:, [0, 2]] -= 2.0 * np.pi * np.round(result[:, [0, 2]].mean(axis=0) / (2.0 * np.pi))
    return result


def _through(angles: Array, first: int, last: int) -> Array:
    """Return angles straight across some frames, and from there on those of the other branch."""
    other = angles[last:].copy()
    other[:, 0] += np.pi
    other[:, 1] = np.pi - other[:, 1]
    other[:, 2] += np.pi
    other -= _turns(other[0] - angles[first])
    share = np.linspace(0.0, 1.0, last - first + 1)[:-1, None]
    bridge = (1.0 - share) * angles[first] + share * other[0]
    bridge[:, 3:] = angles[first:last, 3:]
    return np.concatenate([angles[:first], bridge, other])


def _turns(difference: Array) -> Array:
    """Return the whole turns in differences (n,) of angles; a hinge makes none."""
    turns = 2.0 * np.pi * np.round(difference / (2.0 * np.pi))
    turns[3:] = 0.0
    return np.asarray(turns)


def _fitted(
    angles: Array, first: int, last: int, dt: float, directions: Directions, wanted: Array
) -> tuple[float, Array]:
    """Return the price of what is found, and angles with those of some frames fitted by damped Gauss-Newton steps.

    Two on each side are kept: there the fit joins the rest.
    """
    count, n = last - first + 1, angles.shape[1]
    goal = wanted[first : last + 1]
    inside = np.ones(count, dtype=bool)
    if first > 0:
        inside[:2] = False
    if last < len(angles) - 1:
        inside[-2:] = False
    # Before the first frame and after the last there is nothing to be joined to.
    rate = diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 1, count)) / dt
    bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count)) / dt**2
    calm = kron(_RATE * (rate.T @ rate) + _ACCELERATION * (bend.T @ bend), np.eye(n), format="csc")
    free = np.flatnonzero(np.repeat(inside, n))
    theta, damping = angles[first : last + 1].copy(), 1e-3

    def price(at: Array) -> float:
        flat = at.ravel()
        return float(np.sum((directions(at) - goal) ** 2) + flat @ (calm @ flat))

    value = price(theta)
    for _ in range(_ITERATIONS):
        found = directions(theta)
        steps = [directions(theta + _STEP * row) - found for row in np.eye(n)]
        J = np.stack([step.reshape(count, -1) / _STEP for step in steps], axis=2)
        r = (found - goal).reshape(count, -1)
        slope = np.einsum("fij,fi->fj", J, r).ravel() + calm @ theta.ravel()
        hessian = csc_array(block_diag(np.einsum("fij,fik->fjk", J, J), format="csc") + calm)[free][:, free]
        scale = diags_array(hessian.diagonal())
        step = np.zeros(count * n)
        step[free] = spsolve(csc_array(hessian + damping * scale), -slope[free])
        trial = theta + step.reshape(count, n)
        now = price(trial)
        if now < value:
            done = value - now < 1e-9 * value
            theta, value, damping = trial, now, max(1e-9, 0.2 * damping)
            if done:
                break
        else:
            damping *= 10.0
            if damping > 1e8:
                break
    return value, np.concatenate([angles[:first], theta, angles[last + 1 :]])
