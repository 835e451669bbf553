"""Further steps within the model of a direction, whose limits bend where its cost and its dynamics do not.

Along tangent trajectories d the model of cost and dynamics is quadratic, ``m(d)``, and limits change by J d, so that ::

    M(d) = m(d) + sum psi(c + J d)

is a model that holds as far as m does, while the quadratic one of the barriers ends where the first limit is met. A
step along its minimum goes to where M is least along it. From there Newton's method goes on for M: with duals y and
stiffness sigma at the values c + J d, the next minimum D is that of a linear-quadratic problem like the first ::

    g . D + 1/2 D'(H + J' sigma J) D - w . J D,    w = mu/s + sigma J d

with other weights and another gradient, and no new roll-out or derivative of the dynamics. What it is at its minimum
tells ``m(D) = least + w . J D - 1/2 sigma . (J D)^2`` and, along v = D - d, ``Dm(D) . v = w . J v - sigma (JD) . J v``:
with m(d) this is the parabola of m from d to D.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from leastaction import _core
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import changed
from leastaction.numerics.pool import empty
from leastaction.optimal.iterates.direction import DiscreteDirection, ModelMinimum
from leastaction.optimal.limits.duals import Duals, Room
from leastaction.optimal.limits.sides import Sided

_MOST = 8  # further steps
_LONG, _AGREES = (
    0.9,
    0.1,
)  # length of a first step after which there are none, if its gain agrees with the model to this
_ENOUGH, _ENOUGH_FAR = 0.1, 0.3  # gain of the last of them, in parts of all that was gained; and far from the minimum


class SolvedWithin(NamedTuple):
    """The minimum of a linear-quadratic problem, and the changes of limits there."""

    at: ModelMinimum
    change: Array


class Point(NamedTuple):
    """Where limits are, and their duals."""

    room: _core.Room
    y: Array


class _Model:
    """The model M, with limits whose prices, parameter and duals are given; ``room``: that of limits at ``d = 0``."""

    def __init__(self, duals: Duals, room: Room) -> None:
        self.mu, self.layout = duals.mu, duals.layout
        self.begin = Point(room.at, duals.y.flat)

    def gained(self, at: Point, cost: float) -> float:
        """Return by how much M is less at a point than where it begins; ``cost``: the change of m."""
        return self.begin.room.value - cost - at.room.value

    def change(self, at: Point) -> Array:
        """Return how limits have changed since it begins."""
        return at.room.c - self.begin.room.c

    def weights(self, at: Point) -> tuple[Array, Array]:
        """Return w and sigma at a point."""
        sigma: Array = empty(at.y.shape)
        at.room.stiffness(at.y, sigma)
        return self.mu / at.room.slack + sigma * self.change(at), sigma

    def step(self, at: Point, dc: Array, fall: float, bend: float) -> tuple[Point, float, float]:
        """Return the point where M is least along a change of limits, how far it is, and the change of m to there.

        ``fall``, ``bend``: the first two derivatives of m along it. Its duals have moved along.
        """
        y: Array = empty(dc.shape)
        room, length = at.room.advance(at.y, dc, fall, bend, y)
        return Point(room, y), length, length * fall + 0.5 * length**2 * bend


def promising(duals: Duals, room: Room, direction: DiscreteDirection) -> DiscreteDirection:
    """Return a direction with what the model says of a step along it, which ends where the model is least."""
    return _promising(_Model(duals, room), direction)[0]


def _promising(model: _Model, direction: DiscreteDirection) -> tuple[DiscreteDirection, Point, float]:
    assert direction.limited is not None
    begin, dc = model.begin, direction.limited
    fall, stiff = begin.room.along(begin.y, dc)
    point, length, cost = model.step(begin, dc, direction.slope + fall, -direction.slope - stiff)
    return changed(direction, promise=model.gained(point, cost), reach=length), point, cost


def refined(
    duals: Duals,
    room: Room,
    direction: DiscreteDirection,
    sweep: Callable[[DiscreteDirection], tuple[Array, Array]],
    solve: Callable[[DiscreteDirection, Sided, Sided], SolvedWithin | None],
    *,
    far: bool,
) -> DiscreteDirection:
    """Return the direction to where further steps of the model lead, if the first is short or barriers bend along it.

    ``sweep``: returns the motion (dx, du) of a direction. ``solve``: the minimum of the linear-quadratic problem of a
    direction with duals w and stiffness sigma; None where there is none.
    """
    model = _Model(duals, room)
    direction, at, cost = _promising(model, direction)
    gained = direction.promise
    agrees = abs(gained + 0.5 * direction.slope) <= _AGREES * gained
    if (direction.reach > _LONG and agrees) or not gained > 0.0:
        return direction
    enough = _ENOUGH_FAR if far else _ENOUGH
    dx, du = (direction.reach * part for part in sweep(direction))
    found = None
    for _ in range(_MOST):
        w, sigma = model.weights(at)
        following = solve(direction, Sided(w, model.layout), Sided(sigma, model.layout))
        if following is None:
            break
        found, there = following.at, following.change
        change = there - model.change(at)
        with np.errstate(over="ignore", invalid="ignore"):  # a model without bottom leads as far as there are numbers
            slope = float(w @ change) - float(sigma @ (there * change))
            rise = found.least + float(w @ there) - 0.5 * float(sigma @ there**2) - cost
        bend = 2.0 * (slope - rise)
        at, length, more = model.step(at, change, slope - bend, bend)
        cost += more
        dx, du = dx + length * (found.dx - dx), du + length * (found.du - du)
        before, gained = gained, model.gained(at, cost)
        if gained - before <= enough * gained:
            break
    if found is None:
        return direction
    # As of a parabola, of which the step is the minimum.
    return changed(
        direction, slope=-2.0 * gained, gain=found.K, C=found.C, dx=dx, du=du, limited=model.change(at),
        dx0=None if direction.dx0 is None else dx[0], duals=at.y, promise=gained, reach=1.0,
    )  # fmt: skip
