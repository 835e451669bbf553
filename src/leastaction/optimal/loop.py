"""The iteration of the projection-operator optimiser, for problems in discrete and in continuous time.

The loop chooses the method of every direction, searches along it, decides when to stop, and tells of
what it does. What trajectories are made of is left to a `Problem`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.line_search import LineSearch, Step, Trial, rounding_of
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

# Less of the dynamics' curvature than this is not worth having.
_LEAST_CURVATURE = 1.0 / 128.0


class Clock:
    """Adds up the seconds spent in each part of the work."""

    def __init__(self) -> None:
        self.began = time.perf_counter()
        self.timings = dict.fromkeys(("linearize", "curvature", "lq", "rollout"), 0.0)

    @contextmanager
    def __call__(self, part: str) -> Iterator[None]:
        """Count the time inside of a ``with`` to a part."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.timings[part] += time.perf_counter() - began

    @property
    def seconds(self) -> float:
        """Seconds since the clock was made."""
        return time.perf_counter() - self.began


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
    """

    method: str
    slope: float
    curvature_scale: float


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
    patience: int = 1
    """Steps in a row that lower the cost by no more than its noise, after which it is at its minimum."""

    def __init__(self) -> None:
        self.clock = Clock()

    @property
    def noise(self) -> float:
        """What the cost may be off: steps are not refused for that much."""
        return rounding_of(self.value)

    @abstractmethod
    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, or an initial state and inputs."""

    @abstractmethod
    def resume(self, result: Any) -> None:
        """Begin where an earlier run ended."""

    @abstractmethod
    def minimise_model(self, method: str, scale: float) -> M:
        """Return the minimum of a method's quadratic model, with a part of the dynamics' curvature."""

    @abstractmethod
    def direction(self, method: str, model: M, scale: float) -> D:
        """Return the direction of a model that has a minimum."""

    @abstractmethod
    def simulate(self, direction: D, length: float, bound: float) -> Trial[I] | str:
        """Return the projection of a step along the direction, or why it is refused."""

    @abstractmethod
    def accept(self, direction: D, trial: Trial[I]) -> None:
        """Make a trial the current iterate."""

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

    Parameters
    ----------
    problem : Problem
        Standing at its first iterate.
    settings : Settings
    callback : callable or None
        Told of every iteration; a true answer ends it.
    resume : OptimizationResult or None
        The result whose history goes on.
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
                outcome = self._tell("start", None, None, "")
            while outcome is None:
                outcome = self._advance()
        except KeyboardInterrupt:
            # A solution may have been left half written; none of it belongs to the iterate.
            self.problem.forget()
            outcome = _Outcome(Status.INTERRUPTED)
        return self._finish(outcome)

    def _advance(self) -> _Outcome | None:
        """Make one iteration; the outcome if it was the last."""
        value = self.problem.value
        note = ""
        expected = np.nan
        for method in self._methods():
            try:
                direction = self._direction(method)
            except LeastActionError as error:
                return _Outcome(Status.DERIVATIVES_FAILED, str(error))
            if isinstance(direction, str):
                note = f"{method}: {direction}"
                self._note_failure(method)
                continue
            expected = -direction.slope
            goal = self.settings.tolerance * abs(value) + self.settings.absolute_tolerance
            if expected <= goal:
                return _Outcome(Status.CONVERGED, expected=expected)
            if self.history.iterations >= self.limit:
                return _Outcome(Status.ITERATION_LIMIT, expected=expected)
            step = self._search(direction)
            self.searched += step.rollouts
            if step.trial is not None:
                return self._accept(direction, step, step.trial, note)
            note = f"{direction.method}: no step was short enough, {step.failure}"
            self._note_failure(method)
        if np.isnan(expected):
            return _Outcome(Status.NO_DIRECTION, note)
        stalled = expected < max(1e-10 * abs(value), self.problem.noise)
        return _Outcome(Status.STALLED if stalled else Status.LINE_SEARCH_FAILED, note, expected)

    def _note_failure(self, method: str) -> None:
        if method == "newton":
            self.schedule = self.schedule.after_failure()

    def _methods(self) -> tuple[str, ...]:
        """Return the methods for this iteration: each replaces the one before if that fails."""
        first = self.settings.method
        if first == "auto":
            newton = self.problem.has_curvature and self.schedule.wait == 0
            first = "newton" if newton else "quasi-newton"
        return _CHAIN[_CHAIN.index(first) :]

    def _direction(self, method: str) -> D | str:
        """Return the direction of a method, or why there is none.

        Newton's model gets as much of the dynamics' curvature as leaves it a minimum.
        """
        scale = self.schedule.scale if method == "newton" else 0.0
        model = self.problem.minimise_model(method, scale)
        while not model.definite and scale > _LEAST_CURVATURE:
            scale *= 0.5
            model = self.problem.minimise_model(method, scale)
        if not model.definite:
            return f"the model has no minimum, {model.message}"
        name = f"{method}-damped" if 0.0 < scale < 1.0 else method
        return self.problem.direction(name, model, scale)

    def _search(self, direction: D) -> Step[I]:
        backtracks = self.settings.max_backtracks
        if direction.method.startswith("newton"):
            # A simpler method takes over, so very short steps are not worth their roll-outs.
            backtracks = min(backtracks, 4)
        problem = self.problem
        with problem.clock("rollout"):
            return self.line_search(
                lambda length, bound: problem.simulate(direction, length, bound),
                value=problem.value,
                noise=problem.noise,
                slope=direction.slope,
                max_backtracks=backtracks,
            )

    def _accept(self, direction: D, step: Step[I], trial: Trial[I], note: str) -> _Outcome | None:
        decrease = self.problem.value - trial.cost
        self.still = self.still + 1 if decrease <= self.problem.noise else 0
        stalled = self.still >= self.problem.patience
        agreement = decrease / (-0.5 * direction.slope)
        self.schedule = self.schedule.after_step(direction.curvature_scale, agreement)
        self.problem.accept(direction, trial)
        outcome = self._tell(direction.method, direction, step, note)
        return outcome or (_Outcome(Status.STALLED, expected=-direction.slope) if stalled else None)

    def _tell(
        self, method: str, direction: D | None, step: Step[I] | None, note: str
    ) -> _Outcome | None:
        x, u = self.problem.arrays()
        record = IterationRecord(
            iteration=self.history.iterations + (step is not None),
            method=method,
            cost=self.problem.value,
            expected_decrease=np.nan if direction is None else -direction.slope,
            step_length=np.nan if step is None else step.length,
            rollouts=self.problem.rollouts if step is None else step.rollouts,
            curvature_scale=0.0 if direction is None else direction.curvature_scale,
            note=note,
            seconds=self.problem.clock.seconds,
            x=x,
            u=u,
            snapshot=self._snapshot,
        )
        self.history.add(record)
        if self.callback is not None and self.callback(record):
            return _Outcome(Status.STOPPED_BY_CALLBACK)
        return None

    def _snapshot(self) -> OptimizationResult:
        result = self._finish(_Outcome(Status.STOPPED_BY_CALLBACK))
        # The run goes on in the memory of these.
        return replace(result, K=result.K.copy(), projection_gain=result.projection_gain.copy())

    def _finish(self, outcome: _Outcome) -> OptimizationResult:
        # The last feedback may still have to be computed: its time belongs to the total.
        clock = self.problem.clock
        timings = dict(clock.timings)
        result = self.problem.result(
            {
                "status": outcome.status,
                "message": f"{outcome.status.value} {outcome.detail}".strip(),
                "cost": self.problem.value,
                "expected_decrease": outcome.expected,
                "history": self.history.build(),
                "timings": MappingProxyType(timings),
                "rollouts": self.problem.rollouts + self.searched,
                "settings": self.settings,
                "schedule": self.schedule,
            }
        )
        timings["total"] = clock.seconds
        return result


@dataclass(frozen=True)
class _Outcome:
    status: Status
    detail: str = ""
    expected: float = np.nan
