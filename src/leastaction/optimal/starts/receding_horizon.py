"""A first trajectory of the whole horizon, made window by window."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import as_array, as_count, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem, given_start
from leastaction.optimal.limits.limit import FromSecond, Limit
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.starts.stages import StageCallback, StartResult, StartStages, StartStatus, check_options
from leastaction.optimal.system import check_system


@public
def receding_horizon(
    system: DiscreteSystem,
    cost: Cost,
    *,
    initial: tuple[ArrayLike, ArrayLike],
    window: int,
    keep: int | None = None,
    cost_of: Callable[[int, int], Cost] | None = None,
    resume: StartResult | None = None,
    callback: StageCallback | None = None,
    **options: Any,
) -> StartResult:
    """Make a trajectory of the whole horizon from optima over windows of it.

    A window is optimised, its first steps are kept, and the next one begins where they end: each starts close to what
    it asks for, however far the end of the horizon is. The kept parts, one after the other, are a trajectory.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
        Over the whole horizon; a window has its part of it (`Cost.window`).
    initial : (x, u)
        x (nx,) the initial state, or (N+1, nx) a curve to be followed; u (N, nu) inputs to begin with. They need not go
        together.
    window : int
        Steps of a window.
    keep : int, optional
        Steps of it that are kept; half of them if left out.
    cost_of : callable, optional
        ``cost_of(start, stop)`` returns another cost for the steps ``start .. stop-1``, such as one whose last state
        already has the goal of the horizon's end.
    resume : StartResult, optional
        Go on from where an earlier search over the same horizon ended.
    callback : callable, optional
        Called with a `StageRecord` after every window, whose value is its first step; a true answer ends the search.
    **options
        Of `optimize`; ``max_iterations`` is 50 for a window if left out. ``limits`` hold in every window: constants and
        functions of time for all of its steps, those at the end at its end. What is free of the initial state
        (``free_start``) is so in the first window.

    Returns
    -------
    StartResult
        `value` is the number of steps that are made, all N unless the search ended early; x (value+1, nx) and
        u (value, nu). A window that cannot be begun is shortened; only where not even one step can be made from the
        given inputs, the search gives up. Windows that do not converge are kept as they are, and their records say so.

    Raises
    ------
    ArgumentError
        Wrong shapes, a window or a part to be kept that is out of range, unknown options, or ``unknowns``.

    Notes
    -----
    Receding-horizon control (J. B. Rawlings, D. Q. Mayne and M. Diehl, Model Predictive Control, 2017), run on
    the model itself.
    """
    check_system(system, (DiscreteSystem,), ("nx", "nu", "N"))
    N, nx, nu = system.N, system.nx, system.nu
    require_instance(cost, "cost", Cost)
    curve, inputs = given_start(system, initial)
    u = inputs.copy()
    follows = curve.ndim == 2
    x = curve.copy() if follows else np.tile(curve, (N + 1, 1))
    length = as_count(window, "window", 1)
    kept = as_count(max(1, length // 2) if keep is None else keep, "keep", 1)
    if kept > length:
        raise ArgumentError(f"keep: got {kept}, expected at most the steps of a window, {length}")
    check_options(options, "the windows, each begins where the last one ends")
    if options.get("unknowns"):
        raise ArgumentError(
            "unknowns: got some, expected none: each window would find values of its own, and its steps would be those "
            "of another system. Make a start with the values that the system has; `optimize` finds them from there"
        )
    options.setdefault("max_iterations", 50)
    # A window that cannot be begun is a shorter one.
    options.setdefault("shooting", "single")
    stages = StartStages(callback, () if resume is None else resume.stages)
    k = 0
    if resume is not None:
        k = len(resume.u)
        x[: k + 1] = as_array(resume.x, "resume.x", (k + 1, nx), meaning="(value+1, nx)")
        u[:k] = as_array(resume.u, "resume.u", (k, nu), meaning="(value, nu)")

    # Up to where there is a plan: its states are those of a trajectory, later ones are given or unknown.
    planned = k
    result: OptimizationResult | None = None

    limits = options.pop("limits", ())
    given_limits = [limits] if isinstance(limits, Limit) else list(limits)
    later = [FromSecond(each) if isinstance(each, Limit) else each for each in given_limits]

    def solve(start: int, stop: int) -> OptimizationResult:
        options["limits"] = given_limits if start == 0 else later
        if start > 0:
            options["free_start"] = False  # it is where the window before has led
        part = system.window(start, stop)
        weights = cost.window(start, stop, N=N, nu=nu) if cost_of is None else cost_of(start, stop)
        states = x[start : stop + 1].copy()
        if not follows and planned < stop:
            states[planned - start + 1 :] = x[planned]
        if not follows and planned == start:
            return optimized(part, weights, initial=(x[start], u[start:stop]), **options)
        try:
            return optimized(part, weights, initial=(states, u[start:stop]), **options)
        except LeastActionError:
            # What the plan and its continuation cannot do, the inputs alone may.
            return optimized(part, weights, initial=(x[start], u[start:stop]), **options)

    status, detail = StartStatus.COMPLETED, ""
    while k < N:
        steps = min(length, N - k)
        while True:
            stop = k + steps
            result, _ = stages.make(f"steps {k} to {stop}", k, partial(solve, k, stop), accept=lambda _: True)
            if result is not None or steps == 1 or stages.ended is not None:
                break
            steps = (steps + 1) // 2
        if result is None:
            if stages.ended is None:
                status, detail = StartStatus.GAVE_UP, f"Not even {system.when(k)} could be made: {stages.error}"
            break
        x[k : stop + 1], u[k:stop] = result.x, result.u
        planned = stop
        k = stop if stop == N else min(k + kept, stop)
        if stages.ended is not None:
            break
    if stages.ended is not None and k < N:
        status = stages.ended
    done = x[: k + 1].copy(), u[:k].copy()
    value = cost.value(*done) if k == N else np.nan
    if len(stages.records) > 1:
        result = None
    return stages.result(status, *done, value, k, result, detail)
