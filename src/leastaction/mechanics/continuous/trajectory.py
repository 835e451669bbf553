"""Trajectories of a mechanism in continuous time, with everything in them found by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.continuous.events import EventRecord
from leastaction.mechanics.continuous.integration import SolverCounts
from leastaction.mechanics.continuous.monitoring import EnergyBalance
from leastaction.mechanics.continuous.stabilisation import Drift
from leastaction.mechanics.mechanism.arguments import of_unit_length
from leastaction.mechanics.mechanism.queries.masses import Energy
from leastaction.mechanics.mechanism.queries.units import multiplier_units, state_units
from leastaction.mechanics.mechanism.reactions import reactions
from leastaction.mechanics.mechanism.trajectory import BaseState, BaseTrajectory
from leastaction.numerics.arrays import Array, as_array, shape_of
from leastaction.numerics.public import public


class IntegrationStatus(Enum):
    """How a simulation in continuous time ended; the value says what happened and what to try."""

    COMPLETED = "completed: integrated over all times"
    UNBALANCED = (
        "integrated over all times, but energy was lost or gained beside the work that was done: do not trust the "
        "motion from there on. Try smaller tolerances, max_step=, or a start that stays away from where constraints "
        "lose rank"
    )
    EVENT = "an event ended it: the last instant is that of the event"
    FAILED = (
        "failed: the trajectory ends at the last accepted step. Try an implicit method, looser tolerances, a "
        "start away from singular configurations, or inputs and prescribed motion that stay bounded"
    )
    INTERRUPTED = "interrupted: the trajectory ends where it was stopped; simulate on from there"


@public
@dataclass(frozen=True)
class ContinuousState(BaseState):
    """State of a mechanism in continuous time.

    Attributes
    ----------
    t, q
        As of `BaseState`.
    v : ndarray, shape (nv,)
        Velocity (m/s or rad/s).
    """

    v: Array

    @property
    def x(self) -> Array:
        """The state vector ``[q; rho; v; v_rho]``, shape (nx,)."""
        return np.concatenate([self.q, self.v])


@public
@dataclass(frozen=True)
class ContinuousTrajectory(BaseTrajectory[ContinuousState]):
    """A motion in continuous time, at ``N + 1`` instants and, by dense output, between them.

    Attributes
    ----------
    mechanism
        As of `BaseTrajectory`.
    t : ndarray, shape (N+1,)
        Times (s): those that were asked for, up to the end. Where an event, a failure or Ctrl-C ended the
        simulation between two of them, that time is the last.
    q, v, a : ndarray, shape (N+1, nq), (N+1, nv), (N+1, nv)
        Configurations, velocities, accelerations (m or rad, per second, per second squared).
    inputs : ndarray, shape (N+1, n_inputs)
        Force inputs; where they jump, those after the jump.
    lam : ndarray, shape (N+1, nc)
        Multipliers: the force of the constraints is ``Dh(q)^T lam``.
    status : IntegrationStatus
    message : str
        What happened, in a sentence.
    drift : mapping of str to Drift
        How far it was from each constraint.
    events : mapping of str to EventRecord
        When each event took place.
    effort : SolverCounts
        What it took.
    balance : EnergyBalance or None
        Energy against the work that was done; None without dense output.
    warnings : tuple of str
        What was warned of: an energy that does not balance, joints near the singularity of their angles.
    """

    v: Array = field(repr=False)
    a: Array = field(repr=False)
    status: IntegrationStatus = IntegrationStatus.COMPLETED
    message: str = "completed"
    drift: Mapping[str, Drift] = field(default_factory=dict, repr=False)
    events: Mapping[str, EventRecord] = field(default_factory=dict, repr=False)
    effort: SolverCounts = field(default=SolverCounts(0, 0, 0), repr=False)
    balance: EnergyBalance | None = None
    warnings: tuple[str, ...] = ()
    dense: Callable[[float], Array] | None = field(default=None, repr=False, metadata={"recorded": False})
    law: Callable[[float, Array], Array] | None = field(default=None, repr=False, metadata={"recorded": False})

    @property
    def rho_a(self) -> Array:
        """Accelerations of the kinematic variables, shape (N+1, nrho)."""
        return self.a[:, self.mechanism.nd :]

    @property
    def x(self) -> Array:
        """States ``[q; rho; v; v_rho]``, shape (N+1, nx)."""
        return np.hstack([self.q, self.v])

    @property
    def state_units(self) -> tuple[str, ...]:
        return state_units(self.mechanism, momenta=False)

    @property
    def multiplier_units(self) -> tuple[str, ...]:
        return multiplier_units(self.mechanism, impulses=False)

    @property
    def u(self) -> Array:
        """Inputs of the continuous system ``[inputs; rho_a]``, shape (N+1, n_inputs + nrho)."""
        return np.hstack([self.inputs, self.rho_a])

    def state(self, k: int) -> ContinuousState:
        return ContinuousState(float(self.t[k]), self.q[k], self.v[k])

    def __call__(self, t: ArrayLike) -> Array:
        """Return the state at any time between the first and the last instant, by dense output.

        ``t``: times (s). Returns (nx,) or (n, nx): ``[q; rho; v; v_rho]``; prescribed variables are exact, and
        constraints that were projected on hold. Raises `ArgumentError` for a time outside, or a trajectory without
        dense output.
        """
        if self.dense is None:
            raise ArgumentError("the trajectory has no dense output; simulate with dense_output=True")
        single, times = self._times(t)
        rows = np.array([self.dense(float(at)) for at in times]).reshape(len(times), self.q.shape[1] + self.v.shape[1])
        # Polynomials through the instants of an optimised motion leave the lengths of quaternions by their error.
        rows[:, : self.mechanism.nq] = of_unit_length(self.mechanism, rows[:, : self.mechanism.nq])
        return rows[0] if single else rows

    def input(self, t: ArrayLike) -> Array:
        """Return the input ``[inputs; rho_a]`` at any time: (n_inputs + nrho,), or (n, n_inputs + nrho) for times (n,).

        From the law that was simulated with; on straight lines between the instants where there is none.
        """
        single, times = self._times(t)
        if self.law is not None and self.dense is not None:
            rows = np.array([self.law(float(at), self.dense(float(at))) for at in times])
        else:
            columns = [np.interp(times, self.t, column) for column in self.u.T]
            rows = np.array(columns).T
        rows = rows.reshape(len(times), self.u.shape[1])
        return rows[0] if single else rows

    def velocity(self, name: str) -> Array:
        """Return the velocity (N+1,) of a variable by name (m/s or rad/s).

        Or of a frame, (N+1, 6): of its origin (m/s), and angular (rad/s), in world axes.
        """
        return self._velocity(name, self.q, self.v)

    def acceleration(self, name: str) -> Array:
        """Return the acceleration (N+1,) of a variable by name (m/s^2 or rad/s^2)."""
        return self.a[:, self._variable(name)]

    def reactions(self) -> dict[str, Array]:
        """Return the wrench in every joint at every instant, (N+1, 6) by the frame that it moves.

        The force (N), then the torque (N m) about the origin of that frame, in world axes, with which what is before
        the joint acts on what is behind it. Drives, springs and friction of the joint itself are part of it.
        """
        return reactions(self.mechanism, self.q, self.v, self.a, self.inputs, self.lam, self.t)

    def energy(self) -> Energy:
        """Return the energy at every instant, arrays (N+1,) (J)."""
        return self.mechanism.energy(self.q, self.v, self.t)

    def __str__(self) -> str:
        """Return what happened in a few lines: times, effort, events, and the drift of the constraints."""
        e = self.effort
        lines = [
            f"t = {self.t[0]:g} to {self.t[-1]:g} s: {self.message}",
            f"{e.steps} steps, {e.evaluations} evaluations, {e.jacobians} Jacobians",
        ]
        lines += [f"event {name!r}: {len(record.t)} times" for name, record in self.events.items()]
        worst = sorted(self.drift.items(), key=lambda item: -item[1].h)
        lines += [f"drift of {name!r}: {d.h:.2g}, of its rate {d.rate:.2g}" for name, d in worst[:3]]
        if self.balance is not None:
            lines.append(str(self.balance))
        return "\n".join([*lines, *self.warnings])

    def _times(self, t: ArrayLike) -> tuple[bool, Array]:
        single = not shape_of(t)
        times = as_array([t] if single else t, "t", (None,))
        outside = (times < self.t[0]) | (times > self.t[-1])
        if np.any(outside):
            raise ArgumentError(
                f"t: got {times[outside][0]:g} s, expected times from {self.t[0]:g} to {self.t[-1]:g} s, which the "
                "trajectory covers"
            )
        return single, times


class DenseOutput:
    """States between the instants, from the interpolants of the steps.

    ``pieces``: interpolants of the steps, with ``start`` and ``end``, in the order of time. ``hold``: what brings an
    interpolated state onto prescribed motions and constraints: ``(t, x) -> x``. ``start`` (nx,): the state before the
    first step.
    """

    def __init__(self, pieces: Sequence[Any], hold: Callable[[float, Array], Array], start: Array) -> None:
        self._pieces = tuple(pieces)
        self._starts = np.array([piece.start for piece in pieces])
        self._hold = hold
        self._start = start

    def __call__(self, t: float) -> Array:
        """Return the state (nx,) at a time."""
        if not self._pieces or t <= self._starts[0]:
            return self._start.copy()
        # At the end of a step that step's own interpolant holds: it ends in the step's state.
        k = max(int(np.searchsorted(self._starts, t, side="left")) - 1, 0)
        return self._hold(t, self._pieces[k](t))
