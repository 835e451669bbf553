"""What the loop knows of a problem, in either kind of time: its iterate, what is minimised, and its stages."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.result import OptimizationResult, Status

_now = time.perf_counter


class Clock:
    """Adds up the seconds in each part of the work: inside of each ``with`` of it, none of which is within another."""

    def __init__(self) -> None:
        self.began = _now()
        self.linearize, self.curvature, self.lq, self.rollout = _Part(), _Part(), _Part(), _Part()

    @property
    def timings(self) -> dict[str, float]:
        """Seconds spent in each part so far."""
        return {
            "linearize": self.linearize.seconds, "curvature": self.curvature.seconds, "lq": self.lq.seconds,
            "rollout": self.rollout.seconds,
        }  # fmt: skip

    @property
    def seconds(self) -> float:
        """Seconds since the clock was made."""
        return _now() - self.began


class _Part:
    """The time inside of each ``with``: short iterations have many."""

    __slots__ = ("began", "seconds")

    def __init__(self) -> None:
        self.seconds = 0.0

    def __enter__(self) -> None:
        self.began = _now()

    def __exit__(self, *_: object) -> None:
        self.seconds += _now() - self.began


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


class Stages(ABC):
    """The stages that a problem is solved in, one after the other: what is so in this one."""

    @property
    @abstractmethod
    def patience(self) -> int:
        """Steps in a row that lower the cost by no more than its noise, after which it is at its minimum."""

    @property
    @abstractmethod
    def longest(self) -> int | None:
        """Iterations after which the stage is over wherever it stands; None: not before its minimum."""

    @property
    @abstractmethod
    def is_passing(self) -> bool:
        """Whether it only leads to the next: then no second derivative need confirm that it ends at a minimum."""

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """Whether its iterates are curves with gaps."""

    @property
    @abstractmethod
    def violates_limits(self) -> bool:
        """Whether the minimum of the last stage violates limits."""

    @property
    @abstractmethod
    def remark(self) -> str:
        """What is to be said of it where it begins."""

    @property
    @abstractmethod
    def unfinished(self) -> str:
        """What is to be said of a run that ends in it, if it is not the last."""

    @property
    @abstractmethod
    def violated(self) -> str:
        """Which limits the iterate violates, in words; empty where it violates none."""

    @abstractmethod
    def tolerated(self, goal: float) -> float:
        """Return the expected decrease that is small enough in it, given what is so at the end."""

    @abstractmethod
    def loosen(self) -> bool:
        """Have a stage that led nowhere ask for less, or for the same in another way; return whether there is one."""

    @abstractmethod
    def verdict(self) -> tuple[Status, str] | None:
        """Return another ending than that of the last stage's minimum, and its particulars."""


class OneStage(Stages):
    """No more than one stage, which ends at the minimum. ``patience``: as of `Stages`."""

    patience = 1
    longest = None
    is_passing = is_open = violates_limits = False
    remark = unfinished = violated = ""

    def __init__(self, patience: int) -> None:
        self.patience = patience

    def tolerated(self, goal: float) -> float:
        return goal

    def loosen(self) -> bool:
        return False

    def verdict(self) -> tuple[Status, str] | None:
        return None


class Standing(Protocol):
    """Where a search stands.

    ``value``: what is minimised there. ``roughness``: what that was seen to be off by, beyond the rounding of a sum.
    ``worst_step``: the coarsest step of time; None where that is not known.
    """

    value: float
    roughness: float
    worst_step: StepQuality | None

    @property
    def noise(self) -> float:
        """What the value may be off: steps are not refused for that much."""

    @property
    def gap(self) -> float:
        """The largest gap between a step's end and the next state, in parts of the states' sizes; 0 of a trajectory."""


