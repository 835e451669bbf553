"""What an optimisation returns, and what its callback is called with after every iteration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from operator import attrgetter
from types import MappingProxyType
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array
from leastaction.numerics.dataset import STEP, TIME, Dataset, Savable
from leastaction.numerics.dataset.plain import plain
from leastaction.numerics.frozen import Frozen, made
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.options import Options
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.optimal.state import SearchState, from_memory
from leastaction.optimal.system import System


class Status(Enum):
    """How an optimisation ended; the value says what happened and what to try."""

    CONVERGED = "The expected decrease of the cost is below the tolerance."
    RESOLVED = (
        "A minimum among the motions that the steps of time resolve: the cost falls on towards others, which they "
        "cannot follow (see the message)."
    )
    STALLED = (
        "The cost cannot be lowered any more in double precision, though the expected decrease is "
        "above the tolerance. Take it as converged, or loosen the tolerance."
    )
    ITERATION_LIMIT = "The limit on iterations was reached. Raise max_iterations, or go on with resume=result."
    STOPPED_BY_CALLBACK = "The callback asked to stop. Go on with resume=result."
    INTERRUPTED = "Interrupted from the keyboard; this is the last complete iterate. Go on with resume=result."
    LINE_SEARCH_FAILED = (
        "No step along any descent direction lowered the cost. Hold the derivatives to "
        "check_derivatives; if they are right, the system may have no next state close by "
        "(see the message): try a smaller time step or another initial trajectory."
    )
    SADDLE = (
        "The cost does not change to first order, but it has no minimum here: it falls along a direction of "
        "negative curvature that could not be followed. Start from another trajectory (inputs that differ a "
        "little break a symmetry), or use method='auto'."
    )
    INFEASIBLE = (
        "The limits cannot all be met, or not from this start; they are violated as little as was found possible. "
        "Loosen what the message names, give the motion more time, or start elsewhere."
    )
    UNBOUNDED = (
        "The cost falls without bound: it has no minimum. Bound what it falls with, or give that a weight: an input, "
        "or an unknown with a negative price (FinalTime(max=...), Parameter(name, min, max))."
    )
    NO_DIRECTION = "No quadratic model had a minimum. Give the cost a positive definite weight on every input."
    DERIVATIVES_FAILED = "The derivatives of the system could not be computed along the last iterate (see the message)."


@public
@dataclass(frozen=True)
class IterationRecord:
    """One iteration, as the callback sees it.

    Attributes
    ----------
    iteration : int
        1 for the first step; 0 for the trajectory that the optimisation starts from.
    method : str
        The model whose direction was followed: "newton", "newton-damped" (with a part of the dynamics'
        curvature), "quasi-newton", "steepest"; "-shifted" behind it, where weights were added to the model
        (Levenberg-Marquardt); "negative-curvature" for the way down from a saddle; "start" for iteration 0.
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
    decrease : float
        By how much the cost fell. Half of the expected decrease is what a quadratic model promises for a
        full step. NaN for iteration 0.
    shift : float
        What was added to the weights of all deviations, in units of their mean; 0 where that was not needed.
    cut_at : int
        The step of time at which the last trial that was refused ended; -1 if none was, or if its cost was known
        only at the end.
    worst_step : StepQuality or None
        The coarsest step of time along the iterate; None where the system does not know.
    gap : float
        Of multiple shooting: the largest gap between the end of a step and the next state, in parts of the states'
        sizes; 0 of a trajectory.
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
    decrease: float = np.nan
    shift: float = 0.0
    cut_at: int = -1
    worst_step: StepQuality | None = None
    gap: float = 0.0

    @property
    def worst_s(self) -> float:
        """Determinant ratio of the coarsest step of time (see `StepQuality`); NaN where it is not known."""
        return np.nan if self.worst_step is None else self.worst_step.s

    @property
    def worst_t(self) -> float:
        """When the coarsest step of time begins (s); NaN where it is not known."""
        return np.nan if self.worst_step is None else self.worst_step.t


@public
@dataclass(frozen=True)
class OptimizationHistory:
    """What every iteration did; entry i belongs to the step from iterate i to iterate i + 1.

    Attributes
    ----------
    cost : ndarray (iterations + 1,)
        Cost of every iterate, the first one included.
    expected_decrease, decrease, step_length, curvature_scale, shift, seconds : ndarray (iterations,)
        As in `IterationRecord`; seconds since the start of the run that made the iteration.
    rollouts, cut_at : ndarray of int (iterations,)
        As in `IterationRecord`.
    method : tuple of str (iterations,)
        As in `IterationRecord`.
    worst_s, worst_t : ndarray (iterations,)
        Of the coarsest step of time along the iterate after the iteration: its determinant ratio, and when it begins
        (s). NaN where the system does not know.
    gap : ndarray (iterations,)
        As in `IterationRecord`.
    """

    cost: Array
    expected_decrease: Array
    decrease: Array
    step_length: Array
    rollouts: np.ndarray[tuple[int], np.dtype[np.int64]]
    curvature_scale: Array
    shift: Array
    cut_at: np.ndarray[tuple[int], np.dtype[np.int64]]
    method: tuple[str, ...]
    seconds: Array
    worst_s: Array = field(default_factory=lambda: np.empty(0))
    worst_t: Array = field(default_factory=lambda: np.empty(0))
    gap: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        # Files of before these were known.
        for name, unknown in (("worst_s", np.nan), ("worst_t", np.nan), ("gap", 0.0)):
            if len(getattr(self, name)) == 0 < len(self.method):
                object.__setattr__(self, name, np.full(len(self.method), unknown))


