"""States and trajectories of a mechanism in discrete time, with everything in them found by name."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import restore_state, saved_state

if TYPE_CHECKING:
    from leastaction.mechanics.mechanism.mechanism import Mechanism


_LOOKS = 7  # instants at which a run is asked for equations that are redundant


class SimulationStatus(Enum):
    """How a simulation ended; the value says what happened and what to try."""

    COMPLETED = "completed: every step was solved"
    STEP_FAILED = (
        "a step could not be solved: the trajectory ends before it. Try a smaller time step, smoother "
        "prescribed motion, or inputs that the mechanism can follow"
    )
    INTERRUPTED = (
        "interrupted: the trajectory ends where it was stopped; simulate on from its last state"
    )


@dataclass(frozen=True)
class State:
    """State of a mechanism in discrete time.

    Attributes
    ----------
    t : float
        Time (s).
    q : ndarray, shape (nq,)
        Configuration, dynamic variables first (m or rad).
    p : ndarray, shape (nd,)
        Discrete momentum of the dynamic variables (kg m/s or kg m^2/s).
    v_rho : ndarray, shape (nrho,)
        Velocity of the kinematic variables over the last step (m/s or rad/s).
    """

    t: float
    q: Array
    p: Array
    v_rho: Array

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        for name in ("q", "p", "v_rho"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name))))

    @property
    def x(self) -> Array:
        """The state vector ``[q; rho; p; v_rho]``, shape (nx,)."""
        return np.concatenate([self.q, self.p, self.v_rho])


def state_of(mechanism: Mechanism, t: float, x: Array) -> State:
    """Return a state vector (nx,) at time t as a `State`, with memory of its own."""
    m = mechanism
    q, p, v_rho = np.split(x.copy(), [m.nq, m.nq + m.nd])
    return State(t, q, p, v_rho)


def check_state(state: object) -> None:
    """Raise unless this is a `State`."""
    if not isinstance(state, State):
        raise ArgumentError(
            f"state: got {type(state).__name__}, expected a State, such as the result of start()"
        )


@dataclass(frozen=True)
class Trajectory:
    """A motion that the mechanism can make, in discrete time: ``N`` steps between ``N + 1`` instants.

    Attributes
    ----------
    mechanism : Mechanism
    t : ndarray, shape (N+1,)
        Times (s).
    q : ndarray, shape (N+1, nq)
        Configurations (m or rad).
    p : ndarray, shape (N+1, nd)
        Discrete momenta of the dynamic variables.
    v_rho : ndarray, shape (N+1, nrho)
        Velocities of the kinematic variables over the step that ends at each instant.
    inputs : ndarray, shape (N, nu)
        Force inputs, held over each step.
    lam : ndarray, shape (N, nc)
        Multipliers of each step: impulses ``Dh(q_k)^T lam_k`` act at its start.
    status : SimulationStatus
    message : str
        What happened, in a sentence.
    rank_deficient : bool
        Whether constraints were redundant somewhere, so that the least multiplier was taken; see
        `redundant`.
    """

    mechanism: Mechanism = field(repr=False)
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    p: Array = field(repr=False)
    v_rho: Array = field(repr=False)
    inputs: Array = field(repr=False)
    lam: Array = field(repr=False)
    status: SimulationStatus = SimulationStatus.COMPLETED
    message: str = "completed"
    rank_deficient: bool = False

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        for name in ("t", "q", "p", "v_rho", "inputs", "lam"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name))))

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return len(self.t) - 1

    @property
    def rho(self) -> Array:
        """Kinematic variables, shape (N+1, nrho)."""
        return self.q[:, self.mechanism.nd :]

    @property
    def x(self) -> Array:
        """States ``[q; rho; p; v_rho]``, shape (N+1, nx)."""
        return np.hstack([self.q, self.p, self.v_rho])

    @property
    def u(self) -> Array:
        """Inputs of the discrete system ``[inputs; rho_next]``, shape (N, nu + nrho)."""
        return np.hstack([self.inputs, self.rho[1:]])

    @property
    def v(self) -> Array:
        """Velocities over the steps, ``(q_{k+1} - q_k) / dt``, shape (N, nq) (m/s or rad/s)."""
        return np.diff(self.q, axis=0) / np.diff(self.t)[:, None]

    @property
    def redundant(self) -> dict[str, tuple[str, ...]]:
        """The constraint equations that were redundant all along, and those that each follows from.

        As `Mechanism.redundancy` finds them at most of a few instants. Empty where no equation was redundant,
        or where equations became so for an instant only, in a singular configuration; `rank_deficient` tells
        these two apart. The motion is unique in any case, the multipliers are not: those of least norm were
        taken.
        """
        if not self.rank_deficient:
            return {}
        instants = np.unique(np.linspace(0, self.steps, _LOOKS).astype(int))
        found = [self.mechanism.redundancy(self.q[k]) for k in instants]
        result: dict[str, tuple[str, ...]] = {}
        for name in self.mechanism.constraints:
            sources = [look[name] for look in found if name in look]
            if 2 * len(sources) > len(found):
                result[name] = max(sources, key=len)
        return result

    def __str__(self) -> str:
        """Return what happened in a few lines: steps, times, and equations that were redundant."""
        lines = [f"{self.steps} steps, t = {self.t[0]:g} to {self.t[-1]:g} s: {self.message}"]
        if self.rank_deficient:
            redundant = self.redundant
            for name, sources in redundant.items():
                origin = f"follows from {', '.join(sources)}" if sources else "has no gradient"
                lines.append(f"redundant: {name} {origin}")
            if not redundant:
                lines.append("redundant: equations in a singular configuration, for an instant")
            lines.append("multipliers are those of least norm")
        return "\n".join(lines)

    @property
    def last(self) -> State:
        """The last state, to go on from."""
        return self.state(self.steps)

    def state(self, k: int) -> State:
        """Return the state at instant k."""
        return State(float(self.t[k]), self.q[k], self.p[k], self.v_rho[k])

    def __getitem__(self, name: str) -> Array:
        """Return a variable (N+1,), an input (N,) or a multiplier (N,) by name."""
        m = self.mechanism
        for names, values in (
            (m.variables, self.q),
            (m.inputs, self.inputs),
            (m.constraints, self.lam),
        ):
            if name in names:
                return values[:, names.index(name)]
        known = m.variables + m.inputs + m.constraints
        raise ArgumentError(
            f"unknown name {name!r}; {closest(name, known, what='variables, inputs and constraints')}"
        )

    def energy(self) -> Any:
        """Return the `Energy` at the midpoint of every step, arrays (N,) (J)."""
        return self.mechanism.energy(0.5 * (self.q[1:] + self.q[:-1]), self.v)

    def tensions(self) -> dict[str, Array]:
        """Return the tension of every string (`Distance` and `PathLength` constraints) over each step.

        Returns
        -------
        dict of str to ndarray, shape (N,)
            Newtons, positive where the string pulls: ``lam / dt`` of a path, whose multiplier is an
            impulse, and ``2 L lam / dt`` with the length at the step's start of a distance, for the
            constraint ``h = |p1 - p2|^2 - L^2``.

        Notes
        -----
        An impulse at an instant makes up for the halves of the two steps that meet there. At a start that
        was given by a velocity there is no step before, so the first impulse, and with it the first
        tension, is half of what follows.
        """
        m, dt = self.mechanism, np.diff(self.t)
        start = dict(zip(m.variables, self.q[:-1].T, strict=True))
        impulse = dict(zip(m.constraints, self.lam.T, strict=True))
        tensions = {
            name: element.tension(impulse[name], dt, start)
            for name, element in m.elements.items()
            if name in impulse
        }
        return {name: tension for name, tension in tensions.items() if tension is not None}
