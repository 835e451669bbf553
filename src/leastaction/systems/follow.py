"""Following a wanted motion, given by the names of variables and frames, with any mechanism."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError, closest
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.legendre import to_momentum
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import State, Trajectory
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import (
    Array,
    as_array,
    as_number,
    as_times,
    read_only,
    require_instance,
    require_mapping,
)
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.names import matching
from leastaction.optimal.discrete.cost import Cost, QuadraticCost
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.optimize import optimize
from leastaction.optimal.quantity import Instants
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.systems.costs.places import PlaceCost
from leastaction.systems.costs.smooth import SmoothCost
from leastaction.systems.embedding import embed
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.warm_start import configurations_onto_constraints, velocities_onto_constraints

# Weights of what none is given for: of what is wanted, prescribed variables and their places to come, their
# accelerations, inputs, and the pose that reaches wanted frames.
_WANTED, _PLACE, _NEXT, _ACCELERATION, _INPUT, _POSE = 1.0, 1e-3, 1e-5, 1e-6, 1e-6, 1e-3
_ENDED = Status.INTERRUPTED, Status.STOPPED_BY_CALLBACK
_RIDGE = 1e-10  # of the least squares of inputs, in parts of their normal matrix
_STEPS, _CLOSE, _DAMPING = 100, 1e-8, 1e-6  # of the search for a pose whose frames are where they are wanted


class Wanted(Protocol):
    """A motion by the names of variables, such as `leastaction.io.Motion`."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its variables."""

    @property
    def t(self) -> Array:
        """Times (N+1,) (s)."""

    def __getitem__(self, name: str) -> Array:
        """Return the values (N+1,) of a variable."""


@dataclass(frozen=True, kw_only=True)
class Followed(Frozen):
    """A motion that follows a wanted one, the inputs that make it, and the gains that hold it.

    Frozen; threads may share it.

    Attributes
    ----------
    system : MidpointSystem
        Of the mechanism over the times of the motion, with multipliers in its state where it has constraints.
    wanted : mapping of str to ndarray
        What was wanted: (N+1,) of variables, (N+1, 3) of frames.
    result : OptimizationResult
        Of `optimize`: states, inputs, gains, limits, and how it ended.
    way : str
        From where it was found, in words.
    """

    system: MidpointSystem = field(repr=False)
    wanted: Mapping[str, Array] = field(repr=False)
    result: OptimizationResult = field(repr=False)
    way: str

    def __post_init__(self) -> None:
        wanted = {name: read_only(each) for name, each in self.wanted.items()}
        object.__setattr__(self, "wanted", MappingProxyType(wanted))
        super().__post_init__()

    @property
    def trajectory(self) -> Trajectory:
        """The motion, by names."""
        return self.system.trajectory(self.result.x, self.result.u)

    @property
    def errors(self) -> dict[str, float]:
        """Root mean square distance from what was wanted, by name (rad or m)."""
        m = self.system.integrator.mechanism
        q = np.ascontiguousarray(self.result.x[:, : m.nq])
        found = {}
        for name, goal in self.wanted.items():
            made = q[:, m.variables.index(name)] if goal.ndim == 1 else m.positions(q, [name])[:, 0]
            squares = (made - goal) ** 2
            found[name] = float(np.sqrt(np.mean(squares if goal.ndim == 1 else np.sum(squares, axis=1))))
        return found