_COUNTS = ("rollouts", "cut_at")
_NUMBERS = (*_COUNTS, *(f.name for f in fields(OptimizationHistory) if f.name not in ("cost", "method", *_COUNTS)))
_numbers_of = attrgetter(*_NUMBERS)


class HistoryBuilder:
    """Collects the records of the iterations, after those of an earlier run.

    ``cost``: of every iterate. ``iterations``: how many there were so far.
    """

    def __init__(self, earlier: OptimizationHistory | None = None) -> None:
        self.cost: list[float] = []
        self.iterations = 0
        self._method: list[str] = []
        self._numbers: list[tuple[float, ...]] = []
        if earlier is not None:
            self.cost, self._method = earlier.cost.tolist(), list(earlier.method)
            self.iterations = len(self._method)
            self._numbers = list(zip(*(each.tolist() for each in _numbers_of(earlier)), strict=True))

    @property
    def step_lengths(self) -> list[float]:
        """Lengths of the steps so far."""
        return self._column("step_length")

    @property
    def expected_decreases(self) -> list[float]:
        """Expected decreases of the steps so far."""
        return self._column("expected_decrease")

    def add(self, record: IterationRecord) -> None:
        """Add a record; iteration 0 has a cost and nothing else."""
        self.cost.append(record.cost)
        if record.iteration > 0:
            self.iterations += 1
            self._method.append(record.method)
            self._numbers.append(_numbers_of(record))

    def build(self) -> OptimizationHistory:
        """Return the arrays: parts of one of all numbers, and of one of all counts."""
        numbers = np.array(self._numbers, dtype=np.float64).reshape(-1, len(_NUMBERS)).T.copy()
        columns = dict(zip(_NUMBERS, numbers, strict=True))
        columns.update(zip(_COUNTS, numbers[: len(_COUNTS)].astype(np.int64), strict=True))
        return made(OptimizationHistory, cost=np.array(self.cost), method=tuple(self._method), **columns)

    def _column(self, name: str) -> list[float]:
        at = _NUMBERS.index(name)
        return [row[at] for row in self._numbers]


