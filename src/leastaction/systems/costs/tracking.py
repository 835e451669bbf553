"""Costs in the user's words: wanted motions by name, effort, and the times at which they count."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.discrete.prescribed import inputs_along
from leastaction.mechanics.mechanism.arguments import configuration_on
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number, require_instance
from leastaction.numerics.names import matching
from leastaction.numerics.public import public
from leastaction.optimal.continuous.cost import ContinuousQuadraticCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.cost import QuadraticCost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.systems.costs.flowing import tracking_over_time
from leastaction.systems.costs.words import prices_of_effort, rotations_of, weights_by_name
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.orientations import quaternions_of

Wanted = Mapping[str, float | ArrayLike | Callable[[float], float]] | ArrayLike | None
"""Values over the instants by name: a number, (N+1,), or a function of the time (s); or states (N+1, nx) or (nx,)."""

_SINGULAR = 1e13  # entry of the inverse of a mass matrix, scaled to a diagonal of ones, that has no digits


@overload
def tracking(
    system: DiscreteSystem,
    weights: Mapping[str, float],
    wanted: Wanted = ...,
    *,
    effort: float | Mapping[str, float] = ...,
    inputs: Wanted = ...,
    final: Mapping[str, float] | None = ...,
    during: tuple[float, float] | None = ...,
) -> QuadraticCost: ...


@overload
def tracking(
    system: ContinuousSystem,
    weights: Mapping[str, float],
    wanted: Wanted | Callable[[float], ArrayLike] = ...,
    *,
    effort: float | Mapping[str, float] = ...,
    inputs: Wanted | Callable[[float], ArrayLike] = ...,
    final: Mapping[str, float] | None = ...,
    during: tuple[float, float] | None = ...,
) -> ContinuousQuadraticCost: ...


@public
def tracking(
    system: DiscreteSystem | ContinuousSystem,
    weights: Mapping[str, float],
    wanted: Wanted | Callable[[float], ArrayLike] = None,
    *,
    effort: float | Mapping[str, float] = 1e-3,
    inputs: Wanted | Callable[[float], ArrayLike] = None,
    final: Mapping[str, float] | None = None,
    during: tuple[float, float] | None = None,
) -> QuadraticCost | ContinuousQuadraticCost:
    """Return the cost of being off a wanted motion, by the names of a system.

    In continuous time `weights` and `effort` count by the second, and the last state only where `final` says so.

    Parameters
    ----------
    system : DiscreteSystem or ContinuousSystem
    weights : mapping of str to float
        Of half the squares, by names of entries of the state with wildcards, in units of the cost by theirs squared:
        ``{"left_elbow": 100, "p_*": 1e-3}``. Of a `MidpointSystem` ``"left_elbow.v"`` is the velocity of a variable
        (``"*.v"`` that of all), with the inertia at the wanted motion; of a `MechanismSystem` it is that entry of the
        state. A later name overrides an earlier one. Of a joint whose rotation is a quaternion ``"hips.wx"`` is the
        rotation that is missing about that axis of it (rad), and ``"hips.wx.v"`` its angular velocity; ``"hips"`` and
        ``"hips.v"`` are those about all three.
    wanted : mapping, or array_like (N+1, nx) or (nx,), or callable, optional
        What is wanted, by name: a number, (N+1,) values, or a function of the time (s); or whole states. Zero if left
        out, velocities too. Of a joint whose rotation is a quaternion, by its name, the rotation: a matrix
        (3, 3), a unit quaternion (4,), scalar first, one for each instant, or a function; none if left out. In
        continuous time a `PiecewisePolynomial` through samples takes the place of rows, and the whole state may be one,
        or another function of the time.
    effort : float or mapping of str to float, optional
        Weights of the inputs.
    inputs : mapping, or array_like (N, nu) or (nu,), or callable, optional
        Wanted inputs; zero if left out, in discrete time of prescribed variables where they are wanted a step later.
    final : mapping of str to float, optional
        Weights of the last state; those of all others if left out, in continuous time none.
    during : (float, float), optional
        First and last time (s) at which `weights` count; always if left out.

    Returns
    -------
    QuadraticCost, or ContinuousQuadraticCost of a ContinuousSystem

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
    if isinstance(system, ContinuousSystem):
        return tracking_over_time(system, weights, wanted, effort=effort, inputs=inputs, final=final, during=during)
    require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem or a MechanismSystem")
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
    R = prices_of_effort(system, effort)
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


def _without_rotations(m: Mechanism, wanted: Any, t: Array, x: Array) -> Any:
    """Write rotations that are wanted by the names of joints into states x (N+1, nx); return what else is wanted."""
    firsts = rotations_of(m)
    if not isinstance(wanted, Mapping) or firsts.keys().isdisjoint(wanted):
        return wanted
    for name in firsts.keys() & wanted.keys():
        given: Any = wanted[name]
        x[:, firsts[name] : firsts[name] + 4] = quaternions_of(given, f"wanted[{name!r}]", t)
    return {name: value for name, value in wanted.items() if name not in firsts}


def _over_time(system: DiscreteSystem, wanted: Any, names: Sequence[str], out: Array, what: str) -> Array:
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
    names, m = system.state_names, system.mechanism if isinstance(system, MidpointSystem) else None
    if m is not None:
        names = (*m.variables, *names[m.nq :])  # of differences
    found = weights_by_name(weights, names, () if m is None else m.variables, len(names), what)
    of_entries, of_rates = found[: len(names)], found[len(names) :]
    if m is None or not of_rates.any():
        return of_entries[None]
    out = np.empty((len(x), len(names), len(names)))
    momenta = slice(m.nv, m.nv + m.nd)
    for k, state in enumerate(x):
        out[k] = np.diag(of_entries)
        M = np.asarray(m.mass_matrix(np.ascontiguousarray(state[: m.nq])))
        # p = M_dd v + M_dr v_rho, so v is by both.
        by = np.zeros((m.nv, len(names)))
        by[: m.nd, momenta] = inverse = _inverse(M[: m.nd, : m.nd], f"{what}: got some of velocities", k)
        rho = slice(m.nv + m.nd, m.ndx)
        by[: m.nd, rho] = -inverse @ M[: m.nd, m.nd :]
        by[m.nd :, rho] = np.eye(m.nrho)
        out[k] += by.T @ (of_rates[:, None] * by)
    return out


def _inverse(M: Array, what: str, k: int) -> Array:
    """Return the inverse of a mass matrix, or complain of one that has none."""
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    with suppress(np.linalg.LinAlgError):
        found = np.linalg.inv(M / scale) if scale.all() else np.full(M.shape, np.inf)
        if np.abs(found).max(initial=0.0) < _SINGULAR:
            return np.asarray(found / scale)
    raise ArgumentError(
        f"{what}, and the mass matrix is singular at instant {k} of the wanted motion (zero where nothing is "
        "wanted), as of joints without a mass between them; expected another wanted motion, weights of momenta, 'p_*', "
        "or masses"
    )
