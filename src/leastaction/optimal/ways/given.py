"""The given curve itself, with gaps, where limits are violated at the end: its projection may be another motion.

A stationary point of the violation, such as a dead point of a mechanism, does not show that limits cannot be met. The
given curve may lead to where they are; so may, of an initial state alone, the straight line to the wanted last state.
The search begins with gaps between its steps and the inputs that the curve needs, and with a price of limits at single
instants that is so high that the gaps close without violating them; then the same among motions that the steps of time
resolve.
"""

from __future__ import annotations

from collections.abc import Iterator

from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import Status
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.state import Start
from leastaction.optimal.ways.curves import line_to, needed_inputs
from leastaction.optimal.ways.resolved import of_asked, resolved_rows

_NAME = "given"
_MOST = 300  # iterations that each attempt may take
_DEARER = 20.0  # price of violating a limit at a single instant, over that of other limits


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where a run ends with violated limits; once."""
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if outcome is None or run.resolved is not None:
        return False
    if _NAME in run.state.taken or problem.beginning.begun.curve is None or problem.settings.shooting == "single":
        return False
    return outcome.status in (*STUCK, Status.INFEASIBLE, Status.NO_DIRECTION) and problem.stages.is_unmet


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    for attempt, start in _attempts(problem):
        found = problem.found_by(attempt, (start.x, start.u))
        if found is not None and not (attempt.parts.here.is_open or attempt.stages.is_unmet):
            problem.beginning.go_on_from(found.x, found.u, of_asked(problem, found.limits))
            run.begin_again(_NAME, "began again, from the given curve as it is")
            return True
    run.take(_NAME)
    return False


def _attempts(problem: DiscreteProblem) -> Iterator[tuple[DiscreteProblem, Start]]:
    """Yield problems to be tried, and where they begin: the original one, and that among resolved motions."""
    starts = list(_starts(problem))
    for start in starts:
        yield _with_gaps(problem, []), start
    resolved = resolved_rows(problem)
    if resolved is not None:
        yield _with_gaps(problem, resolved), starts[0]


def _starts(problem: DiscreteProblem) -> Iterator[Start]:
    """Yield the given curve, with the inputs that it needs and those that were given, and the straight line."""
    given, system = problem.beginning.begun.curve, problem.parts.system
    assert given is not None
    wanted = problem.parts.asked.wanted_states
    first = given.x if given.x.ndim == 1 else given.x[0]
    line = line_to(system, first, None if wanted is None else wanted[-1], problem.parts.rows)
    x = line if given.x.ndim == 1 else given.x
    yield Start(x, needed_inputs(system, x, given.u))
    yield Start(x, given.u)
    if x is not line:
        yield Start(line, needed_inputs(system, line, given.u))


def _with_gaps(problem: DiscreteProblem, more: list[Rows]) -> DiscreteProblem:
    """Return a problem that begins with gaps, with more limits and higher prices of limits at single instants."""
    parts, settings = problem.parts, problem.settings.changed(max_iterations=_MOST)
    return DiscreteProblem(
        parts.system, parts.asked, settings, [*parts.rows, *more], parts.free_start, "at once",
        final_time=problem.beginning.final_time, dearer=_DEARER,
    )  # fmt: skip


GIVEN = Way(_NAME, _applies, _begin)
