"""Trajectory optimisation by the projection operator (dissertation Alg. 1 to 3, 6.4).

``minimise h(x, u) over trajectories of x+ = f(x, u, k), or of x' = f(x, u, t), from a fixed initial state``

Every iterate is a trajectory, or becomes one (multiple shooting). An iteration linearises along it, minimises a
quadratic model over the tangent trajectories (a linear-quadratic problem), and follows the projection of that direction
as far as the cost falls enough.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from functools import cache
from typing import Any, cast, overload

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.time_functions import TimeFunctionLike
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.problem import CollocationProblem
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.easing import EasedProblem
from leastaction.optimal.discrete.shooting import Gapped
from leastaction.optimal.discrete.system import DiscreteSystem, given_start
from leastaction.optimal.limits.limit import Limit, checked_limits
from leastaction.optimal.limits.problem import LimitedProblem
from leastaction.optimal.loop import Callback, Loop, Problem
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.system import check_system
from leastaction.optimal.unknowns.extension import Extension, checked_unknowns
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.optimal.unknowns.unknown import Unknown
from leastaction.optimal.ways import WAYS
from leastaction.optimal.ways.resolved import resumed as resume_within


@overload
def optimize(
    system: DiscreteSystem,
    cost: Cost,
    *,
    initial: tuple[ArrayLike, ArrayLike] | OptimizationResult | None = ...,
    resume: OptimizationResult | None = ...,
    limits: Sequence[Limit] = ...,
    free_start: bool | Sequence[str] = ...,
    unknowns: Sequence[Unknown] = ...,
    options: Options | None = ...,
    callback: Callback | None = ...,
    **settings: Any,
) -> OptimizationResult: ...


@overload
def optimize(
    system: ContinuousSystem,
    cost: ContinuousCost,
    *,
    initial: DenseTrajectory | ContinuousOptimizationResult | tuple[TimeFunctionLike, TimeFunctionLike] | None = ...,
    horizon: tuple[float, float] | None = ...,
    resume: ContinuousOptimizationResult | None = ...,
    limits: Sequence[Limit] = ...,
    free_start: bool | Sequence[str] = ...,
    options: Options | None = ...,
    callback: Callback | None = ...,
    **settings: Any,
) -> ContinuousOptimizationResult: ...


def optimize(
    system: DiscreteSystem | ContinuousSystem,
    cost: Cost | ContinuousCost,
    *,
    initial: Any = None,
    horizon: tuple[float, float] | None = None,
    resume: OptimizationResult | None = None,
    limits: Sequence[Limit] = (),
    free_start: bool | Sequence[str] = False,
    unknowns: Sequence[Unknown] = (),
    options: Options | None = None,
    callback: Callback | None = None,
    **settings: Any,
) -> OptimizationResult:
    """Minimise a cost over the trajectories of a system; the initial state stays as it is, if nothing else is asked.

    Parameters
    ----------
    system : DiscreteSystem or ContinuousSystem
        What is steered.
    cost : Cost or ContinuousCost
        What is minimised, such as a `QuadraticCost` or a `ContinuousQuadraticCost`.
    initial : (x, u), OptimizationResult or DenseTrajectory
        Where to start. Of a discrete system x (N+1, nx) and u (N, nu): if x is not a trajectory of the system, the
        projection of (x, u) is taken, by the gains of several regulators if the first leads far away; x (nx,) is an
        initial state alone, to which u is applied. Of an earlier result the trajectory is taken, and the duals, if its
        limits read as these do. Of a continuous system a curve, whose projection is taken; or x and u, of shapes (nx,)
        and (nu,), as constants, functions of one time or `PiecewisePolynomial`, where a constant x is an initial state.
    horizon : (t0, tf), optional
        Times (s); needed with ``(x, u)`` of a continuous system.
    resume : OptimizationResult, optional
        Go on from an earlier result instead of `initial`. The iterates are those of a run that was
        never stopped, if method, regulator, accuracy, cost and system are the same.
    limits : sequence of Limit, optional
        What the motion has to keep to, as `Bound`, `Equal`, `Within` say. The start need not keep to them. In
        continuous time they hold at the points of a mesh (see `leastaction.optimal.collocation`), which is made finer
        until the motion is right to a thousand times the accuracy's `rtol`, a hundred-thousandth at most; or to an
        `rtol` that is larger than that.
    free_start : bool or sequence of str, optional
        Whether the initial state is found too, or which entries of it, by their names (see
        ``system.quantity("state")``) with wildcards. It stays on the constraints of a mechanism. The cost has to
        weigh what is free; at the start itself limits hold as well then. `Periodic` among the limits has it return.
    unknowns : sequence of Parameter or FinalTime, optional
        Numbers of a discrete system that are found too: parameters of a mechanism, the final time. What is found is in
        ``result.unknowns``, and the motion is one of ``system.with_parameters(result.unknowns)``.
    options : Options, optional
        All other settings; see `Options`, and the notes below.
    callback : callable, optional
        Called with an `IterationRecord` after every iteration, and once with the initial trajectory; a true answer
        stops the optimisation. `IterationTable` is one. In continuous time `x` and `u` of the record are samples at the
        ends of the trajectory's pieces, of which there are more or fewer from one iterate to the next.
    **settings
        Fields of `Options` by their names, such as ``max_iterations=50``, before those of `options`.

    Returns
    -------
    OptimizationResult
        Of a continuous system a `ContinuousOptimizationResult`. Frozen; `status` says how it ended.
        Ctrl-C gives the last iterate.

    Raises
    ------
    ArgumentError
        What is no system, or not yet one; settings, shapes or values that are wrong, or an initial curve that
        cannot be projected.

    Notes
    -----
    *Models.* ``method="auto"`` starts with quasi-Newton, stays with it while it foretells the cost well, and goes to
    Newton otherwise. A Newton model without a minimum is damped; a method whose direction cannot be followed is
    replaced, for that iteration, by the next simpler one, and where none can, all of them are shortened by added
    weights. The history and the table show what was used. Whatever the method, convergence is judged by the exact
    second derivative of a discrete system that has one: at a saddle, "auto" and "newton" go on along negative
    curvature, the others end with `Status.SADDLE`.

    *Ways to begin again.* "auto" begins again where it is stuck, or most of its first steps had to be cut short: with
    gaps between the steps; with inputs that are much dearer at first (`Cost.eased`); and where its steps of time are
    too coarse, among the motions that they resolve (`DiscreteSystem.resolved_rates`): it ends with `Status.RESOLVED`
    where that holds the minimum back, and goes on without where it does not. The note of the record says so, and the
    cost may rise there. ``without`` switches any of them off.

    *Gaps.* With ``shooting="multiple"`` the start is a curve whose steps need not meet, the states are unknowns too,
    and the gaps close on the way, before a minimum over trajectories is looked for as ever. It is for starts that are
    known but no trajectories, such as the wanted motion with no inputs, and for motions that are unstable over a long
    time: there a projection leads far away. For discrete systems. A run that ends before the gaps are closed says so
    (`gap` of the result). Limits are softest meanwhile. "auto" tries gaps, but with `method` "auto" of a discrete
    system without unknowns only, once, from the start, where that cannot be projected, where most of the first steps
    had to be cut short (within limits, if the projection lost the start), where it is stuck within limits, or where it
    takes long without. Where they do not close soon, it goes on from where it stood, which is the result meanwhile;
    within limits from their projection.

    *Continuous time.* On a mesh (``collocate``, and wherever there are limits or a free start) there is one recursion
    over its pieces instead of equations for nx (nx + 1) / 2 entries of a Riccati matrix that are integrated in time:
    for many states much the faster way, and weights may differ by any ratio. An optimum is found to about the square of
    the relative tolerance of `accuracy` in cost, and to the tolerance in the trajectory.
    """
    check_system(system, (DiscreteSystem, ContinuousSystem), ("nx", "nu"))
    problem: Problem[Any, Any, Any]
    extension: Extension | None = None
    chosen = (options or Options()).changed(**settings)
    if chosen.method == "newton" and not system.has_curvature:
        raise ArgumentError(
            f"method: got 'newton', but {type(system).__name__} has no second derivative. Give it a `curvature`, or "
            "use 'auto' or 'quasi-newton'."
        )
    if (initial is None) == (resume is None):
        raise ArgumentError(f"initial, resume: got {'neither' if initial is None else 'both'}, expected one of them.")
    if callback is not None and not callable(callback):
        raise ArgumentError(f"callback: got {type(callback).__name__}, expected a function of an IterationRecord")
    kind = Cost if isinstance(system, DiscreteSystem) else ContinuousCost
    if resume is not None:
        made = OptimizationResult if kind is Cost else ContinuousOptimizationResult
        require_instance(resume, "resume", made, "optimize() returns one")
    if not isinstance(cost, kind):
        raise ArgumentError(
            f"cost: got {type(cost).__name__}, expected a {kind.__name__} to go with {type(system).__name__}"
        )
    limits, free = checked_limits(limits), _checked_start(free_start, system)
    if isinstance(system, DiscreteSystem):
        check_system(system, (DiscreteSystem,), ("N",))
        for name, value in (
            ("horizon", horizon),
            ("accuracy", chosen.accuracy),
            ("collocate", chosen.collocate or None),
        ):
            if value is not None:
                raise ArgumentError(
                    f"{name}: got {value!r}, expected None: {type(system).__name__} is a discrete system, which "
                    "brings its times along."
                )
        stages, unknowns = cast(Cost, cost), checked_unknowns(unknowns)
        stages.check_shapes(system.N, system.nx, system.nu)
        if free is False and initial is not None and not isinstance(initial, OptimizationResult):
            system.check_start(np.atleast_2d(given_start(system, initial)[0])[0])
        if unknowns or any(isinstance(limit, Periodic) for limit in limits):
            extension = Extension(system, stages, unknowns, limits, free)
        problem = _discrete_problem(system, stages, limits, free, extension, chosen)
        if extension is not None:
            resume = None if resume is None else extension.resume(resume)
            initial = None if initial is None else extension.start(initial)
            callback = extension.callback(callback)
        if resume is not None:
            _check_unknowns(resume, extension)
        if isinstance(initial, OptimizationResult) and not isinstance(problem, LimitedProblem):
            initial = initial.x, initial.u
    else:
        if chosen.shooting == "multiple":
            raise ArgumentError(f"shooting: got {chosen.shooting!r} for a continuous system, expected 'single'")
        if unknowns:
            raise ArgumentError(
                "unknowns: got some for a continuous system, expected none: they are for discrete systems"
            )
        problem = _continuous_problem(system, cast(ContinuousCost, cost), limits, free, chosen, horizon)
        if isinstance(initial, ContinuousOptimizationResult) and not isinstance(problem, CollocationProblem):
            initial = initial.trajectory
    # Threads of BLAS gain nothing on many matrices of a few hundred rows, and wait for each other on a busy machine:
    # such a matrix was factored in 73 ms instead of 1.
    with _libraries().limit(limits=1, user_api="blas") if isinstance(problem, CollocationProblem) else nullcontext():
        memory = None if resume is None else resume.memory
        ways = [way for way in WAYS if way.name not in chosen.without]
        if resume is not None and memory is not None and memory.resolved is not None:
            loop = Loop(problem, chosen, callback, resume, ways)
            resume_within(loop.progress, resume, memory)
        elif resume is not None:
            _check_resumed(problem, resume)
            problem.resume(resume)
            loop = Loop(problem, chosen, callback, resume, ways)
        else:
            problem.start(initial)
            loop = Loop(problem, chosen, callback, ways=ways)
        result = loop.run()
    return result if extension is None else extension.result(result)


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries with threads of their own: to look for them takes as long as an iteration or two."""
    import scipy.linalg.lapack  # noqa: F401 - which has a BLAS of its own

    return ThreadpoolController()


