"""Warm starts: a motion that was found for one system as the start for another, by names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError, InconsistentStartError, unknown
from leastaction.mechanics.configuration.assembly import project_configuration, project_velocity
from leastaction.mechanics.continuous.legendre import to_momentum, to_velocity
from leastaction.mechanics.discrete.prescribed import inputs_along
from leastaction.mechanics.discrete.trajectory import State
from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.mechanism.arguments import single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import interpolated, of_coordinates
from leastaction.numerics.arrays import Array, as_array, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.starts import StartResult
from leastaction.optimal.starts.coarse_to_fine import columns
from leastaction.systems.midpoint import MidpointSystem

# Of the change that brings a configuration onto the constraints: variables that are known hardly take part.
_KNOWN, _NEW = 1e3, 1.0
_ROUNDS = 3  # of reaching for where it is wanted, and back onto the constraints
_ATTEMPTS = 10  # for the first, where zero may be no guess at all, such as of the length of a string


@public
def warm_start(
    found: OptimizationResult | StartResult | tuple[ArrayLike, ArrayLike],
    from_system: MidpointSystem,
    to_system: MidpointSystem,
    *,
    start: State | None = None,
    rename: Mapping[str, str] | None = None,
) -> tuple[Array, Array]:
    """Return the start for one system that is closest to a motion of another, by the names of all that is in both.

    The other one may have another horizon, time step, mechanism (with more variables, other masses, strings in place of
    motors) or other multipliers in its state. Configurations and velocities are interpolated in time, those of a
    variable that is new are those of `start`; both are brought onto the constraints, mostly by the variables that are
    new, and give the momenta. Inputs that are new are zero, multipliers too.

    Parameters
    ----------
    found : OptimizationResult, StartResult or (x, u)
        The motion: x (N+1, nx), u (N, nu) of `from_system`.
    from_system, to_system : MidpointSystem
        The system that it belongs to, and the one that is to be started.
    start : State, optional
        The initial state of the new system, such as ``integrator.start(q, v)``. If left out, it is that of the motion,
        with zero for variables that are new, brought onto the constraints.
    rename : mapping of str to str, optional
        New names by the old ones, of variables, inputs and constraints that are called differently.

    Returns
    -------
    x, u : ndarray (N+1, nx), (N, nu)
        For ``optimize(to_system, cost, initial=(x, u))``, which projects them onto a trajectory. Before and after the
        times of the motion its first and last configurations are held, at rest, and the inputs too.

    Raises
    ------
    ArgumentError
        What is no `MidpointSystem`, wrong shapes, unknown names, systems without a variable in common.
    InconsistentStartError
        A configuration that cannot be brought onto the new constraints.
    """
    for what, system in (("from_system", from_system), ("to_system", to_system)):
        require_instance(system, what, MidpointSystem)
    old, new = from_system.mechanism, to_system.mechanism
    x, u = _arrays(found, from_system)
    names = _names(old, rename)
    variables, places = ([names.get(name, name) for name in each] for each in (old.variables, old.coordinates))
    known = [name in variables for name in new.variables]
    if not any(known):
        raise ArgumentError(
            f"from_system, to_system: no variable of {', '.join(new.variables)} is among {', '.join(variables)}, "
            "expected some; give `rename` where they are called differently"
        )
    t, times = from_system.t, to_system.t
    q, v = _motion(old, x, t)
    lam = x[:, old.nx :] / np.append(t[1] - t[0], np.diff(t))[:, None] if from_system.multipliers else None

    first = new.configuration() if start is None else single(new, start.q, "start.q")
    configurations, between = np.tile(first, (len(times), 1)), interpolated(old, q, t, times)
    velocities = np.zeros((len(times), new.nv))
    outside = (times < t[0]) | (times > t[-1])
    for i, name in enumerate(new.coordinates):
        if name in places:
            configurations[:, i] = between[:, places.index(name)]
    for i, name in enumerate(new.variables):
        if known[i]:
            column = variables.index(name)
            velocities[:, i] = np.where(outside, 0.0, np.interp(times, t, v[:, column]))
    configurations_onto_constraints(new, times, configurations, np.array(known), start)
    velocities_onto_constraints(new, times, configurations, velocities, np.array(known))
    steps, momenta = np.diff(times), to_momentum(new, configurations, velocities)
    result = to_system.states_along(configurations, momenta, velocities[0, new.nd :])
    if start is not None:
        result[0, : new.nx] = start.x
    if to_system.multipliers and lam is not None:
        constraints = [names.get(name, name) for name in old.constraints]
        both = [(i, constraints.index(name)) for i, name in enumerate(new.constraints) if name in constraints]
        lengths = np.append(steps[0], steps)
        for i, column in both:  # an impulse: as long as the step
            result[:, new.nx + i] = np.interp(times, t, lam[:, column]) * lengths

    inputs = np.zeros((to_system.N, to_system.nu))
    spoken = [names.get(name, name) for name in old.inputs]
    middles = 0.5 * (times[1:] + times[:-1])
    given = columns(u[:, : old.n_inputs], 0.5 * (t[1:] + t[:-1]), middles)
    for i, name in enumerate(new.inputs):
        if name in spoken:
            inputs[:, i] = given[:, spoken.index(name)]
    inputs[:, new.n_inputs :] = inputs_along(new, configurations[:, new.first_rho :])
    return result, inputs


def _arrays(found: object, system: MidpointSystem) -> tuple[Array, Array]:
    """Return states and inputs of a motion, checked."""
    if isinstance(found, (OptimizationResult, StartResult)):
        x, u = found.x, found.u
    elif isinstance(found, (tuple, list)) and len(found) == 2:
        x, u = found
    else:
        raise ArgumentError(f"found: got {type(found).__name__}, expected a result of optimize, or a pair (x, u)")
    return (
        as_array(x, "x", (system.N + 1, system.nx), meaning="(N+1, nx) of from_system"),
        as_array(u, "u", (system.N, system.nu), meaning="(N, nu) of from_system"),
    )


def _names(old: Mechanism, rename: Mapping[str, str] | None) -> dict[str, str]:
    """Return the new names of those that change."""
    given = dict(rename or {})
    known = (*dict.fromkeys((*old.variables, *old.coordinates)), *old.inputs, *old.constraints)
    for name in given:
        if name not in known:
            raise unknown("name", name, known, "rename")
    return given


def _motion(m: Mechanism, x: Array, t: Array) -> tuple[Array, Array]:
    """Return configurations (N+1, nq) and velocities (N+1, nv) of states."""
    q, p, v_rho = x[:, : m.nq], x[:, m.nq : m.nq + m.nd], x[:, m.nq + m.nd : m.nx]
    if len(t) > 2:
        # Velocities over steps stand at their middles; at an instant it is the mean of two.
        v_rho = np.vstack([v_rho[:1], 0.5 * (v_rho[1:-1] + v_rho[2:]), v_rho[-1:]])
    return q, to_velocity(m, q, p, v_rho, keep_constraints=m.nc > 0, t=t)


def configurations_onto_constraints(
    m: Mechanism,
    t: Array,
    q: Array,
    known: NDArray[np.bool_],
    start: State | None,
    reach: Callable[[int, Array], None] | None = None,
) -> None:
    """Bring configurations at times (N+1,) onto the constraints, in place, by what is not known if that is enough.

    ``reach``: moves the configuration of an instant, in place, to where it is wanted; what is not known of it, and what
    is reached, begins as it was an instant before.
    """
    if start is not None:
        q[0] = start.q
    projected = _projection(m, known)
    strings = {element.length_variable for element in m.elements.values() if isinstance(element, Constraint)}
    kept = of_coordinates(m, known)
    lengths = [i for i, name in enumerate(m.coordinates) if name in strings and not kept[i]]
    for k in range(len(q)):
        if k > 0:
            q[k, ~kept] = q[k - 1, ~kept]
        if k > 0 or start is None:
            for _ in range(1 if reach is None else _ROUNDS):
                if reach is not None:
                    reach(k, q[k])
                if m.nc > 0:
                    q[k] = projected(
                        project_configuration, m.at_time(t[k]), q[k], attempts=_ATTEMPTS if k == 0 else 1
                    ).q
        if k == 0 and start is None:
            q[k, lengths] = np.abs(q[k, lengths])  # the square of a distance is met by its mirrored length too


def velocities_onto_constraints(m: Mechanism, t: Array, q: Array, v: Array, known: NDArray[np.bool_]) -> None:
    """Bring velocities onto the constraints, in place, as configurations are."""
    if m.nc == 0:
        return
    projected = _projection(m, known)
    for k in range(len(q)):
        if k > 0:
            v[k, ~known] = v[k - 1, ~known]
        v[k] = projected(project_velocity, m.at_time(t[k]), q[k], v[k]).v


def _projection(m: Mechanism, known: NDArray[np.bool_]) -> Callable[..., Any]:
    """Return a call of a projection that holds what is known.

    It is held where anything else is left to move; if that is not enough, it gives way a little, and the kinematic
    variables too where they are out of reach.
    """
    moves = not known[m.nd :].all()
    held = [name for name, is_known in zip(m.variables, known, strict=True) if is_known]
    weights = np.where(known, _KNOWN, _NEW)
    ways: list[dict[str, Any]] = [{"weights": weights, "move_kinematic": moves}]
    if m.nrho and not moves:
        ways.append({"weights": weights, "move_kinematic": True})
    if not known.all():
        ways.insert(0, {"hold": held, "move_kinematic": moves})

    def projected(function: Callable[..., Any], *given: Any, **options: Any) -> Any:
        for way in ways[:-1]:
            try:
                return function(*given, **way, **options)
            except InconsistentStartError:
                continue
        return function(*given, **ways[-1], **options)

    return projected
