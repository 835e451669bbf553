"""Coarse to fine: the same problem with ever shorter time steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_count, as_times
from leastaction.numerics.public import public
from leastaction.optimal.discrete.charts import states_between
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.initial import pair_of
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.space import StateSpace
from leastaction.optimal.starts.stages import StageCallback, StartResult, StartStages, StartStatus, check_options

Build = Callable[[Array], tuple[Any, Any]]
Transfer = Callable[[OptimizationResult, Any, Any], tuple[Array, Array]]


@public
def coarse_to_fine(
    build: Build,
    t: ArrayLike,
    *,
    initial: tuple[ArrayLike, ArrayLike],
    factors: Sequence[int] = (8, 4, 2, 1),
    transfer: Transfer | None = None,
    resume: StartResult | None = None,
    callback: StageCallback | None = None,
    **options: Any,
) -> StartResult:
    """Optimise with long time steps first, and take what was found as the start with shorter ones.

    Most iterations are then made where they cost least, and long steps pass over valleys that are only there for
    short ones.

    Parameters
    ----------
    build : callable
        ``build(t) -> (system, cost)`` makes the problem over times t (n+1,): a `DiscreteSystem` of n steps and its
        `Cost`. Weights of the stages should go with the time step, so that the problems are alike.
    t : array_like (N+1,)
        The fine times (s).
    initial : (x, u)
        Where to start: x (nx,) the initial state or (N+1, nx) a curve, u (N, nu), at the fine times.
    factors : sequence of int
        How many fine steps a coarse one takes, decreasing to 1. Times are every so many of the fine ones, and the last.
    transfer : callable, optional
        ``transfer(result, coarse, fine) -> (x, u)`` brings a result from one system to the next; `resample` if left
        out. For a `MidpointSystem` use `leastaction.systems.warm_start`, which keeps to its constraints.
    resume : StartResult, optional
        Go on from the last stage of an earlier search with these times.
    callback : callable, optional
        Called with a `StageRecord` after every stage, whose value is its factor; a true answer ends the search.
    **options
        Of `optimize`, for every stage.

    Returns
    -------
    StartResult
        `result` is that of the finest steps that could be taken, `value` its factor. A stage that cannot be begun is
        left out; if it is the finest, the search gives up, with the finest before it. Ctrl-C keeps the last stage.

    Raises
    ------
    ArgumentError
        Wrong shapes, factors that do not decrease to 1; or from `optimize`, where no stage can be begun.

    Notes
    -----
    Nested iteration, as of multigrid methods (W. Hackbusch, Multi-Grid Methods and Applications, 1985, chapter 5).
    """
    times = as_times(t)
    N = len(times) - 1
    levels = [as_count(factor, "factors", 1) for factor in factors]
    if not levels or levels[-1] != 1 or any(a <= b for a, b in pairwise(levels)) or levels[0] > N:
        raise ArgumentError(f"factors: got {list(factors)}, expected whole numbers that decrease from at most {N} to 1")
    given, inputs = pair_of(initial)
    u = as_array(inputs, "initial u", (N, None), meaning="(N, nu)")
    nx = np.shape(given)[-1] if np.ndim(given) else 1
    x = as_array(given, "initial x", (N + 1, nx), (nx,), meaning="(N+1, nx) or an initial state (nx,)")
    check_options(options, "the stages, each starts from the one before")
    stages = StartStages(callback, () if resume is None else resume.stages)
    best: OptimizationResult | None = None
    before: tuple[DiscreteSystem, Array] | None = None
    reached = levels[0]
    if resume is not None:
        best, reached = resume.result, as_count(int(resume.value), "resume.value", 1)
        coarse = times[_every(reached, N)]
        before = _built(build, coarse)[0], coarse
        levels = [factor for factor in levels if factor < reached]
        if best is None or len(best.u) != len(coarse) - 1:
            raise ArgumentError(
                f"resume: got {len(resume.u)} steps, expected the {len(coarse) - 1} of factor {reached}"
            )
    for factor in levels:
        at = _every(factor, N)
        coarse = times[at]
        system, cost = _built(build, coarse)
        if best is None or before is None:
            begin = partial(_on, x, u, times, at)
        elif transfer is None:
            begin = partial(resample, best.x, best.u, before[1], coarse, space=system.charts())
        else:
            begin = partial(transfer, best, before[0], system)
        result, _ = stages.make(
            f"{len(at) - 1} steps",
            factor,
            partial(_solve, system, cost, begin, options),
            accept=lambda _: True,
            note=lambda r: "" if r.success else r.message,
        )
        if result is not None:
            best, before, reached = result, (system, coarse), factor
        if stages.ended is not None:
            break
    if best is None:
        if stages.error is not None:
            raise stages.error
        raise KeyboardInterrupt
    status, detail = StartStatus.COMPLETED, ""
    if stages.ended is not None and reached > 1:
        status = stages.ended
    elif reached > 1:
        status, detail = StartStatus.GAVE_UP, f"No start was found with the finest steps: {stages.error}"
    return stages.result(status, best.x, best.u, best.cost, reached, best, detail)


@public
def resample(
    x: ArrayLike, u: ArrayLike, t: ArrayLike, times: ArrayLike, *, space: StateSpace | None = None
) -> tuple[Array, Array]:
    """Return states and inputs at other times.

    Parameters
    ----------
    x, u : array_like (n+1, nx), (n, nu)
        States at the instants t, inputs held over the steps between them.
    t, times : array_like (n+1,), (N+1,)
        The given times and the wanted ones (s).
    space : StateSpace, optional
        How states differ, where they are no plain vectors.

    Returns
    -------
    x, u : ndarray (N+1, nx), (N, nu)
        Interpolated linearly, inputs between the middles of steps; outside of the given times the first and the last
        ones. No trajectory, but close to one.

    Raises
    ------
    ArgumentError
        Wrong shapes, times that do not increase.
    """
    old, new = as_times(t), as_times(times, "times")
    n = len(old) - 1
    states = as_array(x, "x", (n + 1, None), meaning="(n+1, nx)")
    inputs = as_array(u, "u", (n, None), meaning="(n, nu)")
    middle, middles = 0.5 * (old[1:] + old[:-1]), 0.5 * (new[1:] + new[:-1])
    between = columns(states, old, new) if space is None else states_between(space, states, old, new)
    return between, columns(inputs, middle, middles)


def columns(values: Array, t: Array, times: Array) -> Array:
    """Return the columns of values (n, m) at times t (n,), interpolated linearly at others (N,)."""
    result = np.empty((len(times), values.shape[1]))
    for column, given in zip(result.T, values.T, strict=True):
        column[:] = np.interp(times, t, given)
    return result


def _every(factor: int, N: int) -> npt.NDArray[np.int64]:
    """Return every so many of the numbers 0 to N, and N."""
    return np.unique(np.append(np.arange(0, N, factor), N))


def _on(x: Array, u: Array, t: Array, at: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Return a start at the fine times t at some of them only: states there, inputs as means over the steps."""
    spent = np.vstack([np.zeros(u.shape[1]), np.cumsum(u * np.diff(t)[:, None], axis=0)])
    means = np.diff(spent[at], axis=0) / np.diff(t[at])[:, None]
    return (x if x.ndim == 1 else x[at]), means


def _solve(
    system: DiscreteSystem, cost: Cost, begin: Callable[[], tuple[Array, Array]], options: dict[str, Any]
) -> OptimizationResult:
    return optimized(system, cost, initial=begin(), **options)


def _built(build: Callable[[Array], Any], t: Array) -> tuple[DiscreteSystem, Cost]:
    """Return the problem over some times, checked."""
    made = build(t)
    if not isinstance(made, (tuple, list)) or len(made) != 2:
        raise ArgumentError(f"build: got {type(made).__name__} from it, expected a pair (system, cost)")
    system, cost = made
    if not isinstance(system, DiscreteSystem) or len(t) - 1 != system.N:
        steps = getattr(system, "N", None)
        raise ArgumentError(
            f"build: got {type(system).__name__} of {steps} steps, expected a DiscreteSystem of {len(t) - 1}"
        )
    return system, cost