def follow(
    mechanism: Mechanism,
    motion: Wanted | Mapping[str, ArrayLike],
    weights: Mapping[str, float] | None = None,
    limits: Sequence[Limit] = (),
    *,
    t: ArrayLike | None = None,
    start: State | None = None,
    max_iterations: int = 1000,
    tolerance: float = 1e-6,
    threads: int = 0,
    progress: Callable[[str], object] | None = None,
    **options: Any,
) -> Followed:
    """Find the motion of a mechanism that follows a wanted one best, with its inputs and gains.

    The wanted motion need not be possible, nor say anything of inputs, strings, or other variables. It is tried from
    the wanted motion itself, brought onto the constraints, with the inputs that it needs (inverse dynamics); with
    limits, from what is found without them; and by dynamic embedding (`embed`), where forces on all variables help at
    first. The first way that converges is taken.

    Parameters
    ----------
    mechanism : Mechanism
        An arm, a cart, a puppet: what moves it are its inputs and its kinematic variables.
    motion : Wanted or mapping of str to array_like
        A `leastaction.io.Motion`, or by name what is wanted at all times: values (N+1,) of variables, places (N+1, 3)
        of the origins of frames (m).
    weights : mapping of str to float, optional
        By names or patterns of them, of half the squares of: the distance of a wanted variable or frame from where it
        is wanted (1 if left out); the place of a kinematic variable that is not wanted, about where it goes along with
        the motion (1e-3); an input (1e-6); ``"acceleration of NAME"`` of a kinematic variable (1e-6); ``"momentum of
        NAME"``, about that of the wanted motion (0); a variable that is not wanted (0, but 1e-3 where frames are,
        about a pose that reaches them). Later ones count.
    limits : sequence of Limit, optional
        As of `optimize`. Tensions can be limited.
    t : array_like (N+1,), optional
        Times (s); needed where the motion is a mapping, and only there.
    start : State, optional
        Where it begins. If left out, at rest in the first wanted configuration, and what that does not say is zero, as
        far as constraints let it: give one where there are strings.
    max_iterations, tolerance, **options
        Of `optimize`.
    threads : int, optional
        Of the integrator.
    progress : callable, optional
        Called with a line of text when another way is tried.

    Returns
    -------
    Followed
        The motion that costs least of all that were found, where no way converges; its result says how it ended.

    Raises
    ------
    ArgumentError
        Unknown names, wrong shapes, negative weights, or no way that leads to any motion.
    InconsistentStartError
        A wanted motion that cannot be brought onto the constraints.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    weights = {} if weights is None else weights
    require_mapping(weights, "weights", "{'hand': 100.0}")
    m = mechanism
    wanted, times = _wanted(m, motion, t)
    if start is not None:
        require_instance(start, "start", State, "MidpointVI(mechanism).start(q) makes one of a configuration")
    system = MidpointSystem(MidpointVI(m, threads=threads), times, multipliers=m.nc > 0)
    x, u = _curve(system, wanted, start)
    cost = _cost(system, wanted, x, u, weights)
    solve = {"max_iterations": max_iterations, "tolerance": tolerance, **options}
    if m.n_inputs:
        u = _cheaper(system, cost, x, [_with_inputs(system, x, u), u])

    def directly() -> OptimizationResult:
        return optimize(system, cost, initial=(x, u), limits=limits, **solve)

    def without_limits() -> OptimizationResult:
        return optimize(system, cost, initial=optimize(system, cost, initial=(x, u), **solve), limits=limits, **solve)

    def with_help() -> OptimizationResult:
        found = embed(system, cost, initial=(x, u), limits=limits, **solve)
        if not found.success or found.result is None:
            raise ArgumentError(f"the help could not be removed: {found.message}")
        return found.result

    ways = {"from the wanted motion": directly, "from what is found without limits": without_limits}
    if not limits:
        del ways["from what is found without limits"]
    ways["by dynamic embedding"] = with_help
    best: Followed | None = None
    failure: LeastActionError | None = None
    for way, search in ways.items():
        if progress is not None:
            progress(f"looking for a motion {way}")
        try:
            result = search()
        except LeastActionError as error:
            failure = error
            continue
        found = Followed(system=system, wanted=wanted, result=result, way=way)
        if result.success or result.status in _ENDED:
            return found
        if best is None or (result.status is not Status.INFEASIBLE, -result.cost) > (
            best.result.status is not Status.INFEASIBLE,
            -best.result.cost,
        ):
            best = found
    if best is None:
        raise ArgumentError(f"follow: no way leads to a motion of the mechanism; at last: {failure}") from failure
    return best


def _wanted(
    m: Mechanism, motion: Wanted | Mapping[str, ArrayLike], t: ArrayLike | None
) -> tuple[dict[str, Array], Array]:
    """Return what is wanted by names, and the times."""
    if isinstance(motion, Mapping):
        if t is None:
            raise ArgumentError("t: got none, expected the times of the motion, (N+1,)")
        times, given = as_times(t), dict(motion)
    else:
        if not all(hasattr(motion, name) for name in ("t", "names")):
            raise ArgumentError(
                f"motion: got {type(motion).__name__}, expected a Motion, or by name what is wanted: a mapping"
            )
        if t is not None:
            raise ArgumentError("t: the motion has times of its own, expected none; use its resample()")
        times, given = as_times(motion.t), {name: motion[name] for name in motion.names}
    if not given:
        raise ArgumentError("motion: got nothing that is wanted, expected values of variables or places of frames")
    found = {}
    for name, values in given.items():
        if name not in m.variables and name not in m.frames:
            known = closest(name, (*m.variables, *m.frames), what="variables and frames")
            raise ArgumentError(f"motion: nothing is called {name!r}; {known}")
        shapes = [(len(times),)] * (name in m.variables) + [(len(times), 3)] * (name in m.frames)
        found[name] = as_array(values, f"motion: {name!r}", *shapes, meaning="one row for each time")
    return found, times


def _curve(system: MidpointSystem, wanted: Mapping[str, Array], start: State | None) -> tuple[Array, Array]:
    """Return states and inputs of the wanted motion, brought onto the constraints, without inputs."""
    m, t = system.integrator.mechanism, system.t
    q = np.zeros((len(t), m.nq)) if start is None else np.tile(start.q, (len(t), 1))
    known = np.zeros(m.nq, dtype=np.bool_)
    places = {}
    for name, values in wanted.items():
        if values.ndim == 1:
            known[m.variables.index(name)] = True
            q[:, m.variables.index(name)] = values
        else:
            places[name] = values
    free = np.flatnonzero(~known[: m.nd])

    def reach(k: int, at: Array) -> None:
        _reach(m, at, free, {name: values[k] for name, values in places.items()})

    configurations_onto_constraints(m, q, known, start, reach if places else None)
    v = np.gradient(q, t, axis=0)
    if places:
        known[: m.nd] = True
    v[:, ~known] = 0.0
    velocities_onto_constraints(m, q, v, known)
    x = np.zeros((len(t), system.nx))
    x[:, : m.nq] = q
    x[:, m.nq : m.nq + m.nd] = to_momentum(m, q, v)
    x[1:, m.nq + m.nd : m.nx] = np.diff(q[:, m.nd :], axis=0) / np.diff(t)[:, None]
    x[0, : m.nx] = (system.integrator.start(q[0]) if start is None else start).x
    return x, np.hstack([np.zeros((system.N, m.n_inputs)), q[1:, m.nd :]])


def _cheaper(system: MidpointSystem, cost: Cost, x: Array, candidates: Sequence[Array]) -> Array:
    """Return the inputs with which the projection of a curve costs least."""
    costs = []
    for u in candidates:
        try:
            costs.append(optimize(system, cost, initial=(x, u), max_iterations=0).cost)
        except LeastActionError:
            costs.append(np.inf)
    return candidates[int(np.argmin(costs))]


def _with_inputs(system: MidpointSystem, x: Array, u: Array) -> Array:
    """Return inputs with those that make a motion as nearly as inputs can, by inverse dynamics between the instants."""
    m, dt = system.integrator.mechanism, np.diff(system.t)[:, None]
    q = x[:, : m.nq]
    v = np.gradient(q, system.t, axis=0)
    middle, speed, change = 0.5 * (q[1:] + q[:-1]), np.diff(q, axis=0) / dt, np.diff(v, axis=0) / dt
    dynamics = ContinuousDynamics(m)

    def missing(inputs: Array, multipliers: Array) -> Array:
        shape = (system.N, 1)
        given = np.tile(multipliers, shape), np.tile(inputs, shape)
        return dynamics.inverse_dynamics(middle, speed, change, given[0], u=given[1])[:, : m.nd]

    still, none = np.zeros(m.n_inputs), np.zeros(m.nc)
    needed = missing(still, none)
    each = [needed - missing(one, none) for one in np.eye(m.n_inputs)]
    each += [needed - missing(still, one) for one in np.eye(m.nc)]
    effect = np.stack(each, axis=2)
    square = np.swapaxes(effect, 1, 2) @ effect
    size = np.trace(square, axis1=1, axis2=2)[:, None, None]
    square += (_RIDGE * size + np.finfo(np.float64).tiny) * np.eye(square.shape[-1])
    found = np.linalg.solve(square, np.swapaxes(effect, 1, 2) @ needed[:, :, None])[:, :, 0]
    result = u.copy()
    result[:, : m.n_inputs] = found[:, : m.n_inputs]
    return result


def _reach(m: Mechanism, q: Array, free: Instants, places: Mapping[str, Array]) -> None:
    """Move variables of a configuration, in place, until frames are as near to their places as they come."""
    names = list(places)
    goal = np.concatenate([places[name] for name in names])

    def away(q: Array) -> Array:
        return np.asarray(m.positions(q, names).ravel() - goal)

    damping, off = _DAMPING, away(q)
    for _ in range(_STEPS):
        J = np.vstack([m.frame_jacobian(q, name)[:3, free] for name in names])
        step = np.linalg.solve(J.T @ J + damping * np.eye(len(free)), -J.T @ off)
        if np.abs(step).max() < _CLOSE:
            return
        trial = q.copy()
        trial[free] += step
        found = away(trial)
        if found @ found <= off @ off:
            q[:], off, damping = trial, found, max(_DAMPING, 0.1 * damping)
        else:
            damping *= 10.0


def _cost(
    system: MidpointSystem, wanted: Mapping[str, Array], x: Array, u: Array, weights: Mapping[str, float]
) -> Cost:
    m = system.integrator.mechanism
    # Where frames are wanted, so is the pose that reaches them, a little: what they leave open is not left to wander.
    reached = any(values.ndim == 2 for values in wanted.values())
    value = {name: _PLACE if name in m.kinematic else _POSE * reached for name in m.variables}
    value |= dict.fromkeys(m.inputs, _INPUT) | dict.fromkeys(wanted, _WANTED)
    value |= {f"acceleration of {name}": _ACCELERATION for name in m.kinematic}
    value |= {f"momentum of {name}": 0.0 for name in m.dynamic}
    names = list(value)
    for pattern, weight in weights.items():
        chosen = [names[i] for i in matching(names, pattern)]
        if not chosen:
            raise ArgumentError(f"weights: nothing is called {pattern!r}; {closest(pattern, names, what='names')}")
        value |= dict.fromkeys(chosen, as_number(weight, f"weights: {pattern!r}", least=0.0))
    goal = x.copy()
    for name, values in wanted.items():
        if values.ndim == 1:
            goal[:, m.variables.index(name)] = values
    Q = np.zeros(system.nx)
    Q[: m.nq] = [value[name] if wanted.get(name, x[0]).ndim == 1 else 0.0 for name in m.variables]
    Q[m.nq : m.nq + m.nd] = [value[f"momentum of {name}"] for name in m.dynamic]
    # Of places to come a little is weighed too, as every input has to be.
    R = np.concatenate([[value[name] for name in m.inputs], np.full(m.nrho, _NEXT)])
    if (R <= 0.0).any():
        raise ArgumentError(f"weights: input {m.inputs[int(np.argmin(R))]!r} has none, expected a positive one")
    cost: Cost = QuadraticCost(goal, u, Q=Q, R=R)
    places = {name: values for name, values in wanted.items() if values.ndim == 2}
    if places:
        cost = PlaceCost(cost, system, places, value)
    if m.nrho:
        cost = SmoothCost(cost, system, {name: value[f"acceleration of {name}"] for name in m.kinematic})
    return cost
