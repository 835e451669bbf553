"""Whether a simulation lost energy, or its way, where the constraints lose rank.

Where the gradients of the constraints become dependent (a lift with its links upright, a parallelogram drawn
out straight) the accelerations are not determined, two ways cross, and a solver's error control may step over
the place without noticing. What tells of it: the energy's balance, for between two instants energy changes by
the work of inputs, damping and prescribed motion and by nothing else; and the eigenvalues of
``(Dh_k M^-1 Dh_k^T)^-1 (Dh_k M^-1 Dh_k+1^T)``, which are near 1 along the motion and of which some change their sign.

The motion itself goes smoothly over such a place. At a distance d from it a configuration that is off the constraints
by e has a tangent that is off by ``e / d``: the intermediate states of a long step are off by its error, and those of
the short steps that a solver then takes by rounding, when d is small enough. So near such a place a simulation brings
intermediate states back onto the constraints too, and leads over it by long steps; see `Passages`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import EnergyBalanceWarning, LeastActionError
from leastaction.mechanics.continuous.equations import Equations
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.ode import Interpolant
from leastaction.numerics.warn import warn

# Part of the energy that moves about which may be lost in all before it is told; or this many relative tolerances.
_LOST = 1e-3
_TOLERANCES = 1e3
_NODES = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)  # Gauss: none where inputs jump
_DIFFERENCE = 1e-5  # of states, for the rate of the energy
_NEAR = 0.1  # of the largest it was: a singular value of Dh so small is near a loss of rank
_RANK = 1e-6  # of the largest: smaller ones are those of redundant equations
# Part of the energy that moves about which a passage may lose, or this many relative tolerances.
_PASSAGE_LOST, _PASSAGE_TOLERANCES = 1e-6, 30.0


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
        passed = f"; {self.passed}" if self.crossings else ""
        return f"energy: {self.lost:.2g} J of {self.scale:.3g} J lost beside the work that was done{passed}"

    @property
    def passed(self) -> str:
        """Where constraints lost rank, in words; empty if they did not."""
        if not self.crossings:
            return ""
        more = len(self.crossings) - 1
        others = f" and {more} more time{'s'[: more != 1]}" if more else ""
        return f"constraints lost rank in the step to t = {self.crossings[0]:.6g} s{others}"


def balance(equations: Equations, pieces: Sequence[Interpolant], end: float) -> EnergyBalance:
    """Return the balance of a simulation.

    ``pieces``: its steps, one after the other. ``end``: where it ended (s), which may be inside the last step.
    """
    m = equations.mechanism
    starts = np.array([piece.start for piece in pieces])
    ends = np.minimum([piece.end for piece in pieces], end)
    t = np.append(starts, ends[-1])
    x = np.array([equations.state(at, piece(at)) for at, piece in zip(starts, pieces, strict=True)])
    x = np.vstack([x, equations.state(ends[-1], pieces[-1](ends[-1]))])
    energy = m.energy(x[:, : m.nq], x[:, m.nq :], t)
    work = np.zeros(len(pieces))
    fastest = 1.0
    for node in _NODES:
        inside = starts + node * (ends - starts)
        states = np.array([equations.state(at, piece(at)) for at, piece in zip(inside, pieces, strict=True)])
        rates = np.array([_rate(equations, *pair) for pair in zip(inside, states, strict=True)])
        work += 0.5 * (ends - starts) * _power(m, inside, states, rates)
        fastest = max(fastest, 1.0 + float(np.abs(rates).max()))
    lost = work - np.diff(energy.total)
    k = int(np.argmax(np.abs(lost)))
    crossed = t[1:][crossings(m, t, x[:, : m.nq])]
    scale = float(np.max(energy.kinetic) + np.ptp(energy.total))
    # The power is a difference of energies over a short way.
    largest = float(np.max(energy.kinetic + np.abs(energy.potential)))
    rounding = 4.0 * np.finfo(float).eps * largest * fastest / _DIFFERENCE * (t[-1] - t[0])
    return EnergyBalance(
        float(np.sum(lost)), scale, float(lost[k]), float(ends[k]), tuple(map(float, crossed)), float(rounding)
    )


class Passages:
    """How a simulation passes configurations in which constraints lose rank. One for each simulation.

    ``equations``: with constraints that are projected on. ``rtol``: of the solver.
    """

    def __init__(self, equations: Equations, rtol: float) -> None:
        self.equations = equations
        self.allowed = max(_PASSAGE_LOST, _PASSAGE_TOLERANCES * rtol)
        self.rank, self.typical, self.scale = 0, 0.0, 0.0

    def is_near(self, t: float, x: Array) -> bool:
        """Whether constraints are about to lose rank, by the least of their singular values against its largest."""
        m = self.equations.mechanism.at_time(t)
        sizes = np.linalg.svd(m.constraint_jacobian(x[: m.nq])[:, : m.nd], compute_uv=False)
        rank = int(np.sum(sizes > _RANK * sizes.max(initial=0.0)))
        if rank > self.rank:
            self.rank, self.typical = rank, 0.0
        if not self.rank:
            return False
        least = float(sizes[self.rank - 1])
        self.typical = max(self.typical, least)
        return least < _NEAR * self.typical

    def error(self, pieces: Sequence[Interpolant]) -> float:
        """Return the energy that some steps lost against what they may."""
        found = balance(self.equations, pieces, pieces[-1].end)
        self.scale = max(self.scale, found.scale)
        allowed = self.allowed * self.scale + found.rounding
        lost = max(abs(found.lost), abs(found.worst))
        return lost / allowed if lost > 0.0 else 0.0


def _rate(equations: Equations, t: float, x: Array) -> Array:
    """Return dx/dt; zero where there is none."""
    try:
        a, _ = equations.solve(t, x, equations.input(t, x))
    except LeastActionError:
        return np.zeros_like(x)
    m = equations.mechanism
    return np.concatenate([equations.kinematics.rates(x[: m.nq], x[m.nq :]), a])


def _power(m: Mechanism, t: Array, x: Array, rate: Array) -> Array:
    """Return the rate of the energy (W) at times (N,) in states (N, nx) of a given rate (N, nx)."""
    # The energy changes by the work that is done, and by itself where a potential does with the time: its difference
    # along the motion is that of all forces that do some.
    size = _DIFFERENCE / (1.0 + np.abs(rate).max(axis=1))
    ahead, behind = (
        m.energy(at[:, : m.nq], at[:, m.nq :], when).total
        for at, when in ((x + way[:, None] * rate, t + way) for way in (size, -size))
    )
    return np.asarray((ahead - behind) / (2.0 * size))


def crossings(m: Mechanism, t: Array, q: Array) -> Array:
    """Return between which configurations (N+1, nq) at times (N+1,) the constraints lost rank, a mask (N,)."""
    crossed = np.zeros(len(q) - 1, dtype=bool)
    if not m.nc:
        return crossed
    gradients = [m.at_time(when).constraint_jacobian(row)[:, : m.nd] for when, row in zip(t, q, strict=True)]
    for k, (before, after) in enumerate(itertools.pairwise(gradients)):
        if np.linalg.matrix_rank(before) < m.nc:
            continue  # redundant equations, or a start in such a configuration
        inertia = m.mass_matrix(q[k])[: m.nd, : m.nd]
        # Both may be singular: of variables that move no mass, and in such a configuration itself.
        inverse = np.linalg.pinv(inertia, hermitian=True) @ before.T
        turned = np.linalg.eigvals(np.linalg.pinv(before @ inverse, hermitian=True) @ after @ inverse)
        crossed[k] = bool(np.any(turned.real < 0.0))
    return crossed


def tell(found: EnergyBalance, rtol: float) -> str | None:
    """Warn of an energy that does not balance, and return the warning."""
    complaint = found.complaint(rtol)
    if complaint is not None:
        warn(complaint, EnergyBalanceWarning)
    return complaint
