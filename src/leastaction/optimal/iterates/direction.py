"""Descent directions in discrete time, and the trajectories that steps along them lead to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.iterates.gap_filter import OpenCurve
from leastaction.optimal.loop import Direction
from leastaction.optimal.space import StateSpace, moved_by


class Iterate(NamedTuple):
    """States (N+1, nx) and inputs (N, nu) of a trajectory, or of a curve, and the coarsest step.

    ``cost``: without what only guides the search; NaN where it is not known. ``room``: what limits leave along it, if
    there are some and it is known. ``curve``: with gaps; None of a trajectory.
    """

    x: Array
    u: Array
    worst_step: StepQuality | None = None
    cost: float = np.nan
    room: Any = None
    curve: OpenCurve | None = None


class ModelMinimum(NamedTuple):
    """The minimum of a linear-quadratic problem: its value, the motion to it, and its law."""

    least: float
    dx: Array
    du: Array
    K: Array
    C: Array


class AmongCurves(NamedTuple):
    """What a direction among curves with gaps says besides.

    ``costates`` (N+1, nx): multipliers of the dynamics at the model's minimum. ``fall``: derivative of the cost alone.
    ``least``: the model's change of it at its minimum. ``P`` (N+1, nx, nx), ``factors`` (N, nu, nu): of its recursion.
    """

    costates: Array
    fall: float
    least: float
    P: Array
    factors: Array


@dataclass(frozen=True)
class DiscreteDirection(Direction):
    """A descent direction, and the projection along which it is followed.

    With the gains of the direction's own linear-quadratic problem as the projection's gains, ``ubar - K (x - xbar)`` of
    ``(xbar, ubar) = xi + s dxi`` is ``u - s C - K (x - x_now)``: the direction dxi itself is never needed, only its
    feedforward C. With other gains it is, and `dx`, `du` are given.

    ``gain`` (N, nu, ndx): gains of the projection. ``C`` (N, nu): feedforward of the model's solution. ``dx``, ``du``:
    the direction, if the projection has gains of its own. ``dx0`` (ndx,): that of the initial state, if it is free.
    ``limited`` (n,): change of the values of all limits along it, if there are some. ``duals`` (n,): theirs at its end,
    if these are known. ``promise``, ``reach``: by how much a step of a length lowers cost and barriers where these are
    themselves in the model; NaN where that is not known. ``among``: of a direction among curves with gaps.
    """

    gain: Array = field(kw_only=True)
    C: Array = field(kw_only=True)
    dx: Array | None = None
    du: Array | None = None
    dx0: Array | None = None
    limited: Array | None = None
    duals: Array | None = None
    promise: float = np.nan
    reach: float = np.nan
    among: AmongCurves | None = None

    @property
    def K(self) -> Array:
        """The gains, as those of a linear law."""
        return self.gain

    def curve(self, space: StateSpace | None, x: Array, u: Array, length: float) -> tuple[Array, Array]:
        """Return the curve whose projection is the iterate at this step length."""
        if self.dx is None or self.du is None:
            moved = np.multiply(self.C, length, out=empty(u.shape))
            return x, np.subtract(u, moved, out=moved)
        return moved_by(space, x, length * self.dx), u + length * self.du
