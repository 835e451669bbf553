"""States and trajectories of a mechanism in discrete time, with everything in them found by name."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from leastaction.mechanics.discrete.balance import DiscreteBalance
from leastaction.mechanics.discrete.prescribed import inputs_along
from leastaction.mechanics.discrete.tensions import tensions
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.masses import Energy
from leastaction.mechanics.mechanism.queries.units import multiplier_units, state_units
from leastaction.mechanics.mechanism.reactions import reactions
from leastaction.mechanics.mechanism.trajectory import BaseState, BaseTrajectory
from leastaction.mechanics.mechanism.turns import differences, middles
from leastaction.numerics.arrays import Array, as_array, require_instance
from leastaction.numerics.frozen import made
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality

_LOOKS = 7  # instants at which a run is asked for equations that are redundant


class SimulationStatus(Enum):
    """How a simulation ended; the value says what happened and what to try."""

    COMPLETED = "completed: every step was solved"
    UNBALANCED = (
        "every step was solved, but energy was lost or gained beside the work that was done: do not trust the motion "
        "from there on. Try a smaller time step, or a start that stays away from where constraints lose rank"
    )
    ROUNDED = (
        "every step was solved, but so far from the origin that rounding eats the motion. Measure variables from "
        "somewhere nearer, or take longer steps"
    )
    STEP_FAILED = (
        "a step could not be solved: the trajectory ends before it. Try a smaller time step, smoother "
        "prescribed motion, or inputs that the mechanism can follow"
    )
    INTERRUPTED = "interrupted: the trajectory ends where it was stopped; simulate on from its last state"


@public
@dataclass(frozen=True)
class State(BaseState):
    """State of a mechanism in discrete time. Nothing in it changes: threads may share it.

    Attributes
    ----------
    t, q
        As of `BaseState`.
    p : ndarray, shape (nd,)
        Discrete momentum of the dynamic variables (kg m/s or kg m^2/s).
    v_rho : ndarray, shape (nrho,)
        Velocity of the kinematic variables over the last step (m/s or rad/s).
    """

    p: Array
    v_rho: Array

    @property
    def x(self) -> Array:
        """The state vector ``[q; rho; p; v_rho]``, shape (nx,)."""
        return np.concatenate([self.q, self.p, self.v_rho])


def state_of(mechanism: Mechanism, t: float, x: Array) -> State:
    """Return a state vector (nx,) at time t as a `State`, with memory of its own."""
    return state_in(mechanism, t, x.copy())


def state_in(mechanism: Mechanism, t: float, x: Array) -> State:
    """Return a state vector (nx,) that nobody else holds as a `State`, in its memory."""
    m = mechanism
    x.setflags(write=False)
    return made(State, t=t, q=x[: m.nq], p=x[m.nq : m.nq + m.nd], v_rho=x[m.nq + m.nd :])


def vector_of(m: Mechanism, state: State) -> Array:
    """Return a `State` as a vector (nx,), checked."""
    q, p, v_rho = state.q, state.p, state.v_rho
    if q.shape == (m.nq,) and p.shape == (m.nd,) and v_rho.shape == (m.nrho,):
        x = np.concatenate((q, p, v_rho))
        if x.dtype == np.float64 and math.isfinite(np.vdot(x, x)):
            return x
    return np.concatenate(
        [
            as_array(state.q, "state.q", (m.nq,), names=m.coordinates),
            as_array(state.p, "state.p", (m.nd,), names=m.dynamic),
            as_array(state.v_rho, "state.v_rho", (m.nrho,), names=m.kinematic),
        ]
    )


def check_state(state: object) -> None:
    """Raise unless this is a `State`."""
    require_instance(state, "state", State, "start() makes one of a configuration")


@public
@dataclass(frozen=True)
class Trajectory(BaseTrajectory[State]):
    """A motion that the mechanism can make, in discrete time: ``N`` steps between ``N + 1`` instants.

    Nothing in it changes, its arrays are read-only: threads may share it.

    Attributes
    ----------
    mechanism, t, q
        As of `BaseTrajectory`.
    inputs : ndarray, shape (N, n_inputs)
        Force inputs, held over each step.
    lam : ndarray, shape (N, nc)
        Multipliers of each step: impulses ``-Dh(q_k)^T lam_k`` act at its start.
    p : ndarray, shape (N+1, nd)
        Discrete momenta of the dynamic variables.
    v_rho : ndarray, shape (N+1, nrho)
        Velocities of the kinematic variables over the step that ends at each instant.
    status : SimulationStatus
    message : str
        What happened, in a sentence.
    rank_deficient : bool
        Whether constraints were redundant somewhere, so that the least multiplier was taken; see `redundant`.
    worst_step : StepQuality or None
        The coarsest step, which may be the one that failed; None if there was none.
    balance : DiscreteBalance or None
        Energy against the work that was done; None where it was not simulated: `MidpointVI.balance` finds it.
    singularities : tuple of str
        What there is to say of joints that came near the singularity of their angles.
    """

    p: Array = field(repr=False)
    v_rho: Array = field(repr=False)
    status: SimulationStatus = SimulationStatus.COMPLETED
    message: str = "completed"
    rank_deficient: bool = False
    worst_step: StepQuality | None = None
    balance: DiscreteBalance | None = None
    singularities: tuple[str, ...] = ()

    @property
    def x(self) -> Array:
        """States ``[q; rho; p; v_rho]``, shape (N+1, nx)."""
        return np.hstack([self.q, self.p, self.v_rho])

    @property
    def state_units(self) -> tuple[str, ...]:
        return state_units(self.mechanism, momenta=True)

    @property
    def multiplier_units(self) -> tuple[str, ...]:
        return multiplier_units(self.mechanism, impulses=True)

    @property
    def u(self) -> Array:
        """Inputs of the discrete system ``[inputs; rho_next]``, shape (N, n_inputs + nrho).

        Of rotations that are prescribed as quaternions the vectors that steps turn by (rad).
        """
        return np.hstack([self.inputs, inputs_along(self.mechanism, self.rho)])

    @property
    def v(self) -> Array:
        """Velocities over the steps, ``(q_{k+1} - q_k) / dt``, shape (N, nv) (m/s or rad/s); angular of quaternions."""
        return differences(self.mechanism, self.q[1:], self.q[:-1]) / np.diff(self.t)[:, None]

    @property
    def redundant(self) -> dict[str, tuple[str, ...]]:
        """The constraint equations that were redundant all along, and those that each follows from.

        As `Mechanism.redundancy` finds them at most of a few instants. Empty where no equation was redundant, or where
        equations became so for an instant only, in a singular configuration; `rank_deficient` tells these two apart.
        The motion is unique in any case, the multipliers are not: those of least norm were taken.
        """
        if not self.rank_deficient:
            return {}
        instants = np.unique(np.linspace(0, self.steps, _LOOKS).astype(int))
        found = [self.mechanism.at_time(self.t[k]).redundancy(self.q[k]) for k in instants]
        result: dict[str, tuple[str, ...]] = {}
        for name in self.mechanism.constraints:
            sources = [look[name] for look in found if name in look]
            if 2 * len(sources) > len(found):
                result[name] = max(sources, key=len)
        return result

    def __str__(self) -> str:
        """Return what happened in a few lines: steps, times, redundant equations, the coarsest step, energy."""
        lines = [f"{self.steps} steps, t = {self.t[0]:g} to {self.t[-1]:g} s: {self.message}"]
        if self.rank_deficient:
            redundant = self.redundant
            for name, sources in redundant.items():
                origin = f"follows from {', '.join(sources)}" if sources else "has no gradient"
                lines.append(f"redundant: {name} {origin}")
            if not redundant:
                lines.append("redundant: equations in a singular configuration, for an instant")
            lines.append("multipliers are those of least norm")
        if self.worst_step is not None:
            lines.append(str(self.worst_step))
        if self.balance is not None:
            lines.append(str(self.balance))
        lines += self.singularities
        return "\n".join(lines)

    def state(self, k: int) -> State:
        return State(float(self.t[k]), self.q[k], self.p[k], self.v_rho[k])

    def velocity(self, name: str) -> Array:
        """Return the velocity (N,) of a variable by name, over each step (m/s or rad/s).

        Or of a frame, (N, 6) at the middle of each step: of its origin (m/s), and angular (rad/s), in world axes.
        """
        return self._velocity(name, middles(self.mechanism, self.q), self.v)

    def energy(self) -> Energy:
        """Return the energy at the midpoint of every step, arrays (N,) (J)."""
        return self.mechanism.energy(middles(self.mechanism, self.q), self.v, 0.5 * (self.t[1:] + self.t[:-1]))

    def reactions(self) -> dict[str, Array]:
        """Return the wrench in every joint at the instants between two steps, ``t[1:-1]``.

        With velocities and accelerations from the differences of the steps beside each, so to the second order in them;
        of what is prescribed too.

        Returns
        -------
        dict of str to ndarray, shape (N-1, 6)
            By the frame that the joint moves: the force (N), then the torque (N m) about the origin of that frame, in
            world axes, with which what is before the joint acts on what is behind it. Drives, springs and friction of
            the joint itself are part of it.
        """
        dt = np.diff(self.t)[:, None]
        held = 0.5 * (dt[1:] + dt[:-1])
        v, u = self.v, 0.5 * (self.inputs[1:] + self.inputs[:-1])
        middle, a = 0.5 * (v[1:] + v[:-1]), (v[1:] - v[:-1]) / held
        return reactions(self.mechanism, self.q[1:-1], middle, a, u, -self.lam[1:] / held, self.t[1:-1])

    def tensions(self) -> dict[str, Array]:
        """Return the tension of every string over each step: `strings.tensions` says what counts as one.

        Returns
        -------
        dict of str to ndarray, shape (N,)
            Newtons, positive where the string pulls.
        """
        return tensions(self)


def trajectory_of(m: Mechanism, t: Array, x: Array, u: Array, lam: Array, **told: Any) -> Trajectory:
    """Return arrays of states (N+1, nx), inputs (N, n_inputs + nrho) and multipliers as a `Trajectory`.

    ``told``: what else a trajectory tells of itself.
    """
    p, v_rho = x[:, m.nq : m.nq + m.nd], x[:, m.nq + m.nd :]
    return Trajectory(m, t, x[:, : m.nq], u[:, : m.n_inputs], lam, p=p, v_rho=v_rho, **told)


@public
@dataclass(frozen=True)
class Step:
    """One solved time step. Nothing in it changes: threads may share it.

    Attributes
    ----------
    state : State
        The state at its end.
    lam : ndarray, shape (nc,)
        Multipliers (impulses).
    iterations : int
        Newton iterations.
    quality : StepQuality or None
        How coarse it was.
    """

    state: State
    lam: Array
    iterations: int
    quality: StepQuality | None = None
