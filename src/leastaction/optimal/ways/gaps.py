"""Multiple shooting: gaps between the steps, from the start that was given.

Where limits would be said not to be met, that is no more than a stationary point of the violation, such as a dead point
of a mechanism, or the foot of a hill. Prices may have been too low: a first state that is free may leave its bounds if
the cost falls by more elsewhere. A motion whose final time is free may have shrunk to nothing, where no input moves
anything. And the given curve may lead to where limits are met, where its projection is another motion; so may, of an
initial state alone, the straight line to the wanted last state. So the given start is tried once more, where what is
asked at a single instant is dearer; then lasting longer; then with gaps, with the inputs that the curve needs or those
that were given; then among motions that the steps of time resolve. Whatever meets the limits is gone on from.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from leastaction.numerics.arrays import read_only
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.loop.ending import STUCK, Outcome
from leastaction.optimal.loop.run import FIRST_STEPS, Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.result import Status
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.state import Start
from leastaction.optimal.ways.curves import line_to, needed_inputs
from leastaction.optimal.ways.resolved import of_asked, resolved_rows

_UNMET = "gaps for unmet limits"  # its name among the ways that were taken
_MOST = 300  # iterations that each attempt for unmet limits may take
# Factors by which a motion lasts longer in an attempt, where its final time is found too; all of them are tried where
# that has shrunk to less than a part of the given one, else the first.
_LONGER, _SHRUNK = (10.0, 100.0, 1000.0), 0.1
_DEARER = 20.0  # price of violating a limit at a single instant in these attempts, over that before
_LONG, _LONG_IF_LOST = 200, 100  # iterations after which a run is long; within limits, from a curve that was lost
_BRIEF = 40  # most iterations with gaps where most of the first steps had to be shortened: other ways are left


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where first steps had to be shortened, where a run is long, where it ends and gaps are preferred, or unmet."""
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if _is_unmet(run, outcome):
        return True
    if outcome is not None:
        begun = problem.beginning
        within_limits = problem.parts.barrier is not None and begun.final_time is None
        return outcome.status in STUCK and within_limits and begun.begun.given is not None
    # Steps that barriers shorten are no sign of a violent motion.
    if run.history.iterations == FIRST_STEPS:
        return run.began_with_short_steps and problem.parts.barrier is None
    return _is_long(run, problem) and not (run.began_again or run.creeps)


def _is_long(run: Run, problem: DiscreteProblem) -> bool:
    """Whether a run over trajectories has lasted long; within limits only of a curve whose projection is lost."""
    given, within_limits = problem.beginning.begun.given, problem.parts.barrier is not None
    if given is None or problem.parts.here.is_open or problem.parts.ease != 1.0:
        return False
    if within_limits:
        return given.is_lost and run.history.iterations == _LONG_IF_LOST
    return run.history.iterations == _LONG


def _is_unmet(run: Run, outcome: Outcome | None) -> bool:
    """Whether limits would be said not to be met, and the given start has not been tried once more."""
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if outcome is None or outcome.status not in (Status.INFEASIBLE, Status.NO_DIRECTION) or run.resolved is not None:
        return False
    if _UNMET in run.state.taken or problem.settings.shooting == "single":
        return False
    return problem.stages.violates_limits and problem.beginning.begun.curve is not None


def _begin(run: Run, outcome: Outcome | None) -> bool:
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if _is_unmet(run, outcome):
        return _meet_limits(run, problem)
    brief = run.began_with_short_steps and problem.parts.barrier is None
    if not problem.beginning.begin_with_gaps(_BRIEF if brief else None):
        return False
    run.set_out(NewtonSchedule(), "began again, with gaps between the steps")
    return True


def _meet_limits(run: Run, problem: DiscreteProblem) -> bool:
    """Go on from the first attempt that meets the limits; whether there is one."""
    run.take(_UNMET)
    for attempt, start in _attempts(problem):
        found = problem.found_by(attempt, (start.x, start.u))
        if found is not None and not (attempt.parts.here.is_open or attempt.stages.violates_limits):
            problem.beginning.go_on_from(found.x, found.u, of_asked(problem, found.limits))
            run.begin_again("", "began again, from the given start, with dearer limits or gaps")
            return True
    return False


def _attempts(problem: DiscreteProblem) -> Iterator[tuple[DiscreteProblem, Start]]:
    """Yield problems to be tried, and where they begin: the original one, and that among resolved motions."""
    given, system = problem.beginning.begun.curve, problem.parts.system
    assert given is not None
    yield _dearer(problem, [], "never"), given
    last = problem.beginning.final_time
    if last is not None:
        begins, lasts = system.time(0), given.x[..., last] - system.time(0)
        shrunk = problem.parts.x[0, last] - begins < _SHRUNK * float(np.max(lasts))
        for factor in _LONGER if shrunk else _LONGER[:1]:
            longer = np.array(given.x)
            longer[..., last] = begins + factor * lasts
            yield problem.related(problem.parts.rows, max_iterations=_MOST), Start(read_only(longer), given.u)
    x, wanted = given.x, problem.parts.asked.wanted_states
    if x.ndim == 1:
        x = line_to(system, x, None if wanted is None else wanted[-1], problem.parts.rows)
    curve = Start(x, needed_inputs(system, x, given.u))
    yield _dearer(problem, [], "at once"), curve
    yield _dearer(problem, [], "at once"), Start(x, given.u)
    resolved = resolved_rows(problem)
    if resolved is not None:
        yield _dearer(problem, resolved, "at once"), curve


def _dearer(problem: DiscreteProblem, more: list[Rows], gapped: Gapped) -> DiscreteProblem:
    """Return a problem with more limits, and higher prices of limits at single instants."""
    parts = problem.parts
    assert parts.barrier is not None
    dearer = _DEARER * parts.barrier.stages.dearer
    return problem.related([*parts.rows, *more], gapped=gapped, dearer=dearer, max_iterations=_MOST)


GAPS = Way("gaps", _applies, _begin, ahead=(FIRST_STEPS, _LONG_IF_LOST, _LONG))
