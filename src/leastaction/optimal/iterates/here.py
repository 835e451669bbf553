"""Where a search stands."""

from __future__ import annotations

from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.iterates.gap_filter import OpenCurve
from leastaction.optimal.line_search import rounding_of
from leastaction.optimal.state import Place


class Here:
    """Where a search stands: the iterate, which all parts of a problem look at.

    ``x`` (N+1, nx), ``u`` (N, nu): states and inputs. ``gain`` (N, nu, nx): of the projection that led there.
    ``worst_step``: the coarsest step. ``value``: what is minimised. ``roughness``: what that was seen to be off by,
    beyond the rounding of a sum. ``curve``: the iterate with its gaps; None of a trajectory. ``moved``: whether a step
    was made.
    """

    x: Array
    u: Array
    gain: Array
    value: float

    def __init__(self) -> None:
        self.renew()

    def renew(self) -> None:
        """Stand nowhere yet."""
        self.worst_step: StepQuality | None = None
        self.roughness = 0.0
        self.curve: OpenCurve | None = None
        self.moved = False

    @property
    def noise(self) -> float:
        """What the value may be off."""
        return max(rounding_of(self.value), self.roughness)

    @property
    def gap(self) -> float:
        """The largest gap, in parts of the states' sizes; 0 of a trajectory."""
        return 0.0 if self.curve is None else self.curve.gap

    @property
    def is_open(self) -> bool:
        """Whether the iterate is a curve with gaps."""
        return self.curve is not None

    def move(self, x: Array, u: Array, worst_step: StepQuality | None) -> None:
        """Stand at a trajectory."""
        self.curve = None
        self.x, self.u, self.worst_step = read_only(x), read_only(u), worst_step

    def open(self, curve: OpenCurve, penalty: float) -> None:
        """Stand at a curve with gaps; ``penalty``: of these."""
        self.curve = curve
        self.x, self.u, self.worst_step = curve.x, curve.u, curve.worst_step
        self.value = curve.cost + penalty * curve.theta

    def place(self) -> Place:
        """Return it as a place to go back to: the gains lie in memory that is used again."""
        return Place(self.x, self.u, self.gain.copy(), self.worst_step)