class DescentModels(ABC, Generic[M, D]):
    """Quadratic models of what is minimised, where a search stands.

    What is computed for them is kept until the next iterate is accepted.
    """

    has_curvature: bool
    """Whether Newton's method is available."""
    tells_saddles: bool = False
    """Whether Newton's undamped model can be trusted to tell a minimum from a saddle, in this stage."""
    is_below_rounding: bool = False
    """Whether the minimum of the last model is lost to rounding, because its weights are too far apart."""
    largest_shift: float = 1e9
    """Of the weights of all deviations (Levenberg-Marquardt): a direction under more is not tried."""

    @property
    @abstractmethod
    def magnitude(self) -> float:
        """The cost that the tolerance is relative to."""

    @property
    @abstractmethod
    def knows_longest_step(self) -> bool:
        """Whether how far a step may go is known before it is tried, as between barriers.

        A first step that is taken whole then says nothing of the next.
        """

    @abstractmethod
    def minimise(self, method: str, scale: float, shift: float = 0.0) -> M:
        """Return the minimum of a method's model, with a part of the dynamics' curvature.

        The shift is added to the weights of all deviations.
        """

    @abstractmethod
    def refined(self, direction: D, *, holds: bool) -> D:
        """Return what to follow in the place of a direction: a better one of the same model, as to where limits bend.

        ``holds``: whether the last step lowered the cost by what its model had foretold.
        """

    @abstractmethod
    def negative_curvature(self, scale: float) -> D | None:
        """Return a direction of negative curvature, where the undamped Newton model has one.

        The model with this part of the curvature has a minimum.
        """

    @abstractmethod
    def remaining_decrease(self) -> float:
        """Return an upper bound of the decrease that is left where models are lost to rounding; infinity if unknown."""

    @abstractmethod
    def keep_feedback(self, direction: D) -> None:
        """Take the direction's feedback for that of the iterate, which it hardly moved."""

    @abstractmethod
    def forget(self) -> None:
        """Drop all that was computed along the iterate."""


class Steps(ABC, Generic[M, D, I]):
    """Directions from an iterate, and steps along them: of trajectories, or of curves with gaps."""

    @abstractmethod
    def direction(self, method: str, model: M, scale: float, shift: float = 0.0) -> D:
        """Return the direction of a model that has a minimum."""

    @abstractmethod
    def first_step(self, direction: D, length: float) -> float:
        """Return how far to go along a direction at first, at most this far."""

    @abstractmethod
    def simulate(self, direction: D, length: float, bound: float) -> Trial[I] | Refusal:
        """Return the iterate at a step along the direction, or why it is refused."""

    @abstractmethod
    def promised(self, direction: D, length: float) -> float:
        """Return by how much the model of a direction lowers what is minimised; NaN where that is not known."""

    @abstractmethod
    def accept(self, direction: D, trial: Trial[I]) -> None:
        """Make a trial the current iterate."""


class SearchReport(ABC, Generic[D]):
    """What is told of a search where it stands."""

    @property
    @abstractmethod
    def clock(self) -> Clock:
        """What adds up the seconds of the run."""

    @property
    @abstractmethod
    def rollouts(self) -> int:
        """Roll-outs made so far, other than those of line searches."""

    @property
    @abstractmethod
    def note(self) -> str:
        """What is to be said of where it starts."""

    @property
    @abstractmethod
    def shown(self) -> float:
        """The cost as it is told: without what only guides the search."""

    @property
    @abstractmethod
    def undetermined(self) -> str:
        """What is to be said of unknown numbers that nothing tells of, where a model has no minimum because of them."""

    @abstractmethod
    def where(self, direction: D) -> str:
        """Return which input, and when, has most of the decrease that is expected of a direction; empty if unknown."""

    @abstractmethod
    def arrays(self) -> tuple[Array, Array]:
        """Return states and inputs of the current iterate, for callbacks."""

    @abstractmethod
    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result at the current iterate, given all that the loop knows of it."""


class Problem(ABC, Generic[M, D, I]):
    """A system, a cost and the current iterate, in either kind of time: the parts that the loop asks.

    ``begins_again``: whether there are ways to, where a search is stuck. ``begins_at_minimum``: whether it begins with
    what was found without the limits that it has now: there its model holds.
    """

    here: Standing
    models: DescentModels[M, D]
    stages: Stages
    report: SearchReport[D]
    begins_again: bool = False
    begins_at_minimum: bool = False

    @property
    @abstractmethod
    def steps(self) -> Steps[M, D, I]:
        """How iterates follow each other now."""

    @abstractmethod
    def following(self, *, moved: bool) -> Problem[M, D, I] | None:
        """Return the problem in its next stage, from the minimum of this one; None where there is none.

        ``moved``: whether the stage made a step.
        """


def along_parabola(direction: Direction, length: float) -> float:
    """Return by how much the quadratic model of a direction lowers what is minimised over a step."""
    return -direction.slope * length * (1.0 - 0.5 * length)
