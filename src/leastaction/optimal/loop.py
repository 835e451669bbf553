"""The iteration of the projection-operator optimiser, for problems in discrete and in continuous time.

The loop chooses the method of every direction, searches along it, decides when to stop, and tells of
what it does. What trajectories are made of is left to a `Problem`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.line_search import LineSearch, Refusal, Step, Trial, rounding_of
from leastaction.optimal.result import (
    HistoryBuilder,
    IterationRecord,
    NewtonSchedule,
    OptimizationResult,
    Settings,
    Status,
)

__all__ = ["Callback", "Clock", "Direction", "Loop", "Model", "Problem", "both"]

Callback = Callable[[IterationRecord], object]

# Methods in the order in which they replace one another when a direction cannot be followed.
_CHAIN = ("newton", "quasi-newton", "steepest")

# Where a stage of the problem may be followed by the next.
_ENDS = (Status.CONVERGED, Status.STALLED)

# Shorter steps that are tried along a direction which another one can replace.
_BACKTRACKS = {"newton": 4, "quasi-newton": 6, "negative-curvature": 8}
_BACKTRACKS_SHIFTED = 2

# Levenberg-Marquardt's weights: the least, and the factor from one to the next.
_LEAST_SHIFT, _MORE_SHIFT = 1e-3, 10.0

# A model without a minimum is tried again with this part of its curvature; less than the least is not worth having.
_LESS_CURVATURE = 0.3
_LEAST_CURVATURE = 1.0 / 128.0

# A search begins with a step that is longer by this than the last one, if that had to be cut so much.
_LONGER = 4.0

# A quadratic tail is foretold to be over where this part of what is small enough is left, from a step whose model was
# right to the second part of the decrease.
_FORETOLD, _RIGHT = 0.01, 0.05

# Whether a negative second derivative is right is looked at where it changes the cost by so many times its noise; it is
# wrong if there is less of it than this part.
_ABOVE_NOISE, _SOME = 1e7, 0.1

# A cost that does not fall any more is at its minimum if no more than this part of it is expected to be gained; if
# more is, so many steps are made to gain it.
_STALLED_CLOSE, _STALLED_STEPS = 1e-7, 5


# Of so many first steps, most were shorter than this where a run is likely to get lost.
_FIRST_STEPS, _MOST, _CUT = 14, 10, 0.3

# So many iterations tell how fast a run is; it is fast where each leaves this part of the expected decrease.
_LOOKED_BACK, _FAST = 10, 0.9

_STUCK = (Status.STALLED, Status.LINE_SEARCH_FAILED, Status.SADDLE)


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


class Model(Protocol):
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


M = TypeVar("M", bound=Model)
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
    worst_step: StepQuality | None = None
    """The coarsest step along the current iterate; None where that is not known."""
    largest_shift: float = 1e9
    """Of the weights of all deviations (Levenberg-Marquardt): a direction under more is not tried."""
    ease: float = 1.0
    """How much easier the problem of this stage is than the one that was asked for."""

    def __init__(self) -> None:
        self.clock = Clock()

    @property
    def noise(self) -> float:
        """What the cost may be off: steps are not refused for that much."""
        return rounding_of(self.value)

    @property
    def magnitude(self) -> float:
        """The cost that the tolerance is relative to."""
        return self.value

    @property
    def gap(self) -> float:
        """The largest gap between a step's end and the next state, in parts of the states' sizes; 0 of a trajectory."""
        return 0.0

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

    def next_stage(self) -> bool:
        """Go on from the minimum of one stage to the next, and return whether there is one."""
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
    def long_run(self) -> int | None:
        """Iterations after which gaps may be the shorter way; None where they are none."""
        return None

    @property
    def prefers_gaps(self) -> bool:
        """Whether gaps are more promising than an easier stage, where a run gets lost."""
        return False

    def begin_with_gaps(self, *, brief: bool) -> bool:  # noqa: ARG002
        """Begin again with gaps between the steps, and return whether that can be done.

        If `brief`, they have to close soon: there are other ways.
        """
        return False

    def begin_again(self) -> bool:
        """Begin again with an easier stage, and return whether there is one."""
        return False

    def retry_stage(self) -> bool:
        """Make a stage again that led nowhere, from a better place, and return whether there is one."""
        return False

    def fall_back(self) -> bool:
        """Return to where it stood before it began again, if that is better, and return whether it was."""
        return False

    def begin_finer(self) -> bool:
        """Begin again from what shorter steps of time lead to, and return whether there is such a thing."""
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

    def first_step(self, direction: D, length: float) -> float:  # noqa: ARG002
        """Return how far to go along a direction at first, at most this far."""
        return length

    @abstractmethod
    def simulate(self, direction: D, length: float, bound: float) -> Trial[I] | Refusal:
        """Return the projection of a step along the direction, or why it is refused."""

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


def both(initial: Any) -> tuple[Any, Any]:
    """Return the pair (x, u) that was given to start from, or complain."""
    if not isinstance(initial, (tuple, list)) or len(initial) != 2:
        raise ArgumentError(f"initial: got {type(initial).__name__}, expected a pair (x, u).")
    x, u = initial
    return x, u


class Loop(Generic[M, D, I]):
    """One optimisation.

    ``problem``: standing at its first iterate. ``callback``: told of every iteration; a true answer ends it.
    ``resume``: the result whose history goes on.
    """

    def __init__(
        self,
        problem: Problem[M, D, I],
        settings: Settings,
        callback: Callback | None,
        resume: OptimizationResult | None,
    ) -> None:
        self.problem = problem
        self.settings = settings
        self.callback = callback
        self.line_search = LineSearch(settings.alpha, settings.beta)
        self.searched = 0
        self.still = 0
        self.stalled = False
        self.remark = ""
        if resume is None:
            self.history = HistoryBuilder()
            self.limit = settings.max_iterations
            self.schedule = NewtonSchedule()
        else:
            self.history = HistoryBuilder(resume.history)
            self.limit = settings.max_iterations + resume.iterations
            self.schedule = resume.schedule

    def run(self) -> OptimizationResult:
        """Iterate until there is a reason to stop."""
        try:
            outcome = None
            if not self.history.cost:
                outcome = self._tell(None, None, np.nan, self.problem.note)
            while outcome is None or self._goes_on(outcome):
                # Looked at before each iteration, so that one which is resumed does as well.
                if self.schedule.spent >= (self.problem.longest_stage or np.inf):
                    self._next_stage()
                elif self.history.iterations == _FIRST_STEPS and self._was_violent():
                    _ = self._begin_with_gaps() or self._begin_again()
                elif self.schedule.spent == self.problem.long_run and not self.schedule.again:
                    self._begin_with_gaps()
                outcome = self._advance()
            verdict = self.problem.verdict() if outcome.status in _ENDS else None
            if verdict is not None:
                outcome = _Outcome(*verdict, expected=outcome.expected)
        except KeyboardInterrupt:
            # A solution may have been left half written; none of it belongs to the iterate.
            self.problem.forget()
            outcome = _Outcome(Status.INTERRUPTED)
        return self._finish(outcome)

    def _goes_on(self, outcome: _Outcome) -> bool:
        """Return whether the problem has more to do where a stage ended so."""
        problem = self.problem
        stuck = outcome.status in _STUCK
        if (outcome.status in _ENDS or (stuck and problem.longest_stage is not None)) and self._next_stage():
            return True
        if outcome.status in _ENDS:
            return False
        # Stages that end at steps of time that are too coarse lead there again, however they are made.
        if stuck and self.schedule.again and self._begin_finer():
            return True
        if stuck and problem.retry_stage():
            self._set_out(
                NewtonSchedule(again=True, finer=self.schedule.finer),
                "led nowhere, back to the last stage that ended well",
            )
            return True
        if stuck and ((problem.prefers_gaps and self._begin_with_gaps()) or self._begin_again()):
            return True
        if stuck and problem.fall_back():
            self._set_out(
                NewtonSchedule(again=True, finer=self.schedule.finer),
                "the way before it began again had led further: it goes on there",
            )
            return True
        return stuck and self._begin_finer()

    def _next_stage(self) -> bool:
        """Go on to the problem's next stage, if it has one."""
        was_open = self.problem.is_open
        if self.problem.next_stage():
            self._set_out(replace(self.schedule, expected=np.nan, full=False))
            return True
        if not was_open:
            return False
        again = NewtonSchedule(again=self.schedule.again, finer=self.schedule.finer)
        self._set_out(again, "the gaps did not close, back to where it stood")
        if self._was_violent():
            self._begin_again()
        return True

    def _was_violent(self) -> bool:
        """Return whether most of the first steps had to be cut short: the run is likely to get lost."""
        return sum(length < _CUT for length in self.history.step_lengths[:_FIRST_STEPS]) >= _MOST

    def _begin_with_gaps(self) -> bool:
        """Begin again with gaps between the steps, for the automatic choice only."""
        if self.settings.method != "auto" or not self.problem.begin_with_gaps(brief=self._was_violent()):
            return False
        schedule = NewtonSchedule(again=self.schedule.again, finer=self.schedule.finer)
        self._set_out(schedule, "began again, with gaps between the steps")
        return True

    def _begin_again(self) -> bool:
        """Begin again with an easier stage, once and for the automatic choice only."""
        if self.schedule.again or self.settings.method != "auto" or not self.problem.begin_again():
            return False
        schedule = NewtonSchedule(again=True, finer=self.schedule.finer)
        self._set_out(schedule, "began again, where searches would lead nowhere")
        return True

    def _begin_finer(self) -> bool:
        """Begin again from what shorter steps of time lead to, once and for the automatic choice only."""
        if self.schedule.finer or self.settings.method != "auto" or not self.problem.begin_finer():
            return False
        self._set_out(NewtonSchedule(again=True, finer=True), "began again, from a minimum with half the steps of time")
        return True

    def _set_out(self, schedule: NewtonSchedule, why: str = "") -> None:
        """Begin a stage of the problem; the note of the next iteration says why."""
        self.still, self.stalled = 0, False
        self.schedule = replace(schedule, ease=self.problem.ease, spent=0)
        self.remark = why or self.remark

    def _advance(self) -> _Outcome | None:
        """Make one iteration; the outcome if it was the last."""
        notes: list[str] = []
        expected = np.nan
        refusal = None
        try:
            for direction in self._directions(notes):
                expected = -direction.slope
                if self.history.iterations >= self.limit:
                    return _Outcome(Status.ITERATION_LIMIT, self._progress(direction), expected)
                step = self._search(direction) if direction.bend == 0.0 else self._search_down(direction)
                if step.trial is not None:
                    return self._accept(direction, step, step.trial, "; ".join([*self._remarks(), *notes]))
                refusal = step.refusal
                assert refusal is not None
                notes.append(f"{direction.method}: no step was short enough, {refusal.reason}")
                self._note_failure(direction.method)
                if direction.bend < 0.0:
                    return _Outcome(Status.SADDLE, f"The search along it ended: {refusal.reason}.", expected)
                if refusal.hopeless and direction.shift > 0.0:
                    break
        except _Found as found:
            return found.outcome
        except LeastActionError as error:
            return _Outcome(Status.DERIVATIVES_FAILED, str(error))
        if refusal is None:
            return _Outcome(Status.NO_DIRECTION, "; ".join(notes))
        if expected < max(1e-10 * abs(self.problem.value), self.problem.noise):
            return _Outcome(Status.STALLED, notes[-1], expected)
        return _Outcome(Status.LINE_SEARCH_FAILED, notes[-1], expected)

    # ---- Where to go ----------------------------------------------------------------------------

    def _directions(self, notes: list[str]) -> Iterator[D]:
        """Yield one direction after the other, for as long as they cannot be followed.

        First those of the methods, each of which is simpler than the one before; then, of the automatic choice,
        ever shorter ones (Levenberg-Marquardt). Raises `_Found` at a minimum.
        """
        automatic = self.settings.method == "auto"
        shift = self.schedule.shift
        while shift < self.problem.largest_shift:
            searched = False
            for method in self._methods():
                if method == "steepest" and automatic and (searched or shift > 0.0):
                    break
                direction = self._direction(method, shift)
                if isinstance(direction, str):
                    notes.append(f"{method}: {direction}")
                    self._note_failure(method)
                    continue
                if self.stalled or -direction.slope <= self._goal():
                    if shift > self.schedule.shift:
                        return  # So short a step leads nowhere.
                    direction = self._confirm(direction)
                searched = True
                if shift != self.schedule.shift:
                    self.schedule = replace(self.schedule, shift=shift)
                yield direction
            if not automatic or (shift == 0.0 and not searched):
                return
            shift = max(_MORE_SHIFT * shift, _LEAST_SHIFT)

    def _methods(self) -> tuple[str, ...]:
        """Return the methods for this iteration: each replaces the one before if that fails."""
        first = self.settings.method
        if first == "auto":
            newton = self.problem.has_curvature and self.schedule.wait == 0
            first = "newton" if newton else "quasi-newton"
        return _CHAIN[_CHAIN.index(first) :]

    def _direction(self, method: str, shift: float) -> D | str:
        """Return the direction of a method, or why there is none.

        Newton's model gets as much of the dynamics' curvature as leaves it a minimum.
        """
        scale = self.schedule.scale if method == "newton" else 0.0
        model = self.problem.minimise_model(method, scale, shift)
        while not model.definite and scale > _LEAST_CURVATURE:
            scale *= _LESS_CURVATURE
            self.schedule = self.schedule.after_indefinite(scale)
            model = self.problem.minimise_model(method, scale, shift)
        if not model.definite:
            return f"the model has no minimum, {model.message}"
        damped = "-damped" if 0.0 < scale < 1.0 else ""
        shifted = "-shifted" if shift > 0.0 else ""
        return self.problem.direction(f"{method}{damped}{shifted}", model, scale, shift)

    def _note_failure(self, method: str) -> None:
        if method.startswith("newton"):
            self.schedule = self.schedule.after_failure()

    # ---- Whether it is a minimum ----------------------------------------------------------------

    def _goal(self) -> float:
        """Return the expected decrease that is small enough."""
        settings = self.settings
        goal = settings.tolerance * abs(self.problem.magnitude) + settings.absolute_tolerance
        return self.problem.tolerated(goal)

    def _confirm(self, direction: D) -> D:
        """Return a direction along which the cost still falls, where a model expects no more of its own.

        Damped and shifted models have a minimum at a saddle too: only the undamped second derivative tells.
        Raises `_Found` if there is nowhere to go.
        """
        problem = self.problem
        expected = -direction.slope
        status = Status.STALLED if self.stalled else Status.CONVERGED
        if self.schedule.shift != 0.0:
            self.schedule = replace(self.schedule, shift=0.0)
        if not problem.tells_saddles:
            raise _Found(_Outcome(status, expected=expected))
        goes_on = self.settings.method in ("auto", "newton")
        if direction.curvature_scale == 1.0 > direction.shift:
            return self._unless_close(direction, status)
        model = problem.minimise_model("newton", 1.0)
        if model.definite:
            newton = problem.direction("newton", model, 1.0)
            if not goes_on:
                raise _Found(_Outcome(status, expected=expected))
            return self._unless_close(newton, status)
        scale = 0.0 if direction.shift > 0.0 else direction.curvature_scale
        down = problem.negative_curvature(scale) if goes_on else None
        if down is None:
            raise _Found(_Outcome(Status.SADDLE, model.message, expected))
        promise = -(down.slope + 0.5 * down.bend)
        if promise <= max(self._goal(), problem.noise):
            detail = f"So is the decrease that negative curvature promises along the direction found, {promise:.2g}."
            raise _Found(_Outcome(status, detail, max(expected, promise)))
        return down

    def _unless_close(self, newton: D, status: Status) -> D:
        """Return the direction of Newton's undamped model, unless it leads hardly any further down: then it ends."""
        problem, expected = self.problem, -newton.slope
        enough = max(self._goal(), problem.noise)
        if self.stalled:
            enough = max(enough, _STALLED_CLOSE * abs(problem.value))
        if expected <= enough:
            raise _Found(_Outcome(status, expected=expected))
        if self.still >= problem.patience + _STALLED_STEPS:
            detail = "The cost has not fallen for several steps."
            raise _Found(_Outcome(Status.LINE_SEARCH_FAILED, detail, expected))
        return newton

    def _search_down(self, direction: D) -> Step[I]:
        """Search along negative curvature; if need be, with steps so short that the second derivative holds.

        Raises `_Found` if the cost is seen not to bend downwards there: then the given second derivative is wrong,
        and there is nothing that speaks against a minimum.
        """
        problem = self.problem
        length = min(1.0, float(np.sqrt(_ABOVE_NOISE * problem.noise / -direction.bend)))
        costs = []
        with problem.clock("rollout"):
            for side in (length, -length):
                costs.append(problem.simulate(direction, side, np.inf).cost)
                self.searched += 1
        # A roll-out that failed has a cost of NaN, and says nothing.
        if sum(costs) - 2.0 * problem.value > _SOME * length**2 * direction.bend:
            detail = (
                "The second derivative of the system has it fall along a direction in which it rises: hold it to "
                "check_derivatives."
            )
            raise _Found(_Outcome(Status.CONVERGED, detail, -direction.slope))
        step = self._search(direction)
        return step if step.trial is not None else self._search(direction, first=length)

    def _foretold(self, expected: float, agreement: float) -> _Outcome | None:
        """Return that it has converged where the next step can be foretold to be too short to matter.

        The expected decrease of full Newton steps is squared, but for a factor, by each of them.
        """
        before = self.schedule
        following = expected**3 / before.expected**2 if before.full else np.inf
        if abs(agreement - 1.0) < _RIGHT and following <= _FORETOLD * self._goal():
            return _Outcome(Status.CONVERGED, expected=following)
        return None

    # ---- Steps ----------------------------------------------------------------------------------

    def _search(self, direction: D, first: float | None = None) -> Step[I]:
        if first is None:
            first = min(1.0, _LONGER * self.schedule.length)
            if direction.method == self.schedule.method:
                first = max(first, self.schedule.reach)
            first = self.problem.first_step(direction, first)
        backtracks = self.settings.max_backtracks
        name = direction.method
        if name != "steepest" and self.settings.method in ("auto", "newton"):
            # Another direction takes over, so very short steps are not worth their roll-outs.
            most = _BACKTRACKS.get(name.removesuffix("-damped"), _BACKTRACKS_SHIFTED)
            backtracks = min(backtracks, most)
        problem = self.problem
        with problem.clock("rollout"):
            step = self.line_search(
                lambda length, bound: problem.simulate(direction, length, bound),
                value=problem.value,
                noise=problem.noise,
                slope=direction.slope,
                bend=direction.bend,
                max_backtracks=backtracks,
                first=first,
            )
        self.searched += step.rollouts
        return step

    def _accept(self, direction: D, step: Step[I], trial: Trial[I], note: str) -> _Outcome | None:
        problem = self.problem
        decrease, expected = problem.value - trial.cost, -direction.slope
        agreement = decrease / max(0.5 * expected, 1e-300)
        self.still = self.still + 1 if decrease <= problem.noise else 0
        # Whether that is at a minimum or at a saddle is looked at before the next step.
        self.stalled = self.still >= problem.patience
        foretold = None
        if not self.stalled and step.length == 1.0 and direction.method == "newton":
            foretold = self._foretold(expected, agreement)
        self.schedule = self.schedule.after_step(
            direction.method, direction.curvature_scale, step.length, agreement, expected, trial.cost
        )
        problem.accept(direction, trial)
        if foretold is not None:
            problem.keep_feedback(direction)
        return self._tell(direction, step, decrease, note) or foretold

    def _tell(self, direction: D | None, step: Step[I] | None, decrease: float, note: str) -> _Outcome | None:
        """Tell the history and the callback of an iteration, or of where it all starts."""
        problem = self.problem
        x, u = problem.arrays()
        told: dict[str, Any] = {
            "iteration": self.history.iterations,
            "method": "start",
            "expected_decrease": np.nan,
            "step_length": np.nan,
            "rollouts": problem.rollouts,
            "curvature_scale": 0.0,
        }
        if direction is not None and step is not None:
            cut = None if step.refusal is None else step.refusal.step
            told = {
                "iteration": self.history.iterations + 1,
                "method": direction.method,
                "expected_decrease": -direction.slope,
                "step_length": step.length,
                "rollouts": step.rollouts,
                "curvature_scale": direction.curvature_scale,
                "shift": direction.shift,
                "cut_at": -1 if cut is None else cut,
            }
        record = IterationRecord(
            cost=problem.shown,
            decrease=decrease,
            note=note,
            worst_step=problem.worst_step,
            gap=problem.gap,
            seconds=problem.clock.seconds,
            x=x,
            u=u,
            snapshot=self._snapshot,
            **told,
        )
        self.history.add(record)
        if self.callback is not None and self.callback(record):
            return _Outcome(Status.STOPPED_BY_CALLBACK)
        return None

    def _progress(self, direction: D) -> str:
        """Return what a run that is cut off was about to do, how fast it was, and what may help."""
        if self.problem.unfinished:
            return ""
        expected, goal = -direction.slope, self._goal()
        where = self.problem.where(direction)
        parts = [f"The expected decrease is still {expected:.2g}, where {goal:.2g} is asked for"]
        parts.append(f"; most of it is that of {where}. " if where else ". ")
        costs = self.history.cost[-1 - _LOOKED_BACK :]
        fall = (costs[0] - costs[-1]) / max(abs(costs[-1]), 1e-300) if len(costs) > 1 else np.nan
        if not fall > 0.0:
            return "".join(parts).strip()
        parts.append(f"The last {len(costs) - 1} iterations lowered the cost by {fall:.2g} of itself")
        before = self.history.expected_decreases[-len(costs) + 1]
        rate = (expected / before) ** (1.0 / (len(costs) - 1))
        if rate < _FAST:
            more = int(np.ceil(np.log(goal / expected) / np.log(rate)))
            parts.append(f"; at their rate some {more} more are needed.")
        else:
            parts.append(
                "; it creeps along a flat valley. Weigh in the cost what moves there, which determines the minimum "
                f"better (a larger R for that input), take a tolerance above {expected / abs(costs[-1]):.1g}, or start "
                "elsewhere."
            )
        return "".join(parts)

    def _remarks(self) -> list[str]:
        """Return what is to be said of the stage that an iteration begins."""
        said, self.remark = [self.remark] * bool(self.remark), ""
        ease = self.problem.ease
        if ease != 1.0 and self.schedule.spent == 0:
            said.append(f"inputs are {ease:.4g} times as dear as asked for")
        return said

    def _snapshot(self) -> OptimizationResult:
        result = self._finish(_Outcome(Status.STOPPED_BY_CALLBACK))
        # The run goes on in the memory of these.
        return replace(result, K=result.K.copy(), projection_gain=result.projection_gain.copy())

    def _message(self, outcome: _Outcome) -> str:
        """Return how it ended in words; of an end that is no proper one, with the instant at which time is coarsest."""
        parts = [outcome.status.value, outcome.detail, self.problem.unfinished]
        worst = self.problem.worst_step
        if worst is not None and outcome.status in _STUCK:
            parts.append(f"Along the last iterate {worst}.")
        return " ".join(part for part in parts if part)

    def _finish(self, outcome: _Outcome) -> OptimizationResult:
        # The last feedback may still have to be computed: its time belongs to the total.
        clock = self.problem.clock
        timings = dict(clock.timings)
        result = self.problem.result(
            {
                "status": outcome.status,
                "message": self._message(outcome),
                "cost": self.problem.shown,
                "expected_decrease": outcome.expected,
                "history": self.history.build(),
                "timings": MappingProxyType(timings),
                "rollouts": self.problem.rollouts + self.searched,
                "settings": self.settings,
                "schedule": self.schedule,
                "worst_step": self.problem.worst_step,
            }
        )
        timings["total"] = clock.seconds
        return result


@dataclass(frozen=True)
class _Outcome:
    status: Status
    detail: str = ""
    expected: float = np.nan


class _Found(Exception):
    """The search for a direction has come to an end of the optimisation."""

    def __init__(self, outcome: _Outcome) -> None:
        super().__init__(outcome.detail)
        self.outcome = outcome
