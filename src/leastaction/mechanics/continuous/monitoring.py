"""Whether a simulation lost energy, or its way, where the constraints lose rank.

Where the gradients of the constraints become dependent (a lift with its links upright, a parallelogram drawn out
straight) the accelerations are not determined, two ways cross, and a solver's error control may step over the place without
noticing. What tells of it: the energy's balance, for between two instants energy changes by the work of inputs, damping
and prescribed motion and by nothing else; and the determinant of ``Dh(q_k) M^-1 Dh(q_k+1)^T``, which changes its sign.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from leastaction.errors import EnergyBalanceWarning
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array

# Part of the energy that moves about which may be lost in all before it is told; or this many relative tolerances.
_LOST = 1e-3
_TOLERANCES = 1e3
_H = 1e-6  # s; of the difference that stands for the rate of the energy


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
    """

    lost: float
    scale: float
    worst: float
    t: float
    crossings: tuple[float, ...] = ()

    def complaint(self, rtol: float) -> str | None:
        """Return what there is to complain about, or None: all is as accurate as the tolerance lets expect."""
        allowed = max(_LOST, _TOLERANCES * rtol) * self.scale
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
        return f"energy: {self.lost:.2g} J of {self.scale:.3g} J lost beside the work that was done"


def energy_rate(m: Mechanism, x: Array, rate: Array) -> Array:
    """Return the rate of the energy (W) in states (N, nx) of a given rate (N, nx)."""
    ahead, behind = x + _H * rate, x - _H * rate
    nq = m.nq
    difference = (
        m.energy(ahead[:, :nq], ahead[:, nq:]).total
        - m.energy(behind[:, :nq], behind[:, nq:]).total
    )
    return np.asarray(difference / (2.0 * _H))


def balance(
    m: Mechanism, t: Array, x: Array, rates: Array, middles: Array, middle_rates: Array
) -> EnergyBalance:
    """Return the balance of a simulation.

    Parameters
    ----------
    m : Mechanism
    t : ndarray, shape (N+1,)
        Ends of the solver's steps (s), the start first.
    x, rates : ndarray, shape (N+1, nx)
        States there and their rates.
    middles, middle_rates : ndarray, shape (N, nx)
        The same in the middle of each step.
    """
    energy = m.energy(x[:, : m.nq], x[:, m.nq :])
    power, between = energy_rate(m, x, rates), energy_rate(m, middles, middle_rates)
    # Simpson's rule; where there is no power to be had, as if there were none.
    work = np.nan_to_num(np.diff(t) / 6.0 * (power[:-1] + 4.0 * between + power[1:]))
    lost = work - np.diff(energy.total)
    scale = float(np.max(energy.kinetic) + np.ptp(energy.total))
    k = int(np.argmax(np.abs(lost))) if len(lost) else 0
    return EnergyBalance(
        float(np.sum(lost)),
        scale,
        float(lost[k]) if len(lost) else 0.0,
        float(t[k + 1]) if len(lost) else float(t[0]),
        tuple(float(at) for at in t[1:][crossings(m, x[:, : m.nq])]),
    )


def crossings(m: Mechanism, q: Array) -> Array:
    """Return between which configurations (N+1, nq) the constraints lost rank, a mask (N,)."""
    crossed = np.zeros(len(q) - 1, dtype=bool)
    if not m.nc:
        return crossed
    gradients = [m.constraint_jacobian(row)[:, : m.nd] for row in q]
    for k, (before, after) in enumerate(zip(gradients[:-1], gradients[1:], strict=True)):
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
