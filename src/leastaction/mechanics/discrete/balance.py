"""Whether steps of time keep the energy: what changes it beside the work that is done is an error.

A midpoint step is symplectic, so that its energy is off by a little that does not grow. Where it is off by more, the
motion is another: a lift that passed upright on a branch of its own, a string that fell taut within a step, a linkage
that was too fast for it. The core notes energy and work of every step (``cpp/discrete/energy.hpp``).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from leastaction import _core
from leastaction.errors import EnergyBalanceWarning
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import Frozen, made
from leastaction.numerics.public import public
from leastaction.numerics.warn import warn

# Part of the largest kinetic energy that may come or go, and of the work that was done.
_LOST, _LOST_OF_WORK = 0.01, 0.002
# Steps of which a median passes over what swings from one to the next, and how often the allowed it may be off: more,
# where a linkage whips through a narrow place and it is gone after a few steps.
_LASTING, _PASSING = (11, 1.0), (5, 2.0)
_ROUNDING = 1e-12  # of the sizes of all terms


@public
@dataclass(frozen=True)
class DiscreteBalance(Frozen):
    """Energy at the middle of every step against the work that was done since that of the first.

    Work is what inputs, damping, friction and prescribed motion do; constraints do none.

    Attributes
    ----------
    scale : float
        The largest kinetic energy (J), to compare with.
    allowed : float
        What energy may be off before it is told (J): 1 % of the scale, 0.2 % of the work, and rounding; over less than
        six steps twice of that, over less than three whatever it is, which `swing` has.
    swing : float
        The largest residual less the least (J).
    residual : ndarray, shape (N,)
        Energy at the middle of every step, less that of the first and less the work since (J).
    t : ndarray, shape (N+1,)
        Instants between the steps (s).
    """

    scale: float
    allowed: float
    swing: float
    residual: Array = field(repr=False)
    t: Array = field(repr=False)

    @property
    def lost(self) -> float:
        """Energy that was lost over the whole motion (J); negative where some was gained."""
        return -float(self.residual[-1]) if len(self.residual) else 0.0

    @property
    def off(self) -> Array:
        """How far the energy was off (J), medians of eleven neighbouring steps against the first such median."""
        return self._medians(_LASTING[0])

    def _medians(self, steps: int) -> Array:
        if not len(self.residual):
            return np.zeros(0)
        window = min(steps, len(self.residual))
        medians = np.median(np.lib.stride_tricks.sliding_window_view(self.residual, window), axis=1)
        return np.asarray(medians - medians[0])

    @property
    def complaint(self) -> str:
        """What there is to complain about; empty where energy and work balance."""
        if not self.swing > self.allowed:
            return ""
        for steps, times in (_LASTING, _PASSING):
            off = self._medians(steps)
            too_far = np.abs(off) > times * self.allowed
            if np.any(too_far):
                break
        else:
            return ""
        k, worst = int(np.argmax(too_far)), float(off[np.argmax(np.abs(off))])
        at = k + (len(self.residual) - len(off)) // 2
        return (
            f"the energy does not balance: from t = {self.t[at]:.6g} s on "
            f"{abs(worst):.4g} J were {'gained' if worst > 0 else 'lost'} beside the work that was done, "
            f"{100 * abs(worst) / self.scale:.3g} % of the largest kinetic energy. Do not trust the motion from there "
            f"on; try a smaller time step, or energy_tolerance={1e-4 * self.scale:.1g} (J), which adds instants "
            "where it has to"
        )

    def __str__(self) -> str:
        """Return the balance in a sentence."""
        return self.complaint or (
            f"energy: {abs(self.lost):.2g} J of {self.scale:.3g} J {'gained' if self.lost < 0 else 'lost'} beside the "
            f"work that was done, swinging by {self.swing:.2g} J"
        )


def balance_of(t: Array, rows: Array) -> DiscreteBalance:
    """Return the balance of steps between instants t (N+1,), from what the core noted of them (N, 5)."""
    residual, swing, kinetic, work, size = _core.balance(rows)
    allowed = _LOST * kinetic + _LOST_OF_WORK * work + _ROUNDING * size
    return made(
        DiscreteBalance, scale=kinetic, allowed=allowed, swing=swing, residual=read_only(residual), t=read_only(t)
    )


def tell(found: DiscreteBalance) -> str:
    """Warn of an energy that does not balance, and return the warning; empty where there is none."""
    complaint = found.complaint
    if complaint:
        warn(complaint, EnergyBalanceWarning)
    return complaint
