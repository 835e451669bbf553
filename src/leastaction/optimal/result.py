"""What an optimisation returns, and what it tells its callback after every iteration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import restore_state, saved_state

__all__ = [
    "HistoryBuilder",
    "IterationRecord",
    "NewtonSchedule",
    "OptimizationHistory",
    "OptimizationResult",
    "Settings",
    "Status",
]


class Status(Enum):
    """How an optimisation ended; the value says what happened and what to try."""

    CONVERGED = "The expected decrease of the cost is below the tolerance."
    STALLED = (
        "The cost cannot be lowered any more in double precision, though the expected decrease is "
        "above the tolerance. Take it as converged, or loosen the tolerance."
    )
    ITERATION_LIMIT = (
        "The limit on iterations was reached. Raise max_iterations, or go on with resume=result."
    )
    STOPPED_BY_CALLBACK = "The callback asked to stop. Go on with resume=result."
    INTERRUPTED = "Interrupted from the keyboard; this is the last complete iterate. Go on with resume=result."
    LINE_SEARCH_FAILED = (
        "No step along any descent direction lowered the cost. Hold the derivatives to "
        "check_derivatives; if they are right, the system may have no next state close by "
        "(see the message): try a smaller time step or another initial trajectory."
    )
    NO_DIRECTION = (
        "No quadratic model had a minimum. Give the cost a positive definite weight on every input."
    )
    DERIVATIVES_FAILED = "The derivatives of the system could not be computed along the last iterate (see the message)."


@dataclass(frozen=True)
class Settings:
    """The settings of an optimisation; see `optimize` for their meaning."""

    method: str
    regulator: str
    max_iterations: int
    tolerance: float
    absolute_tolerance: float
    alpha: float
    beta: float
    max_backtracks: int
    chunk: int


@dataclass(frozen=True)
class IterationRecord:
    """One iteration, as the callback sees it.

    Attributes
    ----------
    iteration : int
        1 for the first step; 0 for the trajectory that the optimisation starts from.
    method : str
        The model whose direction was followed: "newton", "newton-damped" (with a part of the dynamics'
        curvature), "quasi-newton", "steepest"; "start" for iteration 0.
    cost : float
        Cost after the iteration.
    expected_decrease : float
        ``-Dg . dxi``, about twice the decrease that a quadratic model expects; NaN for iteration 0.
    step_length : float
        Of the line search, in (0, 1]; NaN for iteration 0.
    rollouts : int
        Roll-outs that were tried.
    curvature_scale : float
        The part of the dynamics' curvature in the model: 1 for Newton, 0 for quasi-Newton.
    note : str
        Why a better method was not used, if that is so; empty otherwise.
    seconds : float
        Wall time since the start.
    x, u : ndarray (N+1, nx), (N, nu)
        The iterate; a trajectory of the system.
    snapshot : callable
        Returns the result of a run that ended here, to be kept: `optimize` with ``resume`` goes on from
        it as this run does. To be called before the callback returns.
    """

    iteration: int
    method: str
    cost: float
    expected_decrease: float
    step_length: float
    rollouts: int
    curvature_scale: float
    note: str
    seconds: float
    x: Array
    u: Array
    snapshot: Callable[[], OptimizationResult] = field(repr=False, compare=False)


@dataclass(frozen=True)
class OptimizationHistory:
    """What every iteration did; entry i belongs to the step from iterate i to iterate i + 1.

    Attributes
    ----------
    cost : ndarray (iterations + 1,)
        Cost of every iterate, the first one included.
    expected_decrease, step_length, curvature_scale, seconds : ndarray (iterations,)
        As in `IterationRecord`; seconds since the start of the run that made the iteration.
    rollouts : ndarray of int (iterations,)
        As in `IterationRecord`.
    method : tuple of str (iterations,)
        As in `IterationRecord`.
    """

    cost: Array
    expected_decrease: Array
    step_length: Array
    rollouts: np.ndarray[tuple[int], np.dtype[np.int64]]
    curvature_scale: Array
    method: tuple[str, ...]
    seconds: Array


@dataclass(frozen=True)
class NewtonSchedule:
    """When the automatic choice of method tries Newton's.

    It begins with quasi-Newton, whose model holds far from the minimum too, stays with it while it
    foretells the decrease of the cost, and then tries Newton's. While that fails, it waits for ever
    more iterations until it tries again.

    Attributes
    ----------
    wait : int
        Iterations to go until Newton's method is tried.
    failures : int
        How often it failed since it last worked.
    scale : float
        The part of the curvature that is tried first: more than was good for the last step, because
        every model that turns out to have no minimum costs time.
    """

    wait: int = 1
    failures: int = 0
    scale: float = 1.0

    def after_failure(self) -> NewtonSchedule:
        """Return the schedule after a Newton direction that could not be followed."""
        # One more than the wait, for the iteration that is still to be made by another method.
        return NewtonSchedule(min(2**self.failures, 8) + 1, self.failures + 1, self.scale)

    def after_step(self, curvature_scale: float, agreement: float) -> NewtonSchedule:
        """Return the schedule after an accepted step.

        Parameters
        ----------
        curvature_scale : float
            The part of the dynamics' curvature in its model.
        agreement : float
            Decrease of the cost, relative to the decrease of the model over its full step.
        """
        if curvature_scale > 0.0:
            return NewtonSchedule(0, 0, min(1.0, 4.0 * curvature_scale))
        # A quasi-Newton model that is off by a share s of the true curvature is off by s in the
        # decrease too, and the expected decrease falls by s^2 with every step: good enough if s < 0.1.
        least = 1 if abs(agreement - 1.0) < 0.1 else 0
        return NewtonSchedule(max(self.wait - 1, least), self.failures, self.scale)


class HistoryBuilder:
    """Collects the records of the iterations, after those of an earlier run."""

    def __init__(self, earlier: OptimizationHistory | None = None) -> None:
        self.cost: list[float] = [] if earlier is None else list(earlier.cost)
        self._steps: list[tuple[float, float, int, float, str, float]] = []
        if earlier is not None:
            self._steps = list(
                zip(
                    earlier.expected_decrease.tolist(),
                    earlier.step_length.tolist(),
                    earlier.rollouts.tolist(),
                    earlier.curvature_scale.tolist(),
                    earlier.method,
                    earlier.seconds.tolist(),
                    strict=True,
                )
            )

    @property
    def iterations(self) -> int:
        """Number of iterations so far."""
        return len(self._steps)

    def add(self, record: IterationRecord) -> None:
        """Add a record; iteration 0 has a cost and nothing else."""
        self.cost.append(record.cost)
        if record.iteration == 0:
            return
        self._steps.append(
            (
                record.expected_decrease,
                record.step_length,
                record.rollouts,
                record.curvature_scale,
                record.method,
                record.seconds,
            )
        )

    def build(self) -> OptimizationHistory:
        """Return the arrays."""
        columns = list(zip(*self._steps, strict=True)) or [()] * 6
        return OptimizationHistory(
            cost=np.array(self.cost, dtype=np.float64),
            expected_decrease=np.array(columns[0], dtype=np.float64),
            step_length=np.array(columns[1], dtype=np.float64),
            rollouts=np.array(columns[2], dtype=np.int64),
            curvature_scale=np.array(columns[3], dtype=np.float64),
            method=tuple(columns[4]),
            seconds=np.array(columns[5], dtype=np.float64),
        )


@dataclass(frozen=True)
class OptimizationResult:
    """An optimised trajectory, the feedback that holds it, and how it was found.

    Attributes
    ----------
    status : Status
        How it ended.
    message : str
        The same in words, with the particulars.
    x, u : ndarray (N+1, nx), (N, nu)
        The trajectory.
    K : ndarray (N, nu, nx)
        Gains about it: ``u = u_opt - K (x - x_opt)``.
    cost : float
        Its cost.
    expected_decrease : float
        ``-Dg . dxi`` there: how far from the minimum, about twice in cost. NaN if it was not computed.
    history : OptimizationHistory
        What every iteration did; of a resumed run, from the very start.
    timings : Mapping[str, float]
        Seconds spent in "linearize", "curvature", "lq", "rollout" and in "total", in this run.
    rollouts : int
        Roll-outs tried in this run.
    settings : Settings
        Settings of this run.
    projection_gain : ndarray (N, nu, nx)
        The gains by which the trajectory was reached. Resuming needs them to go on exactly.
    schedule : NewtonSchedule
        State of the automatic choice of method. Resuming needs it too.
    """

    status: Status
    message: str
    x: Array
    u: Array
    K: Array
    cost: float
    expected_decrease: float
    history: OptimizationHistory
    timings: Mapping[str, float]
    rollouts: int
    settings: Settings
    projection_gain: Array
    schedule: NewtonSchedule

    __getstate__, __setstate__ = saved_state, restore_state

    @property
    def iterations(self) -> int:
        """Number of iterations, those of the runs resumed included."""
        return len(self.history.method)

    @property
    def success(self) -> bool:
        """Whether the trajectory is a local minimum to the accuracy asked for or possible."""
        return self.status in (Status.CONVERGED, Status.STALLED)

    def __str__(self) -> str:
        return (
            f"{self.status.name}: {self.message}\n"
            f"cost {self.cost:.10g} after {self.iterations} iterations, "
            f"{self.timings['total']:.3g} s; expected decrease {self.expected_decrease:.2e}"
        )