@public
@dataclass(frozen=True)
class OptimizationResult(Frozen, Savable):
    """An optimised trajectory, the feedback that holds it, and how it was found.

    Frozen, so any number of threads may share it; so may runs that go on from it.

    Attributes
    ----------
    status : Status
        How it ended.
    message : str
        The same in words, with the particulars.
    x, u : ndarray (N+1, nx), (N, nu)
        The trajectory.
    K : ndarray (N, nu, nx)
        Gains about it: ``u = u_opt - K (x - x_opt)``; where rotations are quaternions, (N, nu, ndx) and with
        ``system.difference(x, x_opt)``.
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
    settings : Options
        Settings of this run.
    projection_gain : ndarray (N, nu, nx)
        The gains by which the trajectory was reached. Resuming needs them to go on exactly. With unknowns they are by
        those too, and with a `Periodic` limit by entries of the first state.
    schedule : NewtonSchedule
        State of the automatic choice of method. Resuming needs it too.
    limits : LimitReport or None
        Duals and room of the limits; None of an optimisation without.
    worst_step : StepQuality or None
        The coarsest step of time along the trajectory; None where the system does not know.
    gap : float
        The largest gap that multiple shooting left, in parts of the states' sizes. Above 0 it ended too early, and
        (x, u) is no trajectory yet.
    unknowns : Mapping[str, float]
        What was found beside the inputs, by name. The trajectory is one of ``system.with_parameters(result.unknowns)``.
    state : SearchState or None
        What resuming needs besides of the parts of a search; None of a result that was made elsewhere.
    t : ndarray (N+1,)
        Times of the states (s); their indices, of a system that knows no time.
    state_names, input_names : tuple of str
        Names of the columns of `x` and of `u`, by which ``result["elbow"]`` finds them.
    system : System or None
        What `System.told` returned, for the `trajectory` of a mechanism; None of a system of anything else.
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
    settings: Options
    projection_gain: Array
    schedule: NewtonSchedule
    limits: LimitReport | None = field(default=None, kw_only=True)
    worst_step: StepQuality | None = field(default=None, kw_only=True)
    gap: float = field(default=0.0, kw_only=True)
    unknowns: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}), kw_only=True)
    state: SearchState | None = field(default=None, kw_only=True, metadata={"earlier": ("memory", from_memory)})
    t: Array = field(default_factory=lambda: np.empty(0), kw_only=True)
    state_names: tuple[str, ...] = field(default=(), kw_only=True)
    input_names: tuple[str, ...] = field(default=(), kw_only=True)
    system: System | None = field(default=None, kw_only=True, repr=False, compare=False, metadata={"recorded": False})

    def __post_init__(self) -> None:
        # Of systems without, and files of before they were known.
        if len(self.t) == 0:
            object.__setattr__(self, "t", np.arange(len(self.x), dtype=np.float64))
        for name, letter, values in (("state_names", "x", self.x), ("input_names", "u", self.u)):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, tuple(f"{letter}[{i}]" for i in range(values.shape[-1])))
        for name in ("timings", "unknowns"):
            if isinstance(getattr(self, name), dict):
                object.__setattr__(self, name, MappingProxyType(getattr(self, name)))
        super().__post_init__()

    @property
    def trajectory(self) -> Any:
        """The trajectory of the mechanism that was steered, with what it knows by name and its multipliers.

        Returns
        -------
        Trajectory or ContinuousTrajectory
            In the system's kind of time.

        Raises
        ------
        ArgumentError
            Where the system is of no mechanism, or multiple shooting left gaps between the steps.
        """
        if self.system is None:
            raise ArgumentError(
                "result.trajectory: the result knows no mechanism: its system is of none, or makes steps of its own, "
                "or it was saved by an older leastaction. Take x, u and t, or system.trajectory(x, u) of a "
                "MidpointSystem"
            )
        if self.gap > 0.0:
            raise ArgumentError(
                f"result.trajectory: the run ended with gaps between its steps, of {self.gap:.2g} in parts of the "
                "states' sizes, so (x, u) is no motion. Go on with resume=result"
            )
        return self.system.motion(self)

    def __getitem__(self, name: str) -> Array:
        """Return a state, an input or, of a mechanism, a multiplier over time by name.

        ``name``: one of `state_names`, such as "elbow" or "p_elbow", of `input_names`, or of what `trajectory` knows
        beside them, the mechanism's constraints. What is prescribed has one name as state and input: its states are
        returned. Raises `ArgumentError` for an unknown name.
        """
        for names, values in ((self.state_names, self.x), (self.input_names, self.u)):
            if name in names:
                return values[:, names.index(name)]
        if self.system is not None and self.gap == 0.0:
            found: Array = self.trajectory[name]
            return found
        known = (*self.state_names, *self.input_names)
        raise ArgumentError(f"unknown name {name!r}; {closest(name, known, what='states and inputs')}")

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the columns of `x`, such as "rad"; "" where none is known."""
        return ("",) * len(self.state_names) if self.system is None else self.system.state_units

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the columns of `u`, likewise."""
        return ("",) * len(self.input_names) if self.system is None else self.system.input_units

    def dataset(self) -> Dataset:
        found = self.own_dataset()
        return dataset_of(self, self, steps=STEP) if found is None else found

    def own_dataset(self) -> Dataset | None:
        """Return the same of a result that has more than a file holds of its fields."""

    @property
    def iterations(self) -> int:
        """Number of iterations, those of the runs resumed included."""
        return len(self.history.method)

    @property
    def success(self) -> bool:
        """Whether the trajectory is a local minimum to the wanted accuracy, or to the best possible.

        Of `Status.RESOLVED` among the motions that the steps of time resolve.
        """
        return self.status in (Status.CONVERGED, Status.STALLED, Status.RESOLVED)

    def __str__(self) -> str:
        lines = [
            f"{self.status.name}: {self.message}",
            f"cost {self.cost:.10g} after {self.iterations} iterations, "
            f"{self.timings['total']:.3g} s; expected decrease {self.expected_decrease:.2e}",
        ]
        if self.unknowns:
            lines.append(", ".join(f"{name} {value:.8g}" for name, value in self.unknowns.items()))
        if self.worst_step is not None:
            lines.append(str(self.worst_step))
        return "\n".join(lines)


def dataset_of(result: OptimizationResult, content: object, *, steps: str, prefix: str = "") -> Dataset:
    """Return a result as plain data.

    ``content``: the dataclass whose fields a file holds, where the fields that all results have begin with ``prefix``.
    ``steps``: the dimension of what has a row for each input.
    """
    arrays: dict[str, Any] = {}
    rest = plain(content, arrays)
    names = {"state": result.state_names, "input": result.input_names}
    units = {"x": result.state_units, "u": result.input_units}
    dims = {"x": (TIME, "state"), "u": (steps, "input"), "K": (steps, "input", "state")}
    history = {f"history.{each}": ("iteration",) for each in vars(result.history) if each != "method"}
    dims |= {**history, "history.cost": ("iterate",)}
    about = None if result.system is None else result.system.dataset(result)
    if about is not None:
        arrays |= about.arrays
    own = {f"{prefix}{name}": each for name, each in dims.items() if f"{prefix}{name}" in arrays}
    return Dataset(
        kind=type(content).__name__,
        t=result.t,
        arrays=arrays,
        dims={"t": (TIME,), **own, **(about.dims if about else {})},
        labels={**names, **(about.labels if about else {})},
        units={"t": "s", **{f"{prefix}{name}": each for name, each in units.items()}, **(about.units if about else {})},
        content=rest,
        system=about.system if about else {},
        model=about.model if about else None,
    )
