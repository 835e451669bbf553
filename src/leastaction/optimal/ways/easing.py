"""Continuation in the cost: weights of inputs are much larger at first, and the motion that of least effort.

Far from any minimum, the steps of a search must be short, and lead to violent motions that the steps of time cannot
follow. With weights of inputs that are `ease` times as large, and a final weight that is divided by its root, the
minimum is close to the motion without effort, and a path of minima leads from there to that of the original cost. It is
followed in stages of ever smaller ease, each solved only as far as the next one needs. Of 23 problems of
`benchmarks.robustness` that had no minimum otherwise, 10 came to one with a smaller final weight alone, 14 with larger
weights of the inputs alone, 15 with both, and at lower costs than those found otherwise.

Within limits each stage is a search of its own, with these limits.
"""

from __future__ import annotations

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.iterates.projected import projection_of
from leastaction.optimal.loop.ending import LOST, STUCK, Outcome
from leastaction.optimal.loop.run import FIRST_STEPS, Run
from leastaction.optimal.loop.way import Way
from leastaction.optimal.search.problem import DiscreteProblem

_WITHIN = "easing among resolved motions"  # its name among the ways that were taken
_EASIEST, _STRIDE = 1e6, 10.0  # ease of the first stage, and the factor by which each stage lowers it
_LOOSE, _LONGEST = 1e-2, 20  # tolerance and most iterations of each stage within limits


def _applies(run: Run, outcome: Outcome | None) -> bool:
    """Where first steps had to be shortened, and where there is no minimum; once, and once among resolved motions."""
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    if run.resolved is not None:
        return outcome is not None and outcome.status in STUCK and _WITHIN not in run.state.taken
    if run.began_again or (problem.parts.barrier is not None and problem.beginning.final_time is not None):
        return False
    if outcome is None:
        # Steps that barriers shorten are no sign of a violent motion.
        return run.began_with_short_steps and problem.parts.barrier is None
    return outcome is LOST or outcome.status in STUCK


def _begin(run: Run, outcome: Outcome | None) -> bool:  # noqa: ARG001
    problem = run.problem
    assert isinstance(problem, DiscreteProblem)
    eased = None if problem.parts.here.is_open else problem.parts.asked.eased(_EASIEST)
    if eased is None:
        return False
    begun = _ease(problem, eased[1]) if problem.parts.barrier is None else _ease_within(problem, eased[1])
    if not begun:
        return False
    run.begin_again("easing" if run.resolved is None else _WITHIN, "began again, where searches would lead nowhere")
    return True


def _ease(problem: DiscreteProblem, inputs: Array) -> bool:
    """Begin the first stage at the motion without effort, if there is one; return whether there is."""
    parts = problem.parts
    now, ease, system = parts.place(), parts.ease, parts.system
    eased = False
    try:
        held, no_gain = np.tile(parts.x[0], (system.N + 1, 1)), np.zeros((system.N, system.nu, system.ndx))
        start = projection_of(parts.models, held, inputs, no_gain)
        if not np.array_equal(start.x, parts.x):  # where no step was possible, none is now
            parts.set_ease(_EASIEST)
            parts.models.forget()
            parts.stand_along(start.x, start.u, start)
            eased = True
    except LeastActionError:
        pass
    finally:  # an interruption too leaves it where it stood
        if not eased:
            parts.set_ease(ease)
            parts.go_back(now)
    return eased


def _ease_within(problem: DiscreteProblem, inputs: Array) -> bool:
    """Begin at the end of stages of ever smaller ease within the limits; return whether there is such a motion."""
    x, u, ease = problem.parts.x[0], inputs, _EASIEST
    while ease > 1.0:
        stage = problem.parts.asked.eased(ease)
        assert stage is not None
        other = problem.related(problem.parts.rows, stage[0], max_iterations=_LONGEST, tolerance=_LOOSE)
        found = problem.found_by(other, (x, u))
        if found is None:
            return False
        x, u, ease = found.x, found.u, ease / _STRIDE
    return problem.beginning.begin_at(x, u)


EASING = Way("easing", _applies, _begin, ahead=(FIRST_STEPS,))
