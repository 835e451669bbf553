"""What the loop knows of a problem: a system, a cost and the current iterate, in either kind of time."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.line_search import Refusal, Trial, rounding_of
from leastaction.optimal.result import OptimizationResult, Status


class Clock:
    """Adds up the seconds spent in each part of the work."""

    def __init__(self) -> None:
        self.began = time.perf_counter()
        self.timings = dict.fromkeys(("linearize", "curvature", "lq", "rollout"), 0.0)

    def __call__(self, part: str) -> _Part:
        """Count the time inside of a ``with`` to a part."""
        return _Part(self.timings, part)

    @property
    def seconds(self) -> float:
        """Seconds since the clock was made."""
        return time.perf_counter() - self.began


class _Part:
    """The time inside of a ``with``; a class, because short iterations have many and a generator takes longer."""

    __slots__ = ("began", "part", "timings")

    def __init__(self, timings: dict[str, float], part: str) -> None:
        self.timings, self.part = timings, part

    def __enter__(self) -> None:
        self.began = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.timings[self.part] += time.perf_counter() - self.began


class ModelSolution(Protocol):
    """The solution of a linear-quadratic problem, as far as the loop looks into it."""

    @property
    def definite(self) -> bool:
        """Whether there is a minimum."""

    @property
    def message(self) -> str:
        """Why there is none."""


@dataclass(frozen=True)
class Direction:
    """A descent direction.

    Attributes
    ----------
    method : str
        Which model it minimises.
    slope : float
        ``Dg . dxi``, negative.
    curvature_scale : float
        The part of the dynamics' curvature in the model; 0 for the methods without curvature.
    shift : float
        What its model adds to the weights of all deviations.
    bend : float
        The second derivative along it, if it is negative and the direction is followed for that; else 0.
    """

    method: str
    slope: float
    curvature_scale: float
    shift: float = 0.0
    bend: float = 0.0


M = TypeVar("M", bound=ModelSolution)
D = TypeVar("D", bound=Direction)
I = TypeVar("I")  # noqa: E741 - an iterate


class Problem(ABC, Generic[M, D, I]):
    """A system, a cost and the current iterate: all that the loop knows of either kind of time.

    Everything computed along an iterate is kept until the next one is accepted.
    """

    value: float
    """Cost of the current iterate."""
    rollouts: int = 0
    """Roll-outs made so far, other than those of line searches."""
    has_curvature: bool
    """Whether Newton's method is available."""
    tells_saddles: bool = False
    """Whether Newton's undamped model can be trusted to tell a minimum from a saddle."""
    note: str = ""
    """What is to be said of where it starts."""
    remark: str = ""
    """What is to be said of the stage that it is in, where it begins."""
    worst_step: StepQuality | None = None
    """The coarsest step along the current iterate; None where that is not known."""
    largest_shift: float = 1e9
    """Of the weights of all deviations (Levenberg-Marquardt): a direction under more is not tried."""
    roughness: float = 0.0
    """What the cost was seen to be off by, beyond the rounding of its sum."""
    begins_at_minimum: bool = False
    """Whether it begins with what was found without the limits that it has now: there its model holds."""
    is_drowned: bool = False
    """Whether rounding has taken from the last model what tells of its minimum: weights are too far apart."""
    sees_walls: bool = False
    """Whether `first_step` sees what steps are shortened for: one taken as it came then says nothing of the next."""

    def __init__(self) -> None:
        self.clock = Clock()

    @property
    def noise(self) -> float:
        """What the cost may be off: steps are not refused for that much."""
        return max(rounding_of(self.value), self.roughness)

    @property
    def magnitude(self) -> float:
        """The cost that the tolerance is relative to."""
        return self.value

    @property
    def gap(self) -> float:
        """The largest gap between a step's end and the next state, in parts of the states' sizes; 0 of a trajectory."""
        return 0.0

    @property
    def unmet(self) -> str:
        """Return which limits the iterate violates, in words; empty where it violates none."""
        return ""

    @property
    def undetermined(self) -> str:
        """What is to be said of unknown numbers that nothing tells of, where a model has no minimum because of them."""
        return ""

    @property
    def unfinished(self) -> str:
        """What is to be said of a run that ends before its last stage."""
        return ""

    @property
    def patience(self) -> int:
        """Steps in a row that lower the cost by no more than its noise, after which it is at its minimum."""
        return 1

    def tolerated(self, goal: float) -> float:
        """Return the expected decrease that is small enough at this stage, given what is so at the end."""
        return goal

    def next_stage(self, *, moved: bool = True) -> bool:  # noqa: ARG002
        """Go on from the minimum of one stage to the next, and return whether there is one.

        ``moved``: whether the stage made a step.
        """
        return False

    @property
    def is_passing(self) -> bool:
        """Whether this stage only leads to the next, so that its minimum need not be seen to be one."""
        return False

    @property
    def longest_stage(self) -> int | None:
        """Iterations after which a stage is over wherever it stands; None: not before its minimum."""
        return None

    @property
    def is_open(self) -> bool:
        """Whether the iterate is a curve with gaps."""
        return False

    @property
    def is_unmet(self) -> bool:
        """Whether the minimum of the last stage violates limits."""
        return False

    def relent(self) -> bool:
        """Have a stage that led nowhere ask for less, or otherwise, and return whether there is such a thing."""
        return False

    def verdict(self) -> tuple[Status, str] | None:
        """Return another ending than that of the last stage's minimum, and its particulars."""
        return None

    @property
    def shown(self) -> float:
        """The cost of the current iterate as it is told: without what only guides the search."""
        return self.value

    @abstractmethod
    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, or an initial state and inputs."""

    @abstractmethod
    def resume(self, result: Any) -> None:
        """Begin where an earlier run ended."""

    @abstractmethod
    def minimise_model(self, method: str, scale: float, shift: float = 0.0) -> M:
        """Return the minimum of a method's quadratic model, with a part of the dynamics' curvature.

        The shift is added to the weights of all deviations.
        """

    @abstractmethod
    def direction(self, method: str, model: M, scale: float, shift: float = 0.0) -> D:
        """Return the direction of a model that has a minimum."""

    def negative_curvature(self, scale: float) -> D | None:  # noqa: ARG002
        """Return a direction of negative curvature, where the undamped Newton model has one.

        The model with this part of the curvature has a minimum.
        """
        return None

    def left_beside_rounding(self) -> float:
        """Return a decrease no smaller than what is left, where rounding drowns models; infinity if nothing tells."""
        return np.inf

    def refined(self, direction: D, *, holds: bool) -> D:  # noqa: ARG002
        """Return what to follow in the place of a direction, by more of the same model.

        ``holds``: whether the last step lowered the cost by what its model had foretold.
        """
        return direction

    def first_step(self, direction: D, length: float) -> float:  # noqa: ARG002
        """Return how far to go along a direction at first, at most this far."""
        return length

    @abstractmethod
    def simulate(self, direction: D, length: float, bound: float) -> Trial[I] | Refusal:
        """Return the projection of a step along the direction, or why it is refused."""

    def promised(self, direction: D, length: float) -> float:
        """Return by how much the model of a direction lowers the cost over a step; NaN where that is not known."""
        return -direction.slope * length * (1.0 - 0.5 * length)

    @abstractmethod
    def accept(self, direction: D, trial: Trial[I]) -> None:
        """Make a trial the current iterate."""

    def where(self, direction: D) -> str:  # noqa: ARG002
        """Return which input, and when, has most of the decrease that is expected of a direction; empty if unknown."""
        return ""

    @abstractmethod
    def keep_feedback(self, direction: D) -> None:
        """Take the direction's feedback for that of the iterate, which it hardly moved."""

    @abstractmethod
    def forget(self) -> None:
        """Drop all that was computed along the current iterate."""

    @abstractmethod
    def arrays(self) -> tuple[Array, Array]:
        """Return states and inputs of the current iterate, for callbacks."""

    @abstractmethod
    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result at the current iterate, given all that the loop knows of it."""
