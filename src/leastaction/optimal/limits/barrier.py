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

from typing import NamedTuple, Protocol

import numpy as np

from leastaction import _core
from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty


class Split(NamedTuple):
    """Limits' values as ``c = slack - excess``, at the minimum over both; both positive.

    ``value``: the sum of psi there, up to a constant of mu and rho; NaN where it was not asked for.
    """

    slack: Array
    excess: Array
    value: float = np.nan


class Halves(Protocol):
    """Slack, excess and barriers of limits, whatever else is known of them: as of `Split`."""

    @property
    def slack(self) -> Array:
        """Their slack (n,)."""

    @property
    def excess(self) -> Array:
        """Their excess (n,)."""

    @property
    def value(self) -> float:
        """The sum of their barriers."""


def split(c: Array, mu: float, rho: Array) -> Split:
    """Return slack and excess of the values of limits.

    Parameters
    ----------
    c : ndarray (n,)
        Values of limits.
    mu : float
        The barrier's parameter, in units of the cost.
    rho : ndarray (n,)
        Price of an excess, in units of the cost by those of the limit.
    """
    slack, excess = empty(c.shape), empty(c.shape)
    return Split(slack, excess, _core.barrier_split(c, mu, rho, slack, excess))


def stiffness(part: Halves, rho: Array, y: Array) -> Array:
    """Return ``-dy/dc`` of the primal-dual model at the duals y."""
    out: Array = empty(y.shape)
    _core.barrier_stiffness(part.slack, part.excess, rho, y, out)
    return out


def off_center(part: Halves, rho: Array, y: Array) -> float:
    """Return the largest product of a dual with its slack, or of what its price has left with its excess."""
    return _core.barrier_off_center(part.slack, part.excess, rho, y)


def barrier_step(
    c: Array, part: Halves, mu: float, rho: Array, y: Array, dc: Array, *, fall: float, least: float, length: float
) -> float:
    """Return where along a direction the model is least that has the barriers themselves in place of their models.

    To a tenth. ``dc``: change of the values along it. ``fall``, ``least``: slope of cost and barriers, and their
    model's change at its end. ``length``: where to look no further.
    """
    return _core.barrier_step(c, part.slack, part.excess, mu, rho, y, dc, fall, least, length)


def barrier_along(part: Halves, mu: float, rho: Array, y: Array, dc: Array) -> tuple[float, float]:
    """Return by how much the barriers fall along a direction, to first order, and the stiffness along it."""
    return _core.barrier_along(part.slack, part.excess, mu, rho, y, dc)


class Point(NamedTuple):
    """Where limits are: their values, how these are split, and their duals."""

    c: Array
    part: Halves
    y: Array


def advanced(at: Point, mu: float, rho: Array, dc: Array, *, fall: float, bend: float) -> tuple[Point, float]:
    """Return where a model is least along dc, at most at its end, with duals moved along, and how far that is.

    The model is that of barriers and of something else, with the derivatives ``fall`` and ``bend`` along it.
    """
    shape = dc.shape
    c, slack, excess, y = empty(shape), empty(shape), empty(shape), empty(shape)
    length, value = _core.barrier_advance(
        at.c, at.part.slack, at.part.excess, mu, rho, at.y, dc, fall, bend, c, slack, excess, y
    )
    return Point(c, Split(slack, excess, value), y), length


def first_duals(barrier: Array, rho: Array) -> Array:
    """Return duals to begin with, given those of the barrier.

    Of a limit that is not met the barrier is all but linear. With a small dual its model has its minimum where the
    limit is just met.
    """
    out: Array = empty(barrier.shape)
    _core.barrier_first_duals(barrier, rho, out)
    return out


def moved_duals(part: Halves, mu: float, rho: Array, y: Array, dc: Array, after: Halves) -> Array:
    """Return duals y after a step of theirs along dc that stays inside of (0, rho), and not too far from the barrier's.

    ``after``: slack and excess where it leads to.
    """
    out: Array = empty(y.shape)
    _core.barrier_move_duals(part.slack, part.excess, mu, rho, y, dc, after.slack, out)
    return out