def _discrete_problem(
    system: DiscreteSystem,
    cost: Cost,
    limits: Sequence[Limit],
    free: bool | tuple[str, ...],
    extension: Extension | None,
    settings: Options,
) -> Problem[Any, Any, Any]:
    """Return the problem in steps of time, with limits or without, of the extended system where there is one."""
    own_way = settings.method == "auto" and settings.regulator == "descent" and extension is None
    gapped: Gapped = (
        "never" if settings.shooting == "single" or "gaps" in settings.without or not own_way else "where needed"
    )
    gapped = "at once" if settings.shooting == "multiple" else gapped
    final_time = None
    if extension is None:
        rows = [row for limit in limits for row in limit.rows(system, 1 if free is False else 0)]
    else:
        rows, free, final_time = extension.rows(), True, extension.system.final_time
        system, cost = extension.system, extension.cost
    if rows:
        return LimitedProblem(system, cost, rows, settings, free, gapped, final_time)
    return EasedProblem(system, cost, settings, free, gapped)


def _continuous_problem(
    system: ContinuousSystem,
    cost: ContinuousCost,
    limits: list[Limit],
    free: bool | tuple[str, ...],
    settings: Options,
    horizon: tuple[float, float] | None,
) -> Problem[Any, Any, Any]:
    """Return the problem in continuous time, on a mesh where something asks for it."""
    if any(isinstance(limit, Periodic) for limit in limits):
        raise ArgumentError(
            f"limits: got a Periodic for {type(system).__name__}, expected a discrete system for a motion that "
            "returns; in continuous time `Equal` asks for a given last state"
        )
    accuracy = settings.accuracy or Accuracy()
    if limits or free is not False or settings.collocate:
        return CollocationProblem(system, cost, limits, settings, accuracy, horizon, free)
    return ContinuousProblem(system, cost, settings, accuracy, horizon)


