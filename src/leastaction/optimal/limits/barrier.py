"""The elastic barrier of a limit ``c >= 0``, in closed form.

Written with a slack s and an excess t, ``c = s - t``, a limit costs ::

    psi(c) = min over s, t > 0 with s - t = c of  rho t - mu log(t) - mu log(s)

which is smooth and finite for every c. As mu goes to 0 it becomes ``rho max(0, -c)``, the exact penalty: a limit that
can be met is met, to within mu, once the price rho is larger than its dual. So any trajectory is a start, a line
search needs nothing but this value, and where limits contradict each other, what remains of t says which and where.

At the minimum ``mu/s + mu/t = rho``. The dual is ``y = mu/s = -psi'(c)``, between 0 and rho. A primal-dual method
carries duals of its own: eliminating s, t and their changes from Newton's equations of ``s y = mu``,
``t (rho - y) = mu`` and ``c = s - t`` leaves ``dy = (mu/s - y) - sigma dc`` with the stiffness
``sigma = 1 / (s/y + t/(rho - y))``. The linear part of the model is thus the gradient of psi itself, whatever the
duals: its minimum is a direction of descent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from leastaction.numerics.arrays import Array

__all__ = ["Split", "barrier_value", "first_duals", "moved_duals", "slope", "split", "stiffness"]

_INSIDE = 0.995  # of the way to their bounds duals go at most
_NEAR = 1e3  # by this factor duals may be off those of the barrier
_BELOW = 1.0 - 1e-9  # times the price is the largest dual: the price less the dual is to have some digits
_GUESS = 0.1  # of its price is the first dual of a limit that is not met


class Split(NamedTuple):
    """A limit's value as ``c = slack - excess``, at the minimum over both; both positive."""

    slack: Array
    excess: Array


def split(c: Array, mu: float, rho: Array) -> Split:
    """Return slack and excess of the values of limits.

    Parameters
    ----------
    c : ndarray (n, m)
        Values of m limits.
    mu : float
        The barrier's parameter, in units of the cost.
    rho : ndarray (m,)
        Price of an excess, in units of the cost by those of the limit.
    """
    scaled = rho * c
    size = np.abs(scaled)
    root = np.hypot(scaled, 2.0 * mu)
    # root - size, without cancellation.
    small = 2.0 * mu * (1.0 + 2.0 * mu / (root + size))
    large = 2.0 * mu + root + size
    inside = c > 0.0
    factor = 0.5 / rho
    return Split(factor * np.where(inside, large, small), factor * np.where(inside, small, large))


def slope(c: Array, mu: float, rho: Array) -> Array:
    """Return ``-psi'(c)``, the duals of the barrier itself: ``mu / slack``, without the split."""
    scaled = rho * c
    part = (2.0 * mu) * rho / (np.hypot(scaled, 2.0 * mu) + np.abs(scaled) + 2.0 * mu)
    return np.where(c > 0.0, part, rho - part)


def barrier_value(part: Split, mu: float, rho: Array) -> float:
    """Return the sum of psi, up to a constant of mu and rho."""
    scale = rho / mu
    dear = scale * part.excess
    # The product of the two is within the numbers' range: where one is large the other is about 1.
    return float(np.sum(mu * (dear - np.log(dear * (scale * part.slack)))))


def stiffness(part: Split, rho: Array, y: Array) -> Array:
    """Return ``-dy/dc`` of the primal-dual model at the duals y."""
    return np.asarray(1.0 / (part.slack / y + part.excess / (rho - y)))


def first_duals(barrier: Array, rho: Array) -> Array:
    """Return duals to begin with, given those of the barrier.

    Of a limit that is not met the barrier is all but linear. With a small dual its model has its minimum where the
    limit is just met.
    """
    return np.where(barrier > 0.5 * rho, _GUESS * rho, barrier)


def moved_duals(y: Array, dy: Array, barrier: Array, rho: Array) -> Array:
    """Return duals after a step of theirs that stays inside of (0, rho), and not too far from the barrier's."""
    y = np.clip(y + dy, (1.0 - _INSIDE) * y, rho - (1.0 - _INSIDE) * (rho - y))
    high = np.minimum(_NEAR * barrier, rho - (rho - barrier) / _NEAR)
    return np.asarray(np.clip(y, barrier / _NEAR, np.minimum(high, _BELOW * rho)))
