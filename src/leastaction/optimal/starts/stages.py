"""What searches for a first trajectory report: a record of every stage, a table of them, and how the search ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError, brief
from leastaction.numerics.arrays import Array, as_count, as_number
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limits.limit import checked_limits
from leastaction.optimal.limits.rows import check_agreement
from leastaction.optimal.options import check_settings
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.table import PrintedTable
from leastaction.optimal.unknowns.periodic import Periodic


class StartStatus(Enum):
    """How the search for a start ended; the value says what happened and what to try."""

    COMPLETED = "Every stage was made."
    GAVE_UP = (
        "A stage failed, and so did smaller ones; this is the last trajectory that was found (see the message). Go on "
        "from it with other settings, or begin with an easier problem."
    )
    STAGE_LIMIT = "The limit on stages was reached. Raise max_stages, or go on with resume=result."
    STOPPED_BY_CALLBACK = "The callback asked to stop. Go on from here."
    INTERRUPTED = "Interrupted from the keyboard; this is what the last complete stage found. Go on from here."


@public
@dataclass(frozen=True)
class StageRecord:
    """One stage, as the callback sees it. Nothing in it changes: threads may share it.

    Attributes
    ----------
    stage : int
        1 for the first.
    name : str
        What was solved, in words: ``"gravity = 0.5"``, ``"steps 20 to 60"``.
    value : float
        Of the parameter that changes from stage to stage.
    accepted : bool
        Whether the next stage starts from this one.
    status : str
        Name of the optimisation's `Status`, or of the error that it raised.
    iterations : int
        Of the optimisation.
    cost : float
        Where it ended, in the cost of this stage; NaN if it raised an error.
    seconds : float
        Wall time since the start.
    note : str
        What else there is to say; the message of an error.
    """

    stage: int
    name: str
    value: float
    accepted: bool
    status: str
    iterations: int
    cost: float
    seconds: float
    note: str = ""


StageCallback = Callable[[StageRecord], object]


@public
@dataclass(frozen=True)
class StartResult(Frozen):
    """A trajectory to start from, and how it was found. Frozen: threads may share it.

    Attributes
    ----------
    status : StartStatus
        How the search ended.
    message : str
        The same in words, with the particulars.
    x, u : ndarray (N+1, nx), (N, nu)
        The trajectory. Of a search that gave up, that of the last stage that was accepted, of which the steps may be
        fewer, or the problem an easier one.
    cost : float
        Its cost, in the problem that it belongs to.
    value : float
        Of the parameter, at the last stage that was accepted.
    result : OptimizationResult or None
        Of that stage, if it holds the whole trajectory.
    stages : tuple of StageRecord
        What every stage did.
    """

    status: StartStatus
    message: str
    x: Array = field(repr=False)
    u: Array = field(repr=False)
    cost: float
    value: float
    result: OptimizationResult | None = field(repr=False)
    stages: tuple[StageRecord, ...] = field(repr=False)

    @property
    def initial(self) -> tuple[Array, Array]:
        """The pair (x, u) that `optimize` takes."""
        return self.x, self.u

    @property
    def iterations(self) -> int:
        """Number of iterations of all stages."""
        return sum(stage.iterations for stage in self.stages)

    @property
    def success(self) -> bool:
        """Whether the last stage was reached."""
        return self.status is StartStatus.COMPLETED

    def __str__(self) -> str:
        return (
            f"{self.status.name}: {self.message}\n"
            f"cost {self.cost:.10g} after {len(self.stages)} stages with {self.iterations} iterations"
        )


def check_options(options: Mapping[str, object], of: str) -> None:
    """Complain about options of `optimize` that a search for a start chooses itself; ``of``: for what, and why."""
    for name in ("initial", "horizon"):
        if name in options:
            raise ArgumentError(f"{name}: cannot be an option for {of}")
    check_settings(options)


def check_stages(iterations: int, tolerance: float) -> None:
    """Complain about the settings of stages that are no numbers of the right kind."""
    as_count(iterations, "stage_iterations", 0)
    as_number(tolerance, "stage_tolerance", least=0.0)


def check_last_limits(system: DiscreteSystem, options: Mapping[str, Any]) -> None:
    """Complain about limits of the last stage that a system does not have, before the first stage is made.

    Raises `ArgumentError`: from the limits: unknown names, values of wrong shapes, or such as no motion can meet.
    """
    if options.get("unknowns"):
        return  # of which they may be
    first = 1 if options.get("free_start", False) is False else 0
    limits = [limit for limit in checked_limits(options.get("limits", ())) if not isinstance(limit, Periodic)]
    check_agreement([row for limit in limits for row in limit.rows(system, first)], system.when)


class StartStages:
    """Makes stages and reports them: the part that is the same in every search for a start.

    Parameters
    ----------
    callback : callable or None
        Called with the record of every stage; a true answer ends the search.
    earlier : tuple of StageRecord
        Those of a search that goes on.

    Attributes
    ----------
    records : list of StageRecord
    ended : StartStatus or None
        Why there is to be no further stage; None as long as there is no reason.
    error : LeastActionError or None
        What the last stage raised.
    """

    def __init__(self, callback: StageCallback | None, earlier: tuple[StageRecord, ...] = ()) -> None:
        self.callback = callback
        self.records = list(earlier)
        self.ended: StartStatus | None = None
        self.error: LeastActionError | None = None
        self._before = earlier[-1].seconds if earlier else 0.0
        self._began = time.perf_counter()

    def make(
        self,
        name: str,
        value: float,
        solve: Callable[[], OptimizationResult],
        *,
        accept: Callable[[OptimizationResult], bool],
        note: Callable[[OptimizationResult], str] | None = None,
    ) -> tuple[OptimizationResult | None, bool]:
        """Return what a stage found (None where it raised an error), and whether it is accepted."""
        result: OptimizationResult | None = None
        self.error = None
        try:
            result = solve()
            if not isinstance(result, OptimizationResult):
                raise ArgumentError(
                    f"solve: returned {brief(repr(result))} for {name}, expected what `optimize` returns; "
                    "is a return missing?"
                )
        except LeastActionError as error:
            self.error = error
        except KeyboardInterrupt:
            self.ended = StartStatus.INTERRUPTED
            return None, False
        if result is None:
            status, iterations, cost, said, accepted = type(self.error).__name__, 0, np.nan, str(self.error), False
        else:
            if result.status is Status.INTERRUPTED:
                self.ended = StartStatus.INTERRUPTED
            status, iterations, cost = result.status.name, result.iterations, result.cost
            accepted = self.ended is None and accept(result)
            said = note(result) if note is not None else ""
            if not accepted and not said:
                said = result.message
        seconds = self._before + time.perf_counter() - self._began
        record = StageRecord(
            len(self.records) + 1, name, float(value), accepted, status, iterations, cost, seconds, said
        )
        self.records.append(record)
        try:
            stop = self.callback is not None and self.callback(record)
        except KeyboardInterrupt:
            self.ended = StartStatus.INTERRUPTED
        else:
            if stop and self.ended is None:
                self.ended = StartStatus.STOPPED_BY_CALLBACK
        return result, accepted

    def result(
        self,
        status: StartStatus,
        x: Array,
        u: Array,
        cost: float,
        value: float,
        result: OptimizationResult | None,
        detail: str = "",
    ) -> StartResult:
        """Return what was found."""
        message = f"{status.value} {detail}".strip()
        return StartResult(status, message, x, u, cost, value, result, tuple(self.records))


_COLUMNS = (
    ("stage", 5),
    ("", 28),
    ("status", 18),
    ("iterations", 10),
    ("cost", 16),
    ("seconds", 8),
)


@public
class StageTable(PrintedTable):
    """Prints the stages of a search as they happen; give it as the callback, one for each search.

    On a terminal it is in colour. Threads do not share it.

    Parameters
    ----------
    file : text stream, optional
        Where to; the standard output if left out.
    then : callable, optional
        Another callback to call after printing; its answer is passed on.
    """

    columns = _COLUMNS

    def __call__(self, record: StageRecord) -> object:
        """Print one line; return the answer of the callback behind."""
        cells = (
            str(record.stage),
            record.name,
            record.status,
            str(record.iterations),
            "" if np.isnan(record.cost) else f"{record.cost:.9e}",
            f"{record.seconds:.2f}",
        )
        return self.tell(record, cells, "" if record.accepted else "yellow")
