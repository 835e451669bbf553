"""Whether a simulation lost energy, or its way, where the constraints lose rank.

Where the gradients of the constraints become dependent (a lift with its links upright, a parallelogram drawn
out straight) the accelerations are not determined, two ways cross, and a solver's error control may step over
the place without noticing. What tells of it: the energy's balance, for between two instants energy changes by
the work of inputs, damping and prescribed motion and by nothing else; and the determinant of
``Dh(q_k) M^-1 Dh(q_k+1)^T``, which changes its sign.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import EnergyBalanceWarning, LeastActionError
from leastaction.mechanics.continuous.equations import Equations
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.ode import Interpolant

# Part of the energy that moves about which may be lost in all before it is told; or this many relative tolerances.
_LOST = 1e-3
_TOLERANCES = 1e3
_NODES = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)  # Gauss: none where inputs jump
_DIFFERENCE = 1e-5  # of states, for the rate of the energy


@dataclass(frozen=True)
class EnergyBalance:
    """Energy against the work that was done.

    Attributes
    ----------
    lost : float
        Energy at the start and work of inputs, damping and prescribed motion, less energy at the end (J).
    scale : float
        Kinetic energy and change of energy at their largest, to compare with (J).
    worst : float
        The largest loss or gain of one step (J).
    t : float
        When that step ended (s).
    crossings : tuple of float
        Ends of the steps that passed a configuration in which constraints lose rank (s).
    rounding : float
        What the balance itself may be off by rounding (J).
    """

    lost: float
    scale: float
    worst: float
    t: float
    crossings: tuple[float, ...] = ()
    rounding: float = 0.0

    def complaint(self, rtol: float) -> str | None:
        """Return what there is to complain about, or None: all is as accurate as the tolerance lets expect."""
        allowed = max(_LOST, _TOLERANCES * rtol) * self.scale + self.rounding
        if max(abs(self.lost), abs(self.worst)) <= allowed:
            return None
        where = ""
        if self.crossings:
            near = min(self.crossings, key=lambda t: abs(t - self.t))
            where = f", where it passed a configuration in which constraints lose rank (t = {near:.6g} s)"
        return (
            f"the energy does not balance: {self.lost:.4g} J of {self.scale:.4g} J were lost beside the work "
            f"that was done, {self.worst:.4g} J of them in the step to t = {self.t:.6g} s{where}. Do not "
            "trust the motion from there on; try smaller tolerances, max_step=, or a start that stays away"
        )

    def __str__(self) -> str:
        """Return the balance in a sentence."""
        passed = f"; constraints lost rank in the step to t = {self.crossings[0]:.6g} s" if self.crossings else ""
        return f"energy: {self.lost:.2g} J of {self.scale:.3g} J lost beside the work that was done{passed}"


def balance(equations: Equations, pieces: Sequence[Interpolant], end: float) -> EnergyBalance:
    """Return the balance of a simulation.

    Parameters
    ----------
    equations : Equations
    pieces : sequence of Interpolant
        Its steps, one after the other.
    end : float
        Where it ended (s), which may be inside the last step.
    """
    m = equations.mechanism
    starts = np.array([piece.start for piece in pieces])
    ends = np.minimum([piece.end for piece in pieces], end)
    t = np.append(starts, ends[-1])
    x = np.array([equations.state(at, piece(at)) for at, piece in zip(starts, pieces, strict=True)])
    x = np.vstack([x, equations.state(ends[-1], pieces[-1](ends[-1]))])
    energy = m.energy(x[:, : m.nq], x[:, m.nq :])
    work = np.zeros(len(pieces))
    fastest = 1.0
    for node in _NODES:
        inside = starts + node * (ends - starts)
        states = np.array([equations.state(at, piece(at)) for at, piece in zip(inside, pieces, strict=True)])
        rates = np.array([_rate(equations, *pair) for pair in zip(inside, states, strict=True)])
        work += 0.5 * (ends - starts) * _power(m, states, rates)
        fastest = max(fastest, 1.0 + float(np.abs(rates).max()))
    lost = work - np.diff(energy.total)
    k = int(np.argmax(np.abs(lost)))
    crossed = t[1:][crossings(m, x[:, : m.nq])]
    scale = float(np.max(energy.kinetic) + np.ptp(energy.total))
    # The power is a difference of energies over a short way.
    largest = float(np.max(energy.kinetic + np.abs(energy.potential)))
    rounding = 4.0 * np.finfo(float).eps * largest * fastest / _DIFFERENCE * (t[-1] - t[0])
    return EnergyBalance(
        float(np.sum(lost)), scale, float(lost[k]), float(ends[k]), tuple(map(float, crossed)), float(rounding)
    )


def _rate(equations: Equations, t: float, x: Array) -> Array:
    """Return dx/dt; zero where there is none."""
    try:
        a, _ = equations.solve(x, equations.input(t, x))
    except LeastActionError:
        return np.zeros_like(x)
    return np.concatenate([x[len(a) :], a])


def _power(m: Mechanism, x: Array, rate: Array) -> Array:
    """Return the rate of the energy (W) in states (N, nx) of a given rate (N, nx)."""
    # The energy changes by the work that is done: its difference along the motion is that of all forces that do some.
    size = _DIFFERENCE / (1.0 + np.abs(rate).max(axis=1, keepdims=True))
    ahead, behind = x + size * rate, x - size * rate
    difference = (
        m.energy(ahead[:, : m.nq], ahead[:, m.nq :]).total - m.energy(behind[:, : m.nq], behind[:, m.nq :]).total
    )
    return np.asarray(difference / (2.0 * size[:, 0]))


def crossings(m: Mechanism, q: Array) -> Array:
    """Return between which configurations (N+1, nq) the constraints lost rank, a mask (N,)."""
    crossed = np.zeros(len(q) - 1, dtype=bool)
    if not m.nc:
        return crossed
    gradients = [m.constraint_jacobian(row)[:, : m.nd] for row in q]
    for k, (before, after) in enumerate(itertools.pairwise(gradients)):
        if np.linalg.matrix_rank(before) < m.nc:
            continue  # redundant equations, or a start in such a configuration
        inertia = m.mass_matrix(q[k])[: m.nd, : m.nd]
        sign, _ = np.linalg.slogdet(before @ np.linalg.solve(inertia, after.T))
        crossed[k] = sign < 0.0
    return crossed


def tell(found: EnergyBalance, rtol: float, *, stacklevel: int = 3) -> str | None:
    """Warn of an energy that does not balance, and return the warning."""
    complaint = found.complaint(rtol)
    if complaint is not None:
        warnings.warn(complaint, EnergyBalanceWarning, stacklevel=stacklevel)
    return complaint
