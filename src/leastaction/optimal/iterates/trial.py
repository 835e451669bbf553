"""Trials of a search: the projection of a curve, up to where it is seen to be worth nothing."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

import numpy as np

from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.pool import empty
from leastaction.numerics.step_quality import StepQuality, coarsest
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.iterates.direction import Iterate
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.space import apart, sizes_of

SHORT = 0.1
"""Length of a step along which it is looked for leaps."""

# Changes of a trajectory, in parts of its size, that show a leap: the largest that was predicted for a short step, the
# least that it made from one instant to the next; and the largest predicted one where shorter steps leap too.
_NEAR, _FAR, _TORN = 0.02, 0.2, 1e-3

COARSE = 3.0
"""A trial is refused where the determinant ratio s of its coarsest step is above this."""
# Factor by which a step may be coarser than the coarsest along the current iterate, where that is above it.
_COARSER = 1.5


def try_projection(
    system: DiscreteSystem,
    cost: Cost,
    curve: tuple[Array, Array, Array],
    x0: Array,
    *,
    bound: float,
    worst: StepQuality | None,
    chunk: int,
    explain: Callable[[Array, Refusal], Refusal],
) -> Trial[Iterate] | Refusal:
    """Return the projection of a curve, or why it is refused.

    ``curve``: states, inputs and the gains of the projection. ``x0``: the initial state. ``bound``: of the cost.
    ``worst``: the coarsest step along the current iterate. ``chunk``: steps after each of which it is looked at.
    ``explain``: returns a better reason, if there is one, from the states up to where it ended.
    """
    xbar, ubar, gain = curve
    x, u = empty(xbar.shape), empty(ubar.shape)
    # What a cost is given cannot be written to.
    states, inputs = read_only(x), read_only(u)
    x[0] = x0
    stage_values = empty((system.N,))
    worst_here: StepQuality | None = None
    for start in range(0, system.N, chunk):
        stop = min(start + chunk, system.N)
        part = system.rollout(x[start], xbar, ubar, gain, start, stop)
        done = start + part.steps_done
        worst_here = coarsest([worst_here, part.worst_step]) if start else part.worst_step
        x[start + 1 : done + 1] = part.x[1:]
        if not part.complete:
            failed = Refusal(f"the roll-out failed: {part.failure}", done, failed=True, coarsest=worst_here)
            return explain(x[: done + 1], failed)
        if is_too_coarse(part.worst_step, worst):
            assert part.worst_at is not None
            reason = f"{system.when(part.worst_at)} would be too coarse, {part.worst_step}"
            return Refusal(reason, part.worst_at, coarsest=worst_here)
        u[start:stop] = part.u
        with np.errstate(over="ignore", invalid="ignore"):
            stage_values[start:stop] = cost.stage_values(states[start:stop], inputs[start:stop], start)
            total = float(np.add.reduce(stage_values[:stop]))
            if not isfinite(total) or (cost.nonnegative and total > bound):
                k, reason = _spent(stage_values[:stop], bound, system)
                return explain(x[: k + 1], Refusal(reason, k))
            if stop == system.N:
                total += cost.final_value(states[-1])
    # Not "total > bound": a NaN is refused.
    if not total <= bound:
        return explain(x, Refusal(f"a cost of {total:.10g}, where at most {bound:.10g} was wanted", cost=total))
    return Trial(Iterate(states, inputs, worst_here), total)


def _spent(stage_values: Array, bound: float, system: DiscreteSystem) -> tuple[int, str]:
    """Return the stage by which a cost is not finite, or past its bound, and what is to be said of it."""
    spent = np.cumsum(stage_values)
    if not np.isfinite(spent[-1]):
        k = int(np.argmin(np.isfinite(spent)))
        return k, f"the cost is not finite by {system.when(k)}"
    k = min(int(np.searchsorted(spent, bound, side="right")), len(spent) - 1)
    return k, f"the cost was past its bound by {system.when(k)}"


def is_too_coarse(worst: StepQuality | None, before: StepQuality | None) -> bool:
    """Return whether a trial comes too close to where a step has no solution any more.

    What the discrete cost gains there is none of the motion's, and from such a trajectory hardly any direction can be
    followed. ``worst``: its coarsest step. ``before``: that along the current iterate.
    """
    if worst is None:
        return False
    return worst.s > max(COARSE, _COARSER * (1.0 if before is None else before.s))


def leap(system: DiscreteSystem, now: Array, foretold: Array, x: Array, length: float) -> Refusal | None:
    """Return the refusal of a trial in which a step of time leapt to another solution; None if none did.

    Where a step that hardly moves the trajectory at all is torn away at once, shorter ones will be too: it is hopeless.
    ``now`` (N+1, nx): states of the current iterate. ``foretold``: their predicted changes. ``x``: states of the
    trial, up to where it ended. ``length``: of the step.
    """
    space, n = system.charts(), len(x)
    size = sizes_of(space, now)
    expected = np.maximum.accumulate((np.abs(foretold[:n]) / size).max(axis=1))
    moved = (np.abs(apart(space, x, now[:n])) / size).max(axis=1)
    leaps = np.flatnonzero((moved[1:] > _FAR) & (moved[:-1] < _NEAR) & (expected[1:] < _NEAR))
    if not leaps.size:
        return None
    k = int(leaps[0])
    reason = (
        f"{system.when(k)} leaps to another solution: a step of length {length:.2g} moves the trajectory there by "
        f"{moved[k + 1]:.2g} of its size, where {expected[k + 1]:.2g} was foretold. The time step is too coarse there"
    )
    return Refusal(reason, k, hopeless=bool(expected[k + 1] < _TORN))
