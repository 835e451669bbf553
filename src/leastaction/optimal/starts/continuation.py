"""Continuation: from a problem that is easy to the wanted one, by as many problems between them as it takes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_choice, as_count, as_number
from leastaction.numerics.public import public
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.starts.stages import StageCallback, StartResult, StartStages, StartStatus

Solve = Callable[[float, OptimizationResult | None], OptimizationResult]
Scale = Literal["linear", "log"]


@public
def continuation(
    solve: Solve,
    values: ArrayLike,
    *,
    scale: Scale = "linear",
    name: str = "parameter",
    accept: Callable[[OptimizationResult], bool] | None = None,
    done: Callable[[OptimizationResult], bool] | None = None,
    note: Callable[[OptimizationResult], str] | None = None,
    easy: int = 10,
    least_step: float = 1.0 / 64.0,
    max_stages: int = 100,
    resume: StartResult | None = None,
    callback: StageCallback | None = None,
) -> StartResult:
    """Solve a family of problems from an easy one to the wanted one, each from the solution of the one before.

    The values given are a guess of the stages that are needed, no schedule: a stage that fails is tried again with half
    the step from the last good value, and after one that was easy the step is doubled. So two values, the first and the
    last, are enough.

    Parameters
    ----------
    solve : callable
        ``solve(value, earlier) -> OptimizationResult`` solves the problem at a value of the parameter; `earlier` is the
        result of the last stage that was accepted, None at the first. A `LeastActionError` says that it failed.
    values : array_like (n,)
        Values of the parameter, increasing or decreasing: of a problem that is easy first, of the wanted one last.
    scale : {"linear", "log"}
        How the values between two given ones are spaced; "log" for prices and weights.
    name : str
        What the parameter is called, in records and messages.
    accept : callable, optional
        Whether the next stage may start from a result; whether it was a success if left out.
    done : callable, optional
        Whether an accepted result is good enough to end with, before the last value is reached.
    note : callable, optional
        What to say of a result in its record.
    easy : int
        Iterations up to which a stage was easy.
    least_step : float
        The least step, in parts of one from a given value to the next; where a stage fails with less, the search ends.
    max_stages : int
        Limit on the stages of this run.
    resume : StartResult, optional
        Go on from where an earlier search with these values ended.
    callback : callable, optional
        Called with a `StageRecord` after every stage; a true answer ends the search. `StageTable` is one.

    Returns
    -------
    StartResult
        `value` is what was reached, `result` the solution there. Ctrl-C, and a stage that cannot be made, end with the
        last result that was accepted. If the first problem already fails, its result comes back, with
        `StartStatus.GAVE_UP`.

    Raises
    ------
    ArgumentError
        Values that are not monotone, other arguments out of range; or from `solve`, where the first problem raises it
        (as any other `LeastActionError`): nothing was found then.

    Notes
    -----
    The adaptive step is that of E. L. Allgower and K. Georg, Numerical Continuation Methods (1990), section 6.1, with
    the last solution as the predictor.
    """
    path = _path(values, scale)
    for what, function in (("solve", solve), ("accept", accept), ("done", done), ("note", note)):
        if function is not None and not callable(function):
            raise ArgumentError(f"{what}: got {type(function).__name__}, expected a function")
    easy, limit = as_count(easy, "easy", 0), as_count(max_stages, "max_stages", 1)
    least = as_number(least_step, "least_step", above=0.0, below=1.0)
    accept = accept or (lambda result: result.success)
    last = len(path) - 1.0
    stages = StartStages(callback, () if resume is None else resume.stages)

    def at(position: float) -> float:
        between = float(np.interp(position, np.arange(len(path)), path))
        return float(np.exp(between)) if scale == "log" else between

    best: OptimizationResult | None = None
    # Positions count the values given: 1.5 is half way from the second to the third.
    reached, step, target = -1.0, 1.0, 0.0
    if resume is not None:
        best = resume.result
        reached = _position(path, resume.value, scale)
        target = min(reached + step, last)
        if best is None or target == reached:
            return resume

    def end(status: StartStatus, result: OptimizationResult, value: float, detail: str = "") -> StartResult:
        return stages.result(status, result.x, result.u, result.cost, value, result, detail)

    for _ in range(limit):
        value = at(target)
        earlier = best
        result, accepted = stages.make(
            f"{name} = {value:.6g}", value, partial(solve, value, earlier), accept=accept, note=note
        )
        if result is not None and (accepted or best is None):
            best, found = result, value
            if accepted:
                reached = target
        if best is None:
            if stages.error is None:
                raise KeyboardInterrupt
            raise stages.error
        if stages.ended is not None:
            return end(stages.ended, best, at(max(reached, 0.0)))
        if accepted:
            assert result is not None
            if reached == last or (done is not None and done(result)):
                return end(StartStatus.COMPLETED, result, value)
            if result.iterations <= easy:
                step *= 2.0
        elif reached < 0.0:
            return end(StartStatus.GAVE_UP, best, found, f"The first problem was not solved: {best.message}")
        else:
            step = 0.5 * (target - reached)
            if step < least:
                why = str(stages.error) if result is None else result.message
                detail = f"At {name} = {at(reached):.6g}, not even {value:.6g} could be reached: {why}"
                return end(StartStatus.GAVE_UP, best, at(reached), detail)
        target = min(reached + step, last)
    assert best is not None
    return end(StartStatus.STAGE_LIMIT, best, at(max(reached, 0.0)))


def _path(values: ArrayLike, scale: str) -> Array:
    """Return the values, checked, as the scale counts them."""
    given = as_array(values, "values", (None,))
    as_choice(scale, "scale", get_args(Scale))
    steps = np.diff(given)
    if len(given) < 2 or not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise ArgumentError(
            f"values: got {given.tolist()}, expected at least two numbers that increase, or decrease, all the way"
        )
    if scale == "log":
        if given.min() <= 0.0:
            raise ArgumentError(f"values: got {given.min():g}, expected positive numbers for scale='log'")
        return np.log(given)
    return given


def _position(path: Array, value: float, scale: str) -> float:
    """Return where a value stands among those given."""
    at = np.log(value) if scale == "log" and value > 0.0 else value
    order = 1 if path[-1] > path[0] else -1
    return float(np.interp(at, path[::order], np.arange(len(path), dtype=np.float64)[::order]))
