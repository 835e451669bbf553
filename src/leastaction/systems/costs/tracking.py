"""Costs in the user's words: wanted motions by name, effort, and the times at which they count."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.discrete.prescribed import inputs_along
from leastaction.mechanics.mechanism.arguments import configuration_on
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number, require_instance, require_mapping
from leastaction.numerics.names import matching
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import QuadraticCost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.orientations import quaternions_of

Wanted = Mapping[str, float | ArrayLike | Callable[[float], float]] | ArrayLike | None
"""Values over the instants by name: a number, (N+1,), or a function of the time (s); or states (N+1, nx) or (nx,)."""

_LEAST_EFFORT = 1e-9  # price of an input that has none: without one there need be no minimum


@public
def tracking(
    system: DiscreteSystem,
    weights: Mapping[str, float],
    wanted: Wanted = None,
    *,
    effort: float | Mapping[str, float] = 1e-3,
    inputs: Wanted = None,
    final: Mapping[str, float] | None = None,
    during: tuple[float, float] | None = None,
) -> QuadraticCost:
    """Return the cost of being off a wanted motion, by the names of a system.

    Parameters
    ----------
    system : DiscreteSystem
    weights : mapping of str to float
        Of half the squares, by names of entries of the state with wildcards, in units of the cost by theirs squared:
        ``{"left_elbow": 100, "p_*": 1e-3}``. Of a `MidpointSystem` ``"left_elbow.v"`` is the velocity of a variable
        (``"*.v"`` that of all), with the inertia at the wanted motion. A later name overrides an earlier one. Of a
        joint whose rotation is a quaternion ``"hips.wx"`` is the rotation that is missing about that axis of it (rad),
        and ``"hips.wx.v"`` its angular velocity.
    wanted : mapping, or array_like (N+1, nx) or (nx,), optional
        What is wanted, by name: a number, (N+1,) values, or a function of the time (s); or whole states. Zero if left
        out, velocities too. Of a joint whose rotation is a quaternion, by its name, the rotation: (3, 3) or
        (N+1, 3, 3), or a function; none if left out.
    effort : float or mapping of str to float, optional
        Weights of the inputs.
    inputs : mapping, or array_like (N, nu) or (nu,), optional
        Wanted inputs; zero if left out, of prescribed variables where they are wanted a step later.
    final : mapping of str to float, optional
        Weights of the last state; those of all others if left out.
    during : (float, float), optional
        First and last time (s) at which `weights` count; always if left out.

    Returns
    -------
    QuadraticCost

    Raises
    ------
    ArgumentError
        Unknown names, negative weights, or wrong shapes.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import MidpointSystem, MidpointVI
    >>> from leastaction.costs import tracking
    >>> from leastaction.models.cart_pendulum import cart_pendulum
    >>> system = MidpointSystem(MidpointVI(cart_pendulum()), np.linspace(0.0, 1.0, 51))
    >>> cost = tracking(system, {"theta": 100.0, "*.v": 0.1}, {"theta": np.pi}, effort={"x-force": 1e-3})
    >>> cost.Q.shape, cost.x_wanted[0, 1].round(3)
    ((50, 4, 4), np.float64(3.142))
    """
    require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
    m = system.mechanism if isinstance(system, MidpointSystem) else None
    if m is None and system.charts() is not None:
        raise ArgumentError("system: its states are no plain vectors; give a QuadraticCost with its `space`")
    x = np.zeros((system.N + 1, system.nx))
    if m is not None:
        x[:, : m.nq] = m.configuration()
        wanted = _without_rotations(m, wanted, system.times, x)
    x = _over_time(system, wanted, system.state_names, x, "wanted")
    if m is not None:
        x[:, : m.nq] = configuration_on(m, x[:, : m.nq], "wanted")
    u = _over_time(system, inputs, system.input_names, np.zeros((system.N, system.nu)), "inputs")
    if m is not None and m.nrho and inputs is None:
        u[:, m.n_inputs :] = inputs_along(m, x[:, m.first_rho : m.nq])
    prices = {"*": effort} if not isinstance(effort, Mapping) else effort
    R = np.full(system.nu, _LEAST_EFFORT)
    for name, weight in prices.items():
        places = matching(system.input_names, name)
        if not places:
            raise unknown("input", name, system.input_names, "effort")
        R[places] = as_number(weight, f"effort[{name!r}]", above=0.0)
    Q = _weights(system, weights, x, "weights")
    Q_final = Q[-1] if final is None else _weights(system, final, x[-1:], "final")[0]
    Q = Q[:-1] if len(Q) > 1 else Q
    if during is not None:
        first, last = (as_number(each, "during (s)") for each in during)
        times = system.times[:-1]
        counts = (times >= first - 1e-9) & (times <= last + 1e-9)
        if not counts.any():
            raise ArgumentError(
                f"during: got {first:g} to {last:g} s, expected some of {times[0]:g} to {times[-1]:g} s"
            )
        Q = np.broadcast_to(Q, (system.N, *Q.shape[1:])) * counts.reshape(-1, *(1,) * (Q.ndim - 1))
    if Q.ndim == 2 and not (Q - Q[0]).any():
        Q = Q[0]
    elif Q.ndim == 2:
        Q = Q[:, :, None]
    elif len(Q) == 1:
        Q = Q[0]
    return QuadraticCost(x, u, Q=Q, R=R, Q_final=Q_final, space=system)


def _without_rotations(m: Mechanism, wanted: Wanted, t: Array, x: Array) -> Wanted:
    """Write rotations that are wanted by the names of joints into states x (N+1, nx); return what else is wanted."""
    joints = {rotation.name: rotation for rotation in m.tree.rotations}
    if not isinstance(wanted, Mapping) or joints.keys().isdisjoint(wanted):
        return wanted
    for name in joints.keys() & wanted.keys():
        first = m.coordinates.index(joints[name].quaternion[0])
        given: Any = wanted[name]
        x[:, first : first + 4] = quaternions_of(given, f"wanted[{name!r}]", t)
    return {name: value for name, value in wanted.items() if name not in joints}


def _over_time(system: DiscreteSystem, wanted: Wanted, names: Sequence[str], out: Array, what: str) -> Array:
    """Write what is wanted into an array (rows, n), and return it."""
    rows, n = out.shape
    if wanted is None:
        return out
    if not isinstance(wanted, Mapping):
        given = as_array(wanted, what, (rows, n), (n,), names=names)
        out[:] = given
        return out
    times = system.times[:rows]
    for name, value in wanted.items():
        places = matching(names, name)
        if not places:
            raise unknown("name", name, names, what)
        values: Any = [value(float(at)) for at in times] if callable(value) else value
        row = as_array(values, f"{what}[{name!r}]", (), (rows,), meaning=f"a number, or ({rows},) values")
        out[:, places] = row[:, None] if row.ndim else row
    return out


def _weights(system: DiscreteSystem, weights: Mapping[str, float], x: Array, what: str) -> Array:
    """Return weights (1 or n, ndx), or matrices (n, ndx, ndx) where velocities have some, along states (n, nx)."""
    require_mapping(weights, what, "{'elbow': 100.0, '*.v': 1.0}")
    names, m = system.state_names, system.mechanism if isinstance(system, MidpointSystem) else None
    if m is not None:
        names = (*m.variables, *names[m.nq :])  # of differences
    of_entries, of_rates = np.zeros(len(names)), np.zeros(0 if m is None else m.nv)
    for name, given in weights.items():
        weight = as_number(given, f"{what}[{name!r}]", least=0.0)
        places = matching(names, name)
        rates = [] if m is None or not name.endswith(".v") else matching(m.variables, name.removesuffix(".v"))
        if not places and not rates:
            known = (*names, *(f"{each}.v" for each in (() if m is None else m.variables)))
            raise unknown("name", name, known, what)
        of_entries[places] = weight
        of_rates[rates] = weight
    if m is None or not of_rates.any():
        return of_entries[None]
    out = np.empty((len(x), len(names), len(names)))
    momenta = slice(m.nv, m.nv + m.nd)
    for k, state in enumerate(x):
        out[k] = np.diag(of_entries)
        M = np.asarray(m.mass_matrix(np.ascontiguousarray(state[: m.nq])))
        # p = M_dd v + M_dr v_rho, so v is by both.
        by = np.zeros((m.nv, len(names)))
        inverse = np.linalg.inv(M[: m.nd, : m.nd])
        by[: m.nd, momenta] = inverse
        rho = slice(m.nv + m.nd, m.ndx)
        by[: m.nd, rho] = -inverse @ M[: m.nd, m.nd :]
        by[m.nd :, rho] = np.eye(m.nrho)
        out[k] += by.T @ (of_rates[:, None] * by)
    return out