def _check_unknowns(resume: OptimizationResult, extension: Extension | None) -> None:
    names = () if extension is None else extension.system.names
    others = [name for name in resume.unknowns if name not in names]
    if others:
        raise ArgumentError(
            f"resume: got a result with the unknown {others[0]!r}, expected those of this call. Name it among the "
            "unknowns, or give initial=result and system.with_parameters(result.unknowns)"
        )


def _check_resumed(problem: Problem[Any, Any, Any], resume: OptimizationResult) -> None:
    """Check that there are limits in a run that goes on if there were any before."""
    if isinstance(problem, CollocationProblem):
        return  # It says so itself.
    had, has = resume.limits is not None, isinstance(problem, LimitedProblem)
    if had != has:
        raise ArgumentError(
            f"resume: got a result {'with' if had else 'without'} limits, expected those of this call"
            f"{'' if has else ', none'}. Give initial=result to start from its trajectory"
        )


def _checked_start(free: bool | Sequence[str], system: DiscreteSystem | ContinuousSystem) -> bool | tuple[str, ...]:
    if isinstance(free, bool):
        return free
    if not isinstance(free, Iterable):
        raise ArgumentError(
            f"free_start: got {free!r}, expected True, False or names of entries of the state such as ['p_cart']"
        )
    names = (free,) if isinstance(free, str) else tuple(free)
    system.free_entries(names)
    return names


def optimize_continuous(system: ContinuousSystem, cost: ContinuousCost, **options: Any) -> ContinuousOptimizationResult:
    """Return what `optimize` does, which takes systems in either kind of time: the older name."""
    check_system(system, (ContinuousSystem,), ())
    return optimize(system, cost, **options)
