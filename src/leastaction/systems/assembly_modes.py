"""Assembly modes: the ways to close loops at given places of what drives a mechanism, and which to begin with.

A four-bar whose crank stands has two of them, on either side of a diagonal. No motion leads from one to the other where
the linkage cannot pass its dead points, so that one of them may follow what is wanted and the other not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import InconsistentStartError, LeastActionError, ProjectionError, some
from leastaction.mechanics.configuration.assembly import check_consistent, project_configuration, project_velocity
from leastaction.mechanics.configuration.null_space import NullSpace
from leastaction.mechanics.continuous.legendre import to_velocity
from leastaction.mechanics.discrete.prescribed import held
from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import difference, moved_by
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.starts import StartResult, StartStatus
from leastaction.optimal.starts.stages import StageCallback, StartStages
from leastaction.systems.midpoint import MidpointSystem

_STARTS = 12  # from which other ways to close the loops are looked for
_MOST = 4  # of them that are tried
_DRIVEN = 10.0  # by which a variable that an input acts on is held rather than another
_SAME = 1e-3  # of the largest difference of two configurations, in rad or m
_FOLLOWS = Status.CONVERGED, Status.RESOLVED, Status.STALLED, Status.SADDLE, Status.ITERATION_LIMIT


@dataclass(frozen=True)
class _Mode:
    """A way to close the loops: the first state, what standing still there costs, and which constraints close it.

    ``constraints``: names of those that say something of variables which differ from those of the nearest mode; none of
    the nearest.
    """

    x: Array
    cost: float
    constraints: tuple[str, ...]


def on_the_best_mode(
    found: StartResult,
    system: MidpointSystem,
    cost: Cost,
    initial: tuple[Array, Array],
    callback: StageCallback | None,
    options: dict[str, Any],
) -> StartResult:
    """Return what was found, or what another assembly mode leads to where loops were closed on one that cannot follow.

    They are tried where nothing was found, and where standing still on one of them costs less than the best motion that
    was found. An initial state that satisfies the constraints has chosen its mode, and is only spoken of.

    ``initial``: x (N+1, nx) or (nx,), and u (N, nu), with which the search began.
    """
    if found.status not in (StartStatus.COMPLETED, StartStatus.GAVE_UP, StartStatus.STAGE_LIMIT):
        return found
    x0, closed = np.atleast_2d(initial[0])[0], found.status is StartStatus.COMPLETED
    follows = closed and found.result is not None and _goes(found.result)
    modes = _modes(system, cost, found.x[0, : system.nx] if closed else x0, initial[1])
    if _decides(system, x0):
        return _spoken_of(found, system.mechanism, [each for each in modes if each.constraints], follows)
    if closed:
        modes = [each for each in modes if each.constraints and (each.cost < found.cost or not follows)]
        if follows and not modes:
            return found
    return _tried(found, modes[:_MOST], follows, system, cost, initial[1], callback, options)


def _spoken_of(found: StartResult, m: Mechanism, others: list[_Mode], follows: bool) -> StartResult:
    """Return what was found, with a word of the mode that would do better than that of the initial state."""
    if not others or (follows and others[0].cost >= found.cost):
        return found
    costs = f", where standing still costs {others[0].cost:.6g}" if follows else ""
    return _saying(
        found,
        f"The initial state satisfies the constraints, which decides how {_names(m, others[:1])} is closed. There is "
        f"another way{costs}: begin with {_place(m, others[0])}.",
    )


def _tried(
    found: StartResult,
    modes: list[_Mode],
    follows: bool,
    system: MidpointSystem,
    cost: Cost,
    u: Array,
    callback: StageCallback | None,
    options: dict[str, Any],
) -> StartResult:
    """Return the best of what was found and what modes lead to; ``follows``: whether what was found is any good."""
    stages, best, chosen = StartStages(callback, found.stages), found, None
    for number, mode in enumerate(modes, 1):
        if follows and not mode.cost < best.cost:
            break
        solve = partial(optimized, system, cost, initial=(mode.x, _inputs(system, mode.x, u)), **options)
        result, goes = stages.make(f"assembly mode {number}", np.inf, solve, accept=_goes)
        if result is not None and goes and (not follows or result.cost < best.cost):
            best = stages.result(StartStatus.COMPLETED, result.x, result.u, result.cost, np.inf, result)
            follows, chosen = True, mode
        if stages.ended is not None:
            message = stages.ended.value
            return replace(best, status=stages.ended, message=message, stages=tuple(stages.records))
    best, m = replace(best, stages=tuple(stages.records)), system.mechanism
    if chosen is None:
        tried = "" if not modes else f" (tried: {'; '.join(_place(m, each) for each in modes)})"
        return _saying(best, f"No way to close {_names(m, modes)} was found that follows better{tried}.")
    return _saying(best, f"As closed first {_names(m, modes)} did not follow; this begins with {_place(m, chosen)}.")


def _goes(result: OptimizationResult) -> bool:
    return result.status in _FOLLOWS


def _saying(found: StartResult, more: str) -> StartResult:
    return replace(found, message=f"{found.message} {more}")


def _names(m: Mechanism, modes: list[_Mode]) -> str:
    """Return in words the constraints that close modes, or all of them where those are not known."""
    names = list(dict.fromkeys(name for each in modes for name in each.constraints))
    return some([repr(name) for name in names or _constraints(m)], 6)


def _place(m: Mechanism, mode: _Mode) -> str:
    """Return the first configuration of a mode in words."""
    return some([f"{name} = {value:.6g}" for name, value in zip(m.coordinates, mode.x[: m.nq], strict=True)], 6)


def _decides(system: MidpointSystem, x: Array) -> bool:
    """Return whether a first state satisfies the constraints."""
    try:
        system.check_start(x)
    except ProjectionError:
        return False
    return True


def _inputs(system: MidpointSystem, x: Array, u: Array) -> Array:
    """Return inputs (N, nu) that hold what is prescribed where a state (nx,) has it."""
    m, given = system.mechanism, u.copy()
    given[:, m.n_inputs :] = held(m, x[m.first_rho : m.nq])
    return given


def _modes(system: MidpointSystem, cost: Cost, x: Array, u: Array) -> list[_Mode]:
    """Return the ways to close the loops that a first state (nx,) closes, or nearly, the one that costs least first.

    Variables that are enough to say where the mechanism stands are held, first of all those that inputs act on; the
    others set out from places all around.
    """
    m = system.mechanism.at_time(system.t[0])
    v_rho = x[m.nq + m.nd : m.nx]
    try:
        q = project_configuration(m, x[: m.nq], attempts=_STARTS).q
        v = to_velocity(m, q, x[m.nq : m.nq + m.nd], v_rho, keep_constraints=True)
    except LeastActionError:
        return []
    hold = _enough(m, q)
    free = np.array([i for i, name in enumerate(m.variables[: m.nd]) if name not in hold], dtype=np.intp)
    turns = np.array([m.units.get(m.variables[i]) == "rad" for i in free], dtype=bool)
    # Angles wind, quaternions do not.
    plain = np.array([m.variables[i] in m.coordinates for i in free], dtype=np.bool_)
    places = [m.coordinates.index(m.variables[i]) for i in free[plain]]
    angles = np.array(places, dtype=np.intp)[turns[plain]]
    size = np.full(len(free), np.pi)
    size[plain] = np.where(turns[plain], np.pi, 2.0 * (1.0 + np.abs(q[places])))

    def costs(place: Array) -> float:
        still = np.tile(place, (system.N + 1, 1))
        states = system.states_along(still, np.zeros((system.N + 1, m.nd)))
        return float(cost.over(system.N).value(states, _inputs(system, states[0], u)))

    random, seen, found = np.random.default_rng(0), [q], [_Mode(_state(system, q, v), costs(q), ())]
    for _ in range(_STARTS if len(free) else 0):
        move = np.zeros(m.nv)
        move[free] = random.uniform(-1.0, 1.0, len(free)) * size
        start = moved_by(m, q, move)
        try:
            other = _unwound(m, project_configuration(m, start, hold=hold).q, q, angles)
            if min(np.abs(difference(m, other, each)).max() for each in seen) < _SAME:
                continue
            seen.append(other)
            other = _wound(m, other, angles, costs)
            state = _state(system, other, project_velocity(m, other, v, hold=hold).v)
        except LeastActionError:
            continue
        found.append(_Mode(state, costs(other), _closing(m, q, np.abs(difference(m, other, q)) > _SAME)))
    return sorted(found, key=lambda mode: mode.cost)


def _enough(m: Mechanism, q: Array) -> list[str]:
    """Return variables that are free of each other at a configuration, and of which all others follow nearby."""
    from scipy.linalg import qr  # slow to import, and not needed by most

    along = NullSpace.of(m.constraint_jacobian(q)[:, : m.nd]).basis
    by_input = m.core.force_jacobians(np.ascontiguousarray(q), np.zeros(m.nv), np.zeros(m.n_inputs))[2]
    driven = np.abs(by_input[: m.nd]).any(axis=1)
    _, _, order = qr((along * np.where(driven, _DRIVEN, 1.0)[:, None]).T, mode="economic", pivoting=True)
    return [m.variables[i] for i in order[: along.shape[1]]]


def _unwound(m: Mechanism, q: Array, near: Array, angles: NDArray[np.intp]) -> Array:
    """Return a configuration with angles within half a turn of another, where that closes the loops as well."""
    found = q.copy()
    found[angles] -= 2.0 * np.pi * np.round((q[angles] - near[angles]) / (2.0 * np.pi))
    return found if _closes(m, found) else q


def _wound(m: Mechanism, q: Array, angles: NDArray[np.intp], costs: Callable[[Array], float]) -> Array:
    """Return a configuration with angles a turn further where that costs less and closes the loops as well.

    The same place may be a turn away from what is wanted, which counts turns.
    """
    best = q
    for i in angles:
        here = best
        for turn in (-2.0 * np.pi, 2.0 * np.pi):
            other = here.copy()
            other[i] += turn
            if costs(other) < costs(best) and _closes(m, other):
                best = other
    return best


def _closes(m: Mechanism, q: Array) -> bool:
    try:
        check_consistent(m, q)
    except InconsistentStartError:
        return False
    return True


def _state(system: MidpointSystem, q: Array, v: Array) -> Array:
    """Return the state (nx,) at a configuration with a velocity."""
    return system.integrator.start(q, v, t=float(system.t[0])).x


def _constraints(m: Mechanism) -> dict[str, Constraint]:
    return {name: each for name, each in m.elements.items() if isinstance(each, Constraint)}


def _closing(m: Mechanism, q: Array, moved: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the names of the constraints that say something of variables that are moved."""
    slope = np.abs(m.constraint_jacobian(q)[:, moved]).max(axis=1)
    touched = {name: bool(value > 0.0) for name, value in zip(m.constraints, slope, strict=True)}
    return tuple(n for n, each in _constraints(m).items() if any(touched[n + equation] for equation in each.equations))
