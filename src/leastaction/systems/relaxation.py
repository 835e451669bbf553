"""Starts for mechanisms whose constraints stand in the way: soft at first, or forces that are chosen."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, brief, unknown
from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_number, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.cost import diagonal_of, widened
from leastaction.optimal.discrete.cost import Cost, QuadraticCost
from leastaction.optimal.discrete.system import given_start
from leastaction.optimal.limits.limit import Bound
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.starts import StartResult, StartStatus, continuation
from leastaction.optimal.starts.stages import StageCallback, StartStages, check_last_limits, check_options, check_stages
from leastaction.systems.assembly_modes import on_the_best_mode
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.pulled import PulledSystem
from leastaction.systems.warm_starts import warm_start

_DEAREST = 1e100  # of a tension, whose square is used
_ENOUGH = Status.CONVERGED, Status.STALLED, Status.SADDLE, Status.ITERATION_LIMIT


def _leads_on(result: OptimizationResult) -> bool:
    """Return whether a stage led to a motion from which the next may begin."""
    coarse = result.worst_step is not None and result.worst_step.is_coarse
    return result.status in _ENOUGH and not (coarse and result.status is Status.ITERATION_LIMIT)


@public
def relax(
    system: MidpointSystem,
    cost: Cost,
    *,
    initial: tuple[ArrayLike, ArrayLike],
    constraints: Sequence[str] | None = None,
    stiffness: tuple[float, float] = (10.0, 1e5),
    tolerance: float = 1e-3,
    stage_iterations: int = 60,
    stage_tolerance: float = 1e-3,
    max_stages: int = 40,
    callback: StageCallback | None = None,
    **options: Any,
) -> StartResult:
    """Find a motion with springs in the place of constraints, make them ever stiffer, and project it back.

    A spring costs energy ``k/2 |h|^2`` where a constraint holds ``h = 0``: a penalty that grows with its stiffness k.
    With soft springs a motion is there that violates the constraints, and dynamics that lose no rank; it leads from one
    stiffness to the next, by factors that grow where that was easy, until what is left of ``h`` is below the tolerance.
    Then the configurations are brought onto the constraints (`warm_start`) and optimised with them.

    A loop that was open at the start is closed at its nearest. Where that cannot follow, since nothing is found or
    standing still with the loop closed in another way would cost less, other ways are tried at the same places of what
    is driven, and the one that costs least is taken. Where none follows the message says so. An initial state that
    satisfies the constraints is kept, and the message says where another one would do better.

    Parameters
    ----------
    system : MidpointSystem
        What is steered, with its constraints and without multipliers in its state.
    cost : Cost
        Of its motions.
    initial : (x, u)
        Where to start, as of `optimize`; x need not keep to the constraints.
    constraints : sequence of str, optional
        Names of those that are relaxed; all for which there is a spring if left out.
    stiffness : (float, float)
        The first stiffness, and the last one (N/m).
    tolerance : float
        The largest residual of the constraints with which they are put back, in the units of `constraint_values`.
    stage_iterations, stage_tolerance : int, float
        ``max_iterations`` and ``tolerance`` of the optimisations with springs.
    max_stages : int
        Limit on their number; of further ways to close a loop few are tried.
    callback : callable, optional
        Called with a `StageRecord` after every stage, whose value is the stiffness (infinite for the last one); a true
        answer ends the search.
    **options
        Of `optimize`, for the last optimisation.

    Returns
    -------
    StartResult
        A trajectory of `system`, if the status is COMPLETED; else the last one with springs.

    Raises
    ------
    ArgumentError
        Wrong shapes, unknown names, a constraint without a spring; or from `optimize`, where not even the first motion
        with springs is found.

    Notes
    -----
    Dissertation 6.6.1: internal constraints that are relaxed to a penalty, with an adaptive one.
    """
    _check(system, cost, options)
    m = system.mechanism
    names = _chosen(m, constraints)
    least, most = _range(stiffness)
    check_stages(stage_iterations, stage_tolerance)
    limit = as_number(tolerance, "tolerance", above=0.0)
    softer: dict[float, MidpointSystem] = {}

    def solve(value: float, earlier: OptimizationResult | None) -> OptimizationResult:
        soft = softer[value] = MidpointSystem(system.integrator.like(_soft(m, names, value)), system.t)
        start = initial if earlier is None else (earlier.x, earlier.u)
        return optimized(
            soft, cost, initial=start, max_iterations=stage_iterations, tolerance=stage_tolerance,
            limits=options.get("limits", ()), shooting="single", without=["resolved"],
        )  # fmt: skip

    def residual(result: OptimizationResult) -> float:
        instants = zip(system.t[1:], result.x[1:, : m.nq], strict=True)
        return float(np.abs([m.at_time(t).constraint_values(q) for t, q in instants]).max())

    found = continuation(
        solve,
        np.geomspace(least, most, max(2, round(np.log10(most / least)) + 1)),
        scale="log",
        name="stiffness",
        accept=_leads_on,
        done=lambda result: residual(result) <= limit,
        note=lambda result: f"residual of the constraints {residual(result):.2g}",
        max_stages=max_stages,
        callback=callback,
    )
    given = given_start(system, initial)
    if found.result is None or found.status not in (StartStatus.COMPLETED, StartStatus.GAVE_UP):
        return on_the_best_mode(found, system, cost, given, callback, options)
    soft = next(each for value, each in softer.items() if np.isclose(value, found.value))
    closed = _put_back("with its constraints", found, soft, system, cost, callback, options)
    return on_the_best_mode(closed, system, cost, given, callback, options)


@public
def by_tensions(
    system: MidpointSystem,
    cost: QuadraticCost,
    *,
    initial: tuple[ArrayLike, ArrayLike],
    price: float = 1e-4,
    least: float | None = None,
    stage_iterations: int = 200,
    stage_tolerance: float = 1e-6,
    callback: StageCallback | None = None,
    **options: Any,
) -> StartResult:
    """Find a motion with the tensions of strings as inputs, and turn them back into strings of prescribed lengths.

    Strings whose lengths are prescribed brace against each other, push, and lose their grip where they cannot act on
    what they hold. With tensions as inputs (`PulledSystem`) nothing loses rank, and a string that pulls is an input
    with a bound. Both make the same motions: the lengths are the distances that the motion has.

    Parameters
    ----------
    system : MidpointSystem
        A mechanism whose constraints are all strings (`Distance`, `PathLength`), with lengths that are variables of
        their own.
    cost : QuadraticCost
        Of its motions. By tensions, what it says of lengths does not count.
    initial : (x, u)
        Where to start, as of `optimize`. The strings carry what they can of the weight there.
    price : float
        Weight of the square of each tension (1/N^2).
    least : float, optional
        Least tension (N); strings may push if left out.
    stage_iterations, stage_tolerance : int, float
        ``max_iterations`` and ``tolerance`` of the optimisation by tensions.
    callback : callable, optional
        Called with a `StageRecord` after either stage; a true answer ends the search.
    **options
        Of `optimize`, for the last optimisation.

    Returns
    -------
    StartResult
        A trajectory of `system`, if the status is COMPLETED; else that by tensions.

    Raises
    ------
    ArgumentError
        Wrong shapes, constraints that are no such strings, a cost that is no `QuadraticCost`; or from `optimize`, where
        no motion by tensions is found.

    Notes
    -----
    Dissertation 6.6.2: strings that are replaced by forces, solved, and turned back into strings.
    """
    _check(system, cost, options)
    check_stages(stage_iterations, stage_tolerance)
    as_number(price, "price", above=0.0, below=_DEAREST)
    if least is not None:
        as_number(least, "least")
    if type(cost) is not QuadraticCost:
        raise ArgumentError(f"cost: got {type(cost).__name__}, expected a QuadraticCost: lengths are left out of it")
    cost = cast(QuadraticCost, cost.over(system.N))
    whole = system.mechanism
    strings = _strings(whole)
    m = whole.with_exchanged({name: [force] for name, force in strings.items()})
    late = [name for name in m.inputs if name not in whole.inputs]
    pulled = PulledSystem(system.integrator.like(m), system.t, at_instants=late)
    # Its numbers among those of the state with strings, and its directions among the directions of that.
    rates = [whole.nd + whole.kinematic.index(name) for name in m.kinematic]
    states, moves = (
        [*(of.index(name) for name in names), *(len(of) + i for i in (*range(whole.nd), *rates))]
        for of, names in ((whole.coordinates, m.coordinates), (whole.variables, m.variables))
    )
    inputs = [*range(whole.n_inputs), *(whole.n_inputs + whole.kinematic.index(n) for n in m.kinematic)]
    free = whole.n_inputs

    x, u = given_start(system, initial)
    x, u = x[..., states], u[:, inputs]
    tension = _at_rest(m, late, np.atleast_2d(x)[0, : m.nq], least)
    with_tensions = np.insert(u, [free] * len(late), tension, axis=1)
    weight = as_number(price, "price", above=0.0)
    easier = QuadraticCost(
        cost.x_wanted[:, states],
        np.insert(cost.u_wanted[:, inputs], [free] * len(late), 0.0, axis=1),
        Q=_part(cost.Q, moves),
        R=_with_more(_part(cost.R, inputs), free, np.full(len(late), weight)),
        Q_final=_part(cost.Q_final, moves),
        space=pulled,
    )
    limits = [] if least is None else [Bound(late, min=least, of="input")]
    stages = StartStages(callback)
    solve = partial(
        optimized, pulled, easier, initial=(x, with_tensions), limits=limits, max_iterations=stage_iterations,
        tolerance=stage_tolerance,
    )  # fmt: skip
    result, accepted = stages.make("by tensions", 0.0, solve, accept=lambda found: found.status in _ENOUGH)
    if result is None:
        if stages.error is not None:
            raise stages.error
        raise KeyboardInterrupt
    if not accepted or stages.ended is not None:
        status = stages.ended or StartStatus.GAVE_UP
        return stages.result(status, result.x, result.u, result.cost, 0.0, result, result.message)
    found = stages.result(StartStatus.COMPLETED, result.x, result.u, result.cost, 0.0, result)
    return _put_back("by lengths", found, pulled, system, cost, callback, options)


def _put_back(
    name: str,
    found: StartResult,
    other: MidpointSystem,
    system: MidpointSystem,
    cost: Cost,
    callback: StageCallback | None,
    options: dict[str, Any],
) -> StartResult:
    """Return what a motion of another system leads to in the system itself, brought onto its constraints."""
    stages = StartStages(callback, found.stages)

    def solve() -> OptimizationResult:
        start = warm_start((found.x, found.u), other, system)
        return optimized(system, cost, initial=start, **options)

    result, accepted = stages.make(name, np.inf, solve, accept=lambda _: True)
    if result is not None and (accepted or stages.ended is not None):
        status = stages.ended or StartStatus.COMPLETED
        return stages.result(status, result.x, result.u, result.cost, np.inf, result)
    why = "" if stages.error is None else f"It could not be brought back: {stages.error}"
    status = stages.ended or StartStatus.GAVE_UP
    return stages.result(status, found.x, found.u, found.cost, found.value, found.result, why)


def _check(system: MidpointSystem, cost: Cost, options: dict[str, Any]) -> None:
    require_instance(system, "system", MidpointSystem)
    if system.multipliers:
        raise ArgumentError("system: got one with multipliers in its state, expected one without them")
    require_instance(cost, "cost", Cost)
    check_options(options, "the last stage, which starts from the one before")
    check_last_limits(system, options)


def _chosen(m: Mechanism, names: Sequence[str] | None) -> list[str]:
    """Return the names of the constraints that are relaxed, checked."""
    springs = {n: each.as_spring(1.0) for n, each in m.elements.items() if isinstance(each, Constraint)}
    if not springs:
        raise ArgumentError("system: got a mechanism without constraints, expected one that has some")
    chosen = [n for n, spring in springs.items() if spring is not None] if names is None else list(names)
    for name in chosen:
        if name not in springs:
            raise unknown("constraint", name, springs, "constraints")
        if springs[name] is None:
            raise ArgumentError(f"constraints: no spring can take the place of {m.elements[name].label}; leave it out")
    if not chosen:
        raise ArgumentError("constraints: no spring can take the place of any of them")
    return chosen


def _range(stiffness: tuple[float, float]) -> tuple[float, float]:
    """Return the first and the last stiffness."""
    if np.shape(stiffness) != (2,):
        raise ArgumentError(f"stiffness: got {brief(repr(stiffness))}, expected the first and the last one (N/m)")
    least, most = (as_number(each, "stiffness", above=0.0) for each in stiffness)
    if most < least:
        raise ArgumentError(f"stiffness: got {least:g} first and {most:g} last, expected springs that get stiffer")
    return least, most


def _soft(m: Mechanism, names: Sequence[str], stiffness: float) -> Mechanism:
    """Return the mechanism with springs in the place of constraints."""
    found = {name: m.elements[name] for name in names}
    springs = {name: each.as_spring(stiffness) for name, each in found.items() if isinstance(each, Constraint)}
    return m.with_exchanged({name: [spring] for name, spring in springs.items() if spring is not None})


def _strings(m: Mechanism) -> dict[str, Any]:
    """Return the forces of all strings by their names, or complain about a constraint that is none."""
    found = {}
    for name, each in m.elements.items():
        if not isinstance(each, Constraint):
            continue
        force = each.as_force(f"tension of {name}")
        if force is None or each.length_variable is None or each.length_variable in m.tree.kinematic:
            raise ArgumentError(
                f"system: {each.label} is no string whose length is a variable of its own, expected such strings only"
            )
        found[name] = force
    if not found:
        raise ArgumentError("system: got a mechanism without strings, expected one that has some")
    return found


def _at_rest(m: Mechanism, late: Sequence[str], q: Array, least: float | None) -> Array:
    """Return the tensions with which strings carry a configuration as well as they can."""
    rest = np.zeros(m.nv)
    slope = m.core.gradient(np.ascontiguousarray(q), rest)[0][: m.nd]
    _, _, by_input = m.core.force_jacobians(np.ascontiguousarray(q), rest, np.zeros(m.n_inputs))
    columns = by_input[: m.nd, [m.inputs.index(name) for name in late]]
    from scipy.optimize import lsq_linear  # slow to import, and not needed by most

    return np.asarray(lsq_linear(columns, -slope, bounds=(0.0 if least is None else least, np.inf)).x)


def _part(weight: Array, places: Sequence[int]) -> Array:
    """Return the weight of some entries."""
    return widened(weight, lambda rows: np.ascontiguousarray(rows[..., places]))


def _with_more(weight: Array, at: int, more: Array) -> Array:
    """Return a weight with further entries of their own weights at a place."""
    result = widened(weight, lambda rows: np.insert(rows, [at] * len(more), 0.0, axis=-1))
    diagonal_of(result)[..., at : at + len(more)] = more
    return result
