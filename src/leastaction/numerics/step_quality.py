"""How well a time step resolves the motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

# From here on the next steps may have no solution: s grows without bound towards a fold.
_COARSE_RATIO = 2.0
# Below, the equations of the step are others than those of a short one: where angles moved far (rad), the
# motion is not resolved; where they did not, stiff springs or dampers are, which a step may pass over.
_STIFF_RATIO = 0.5
_FAR = 0.5
# Where angles hardly moved (rad), s grows because constraints are about to lose rank, at whatever time step.
_MOVED = 0.2


@dataclass(frozen=True)
class StepQuality:
    """How coarse a time step was.

    Attributes
    ----------
    t : float
        Time at the start of the step (s).
    s : float
        Determinant of the equations of the step for ``dt -> 0`` over that at its solution. Near 1 for a
        sound step; it grows without bound towards a time step for which there is no solution, is small where
        fast turning, stiff springs or dampers dominate the inertia, and is negative where the step
        passed a configuration in which constraints lose rank, or is too long for a motion that is not made, such as
        the buckling of a cable that stays in its plane. NaN: not known.
    angle : float
        Largest angle that a variable moved over the step (rad).
    variable : str
        That variable; empty if nothing turned.
    """

    t: float
    s: float
    angle: float
    variable: str = ""

    @property
    def is_coarse(self) -> bool:
        """Whether the time step is too long for the motion."""
        if self.s >= _COARSE_RATIO:
            return self.angle >= _MOVED or not self.variable
        return 0.0 < self.s <= _STIFF_RATIO and self.angle >= _FAR

    @property
    def coarseness(self) -> float:
        """A number to compare steps by: larger is coarser."""
        return max(self.s if self.s == self.s else 1.0, 1.0) * (1.0 + self.angle)

    def __str__(self) -> str:
        """Return the verdict in a sentence."""
        verdict = "the time step is coarse" if self.is_coarse else "the coarsest step is that"
        turned = f", {self.variable!r} moved by {self.angle:.3g} rad" if self.variable else ""
        crossed = "; it passed a configuration in which its equations lose rank" * (self.s < 0.0)
        return f"{verdict} at t = {self.t:.6g} s: s = {self.s:.3g}{turned}{crossed}"


def coarsest(steps: Iterable[StepQuality | None]) -> StepQuality | None:
    """Return the coarsest of some steps, or None if there is none."""
    known = [step for step in steps if step is not None]
    return max(known, key=lambda step: step.coarseness, default=None)
