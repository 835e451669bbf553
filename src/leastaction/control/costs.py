"""Costs in the user's words: wanted motions by name, effort, times at which they count, sums, and residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.numerics.arrays import (
    Array,
    as_array,
    as_choice,
    as_number,
    read_only,
    require_instance,
    require_mapping,
)
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.names import matching
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.discrete.cost import Cost, CostGradient, QuadraticCost
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.systems.midpoint import MidpointSystem

Wanted = Mapping[str, float | ArrayLike | Callable[[float], float]] | ArrayLike | None
"""Values over the instants by name: a number, (N+1,), or a function of the time (s); or states (N+1, nx) or (nx,)."""

_LEAST_EFFORT = 1e-9  # price of an input that has none: without one there need be no minimum


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
        (``"*.v"`` that of all), with the inertia at the wanted motion. A later name overrides an earlier one.
    wanted : mapping, or array_like (N+1, nx) or (nx,), optional
        What is wanted, by name: a number, (N+1,) values, or a function of the time (s); or whole states. Zero if left
        out, velocities too.
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
    >>> from leastaction.control import tracking
    >>> from leastaction.models.cart_pendulum import cart_pendulum
    >>> system = MidpointSystem(MidpointVI(cart_pendulum()), np.linspace(0.0, 1.0, 51))
    >>> cost = tracking(system, {"theta": 100.0, "*.v": 0.1}, {"theta": np.pi}, effort={"x-force": 1e-3})
    >>> cost.Q.shape, cost.x_wanted[0, 1].round(3)
    ((50, 4, 4), np.float64(3.142))
    """
    require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
    x = _over_time(system, wanted, system.state_names, system.N + 1, "wanted")
    u = _over_time(system, inputs, system.input_names, system.N, "inputs")
    m = system.mechanism if isinstance(system, MidpointSystem) else None
    if m is not None and m.nrho and inputs is None:
        u[:, m.n_inputs :] = x[1:, m.nd : m.nq]
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
    return QuadraticCost(x, u, Q=Q, R=R, Q_final=Q_final)


def _over_time(system: DiscreteSystem, wanted: Wanted, names: Sequence[str], rows: int, what: str) -> Array:
    """Return what is wanted as an array (rows, n) of one's own."""
    n, out = len(names), np.zeros((rows, len(names)))
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
    """Return weights (1 or n, nx), or matrices (n, nx, nx) where velocities have some, along states (n, nx)."""
    require_mapping(weights, what, "{'elbow': 100.0, '*.v': 1.0}")
    names, m = system.state_names, system.mechanism if isinstance(system, MidpointSystem) else None
    of_entries, of_rates = np.zeros(len(names)), np.zeros(0 if m is None else m.nq)
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
    momenta = slice(m.nq, m.nq + m.nd)
    for k, state in enumerate(x):
        out[k] = np.diag(of_entries)
        M = np.asarray(m.mass_matrix(np.ascontiguousarray(state[: m.nq])))
        # p = M_dd v + M_dr v_rho, so v is by both.
        by = np.zeros((m.nq, len(names)))
        inverse = np.linalg.inv(M[: m.nd, : m.nd])
        by[: m.nd, momenta] = inverse
        rho = slice(m.nq + m.nd, m.nx)
        by[: m.nd, rho] = -inverse @ M[: m.nd, m.nd :]
        by[m.nd :, rho] = np.eye(m.nrho)
        out[k] += by.T @ (of_rates[:, None] * by)
    return out


class CostSum(Cost):
    """The sum of costs; as fit for several threads as they are.

    Parameters
    ----------
    costs : sequence of Cost
        At least one, all for the same horizon.

    Raises
    ------
    ArgumentError
        What is no cost.
    """

    def __init__(self, costs: Sequence[Cost]) -> None:
        self.costs = tuple(costs)
        if not self.costs:
            raise ArgumentError("costs: got none, expected at least one cost")
        for each in self.costs:
            require_instance(each, "costs", Cost, "such as a QuadraticCost")
        self.nonnegative = all(each.nonnegative for each in self.costs)

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        for each in self.costs:
            each.check_shapes(N, nx, nu)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return np.asarray(sum(each.stage_values(x, u, start) for each in self.costs))

    def final_value(self, x: Array) -> float:
        return float(sum(each.final_value(x) for each in self.costs))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        found = [each.gradient(x, u) for each in self.costs]
        return CostGradient(*(np.asarray(sum(parts)) for parts in zip(*found, strict=True)))

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return _added([each.hessian(x, u) for each in self.costs])

    def convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the sum of the convex parts; see `Cost`."""
        return _added([each.convex_hessian(x, u) for each in self.costs])

    def window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        return CostSum([each.window(start, stop, N=N, nu=nu) for each in self.costs])

    @property
    def wanted_states(self) -> Array | None:
        return self.costs[0].wanted_states


def _added(hessians: Sequence[CostHessian]) -> CostHessian:
    """Return the sum of second derivatives."""
    Q, R, S, Q_final = hessians[0]
    for more in hessians[1:]:
        cross = S if more.S is None else more.S if S is None else S + more.S
        Q, R, S, Q_final = _plus(Q, more.Q), _plus(R, more.R), cross, _plus(Q_final, more.Q_final)
    return CostHessian(Q, R, S, Q_final)


def _plus(one: Array, other: Array) -> Array:
    if one.ndim == 1 and other.ndim == 1:
        return np.asarray(one + other)
    return np.ascontiguousarray(matrix_of(one) + matrix_of(other))


class GaussNewton(Cost):
    """Half the sum of squares of residuals, ``1/2 sum_k |r(x_k, u_k, k)|^2 + 1/2 |r_N(x_N)|^2``.

    Its second derivative is that of Gauss and Newton, ``J'J``: right where residuals are small, and never indefinite.
    As fit for several threads as the functions.

    Parameters
    ----------
    residual : callable
        ``residual(x, u, k) -> (m,)``, of as many entries at every stage.
    final : callable, optional
        ``final(x) -> (n,)`` of the last state; nothing if left out.
    derivatives : {"complex-step", "finite-differences"}, optional
        How they are differentiated: exactly, where they are analytic and take complex arrays, or by differences.

    Raises
    ------
    ArgumentError
        What is no function, or residuals that are not finite.
    """

    nonnegative = True

    def __init__(
        self,
        residual: Callable[[Array, Array, int], ArrayLike],
        final: Callable[[Array], ArrayLike] | None = None,
        *,
        derivatives: str = "complex-step",
    ) -> None:
        for what, function in (("residual", residual), ("final", final)):
            if function is not None and not callable(function):
                raise ArgumentError(f"{what}: got {type(function).__name__}, expected a function that returns an array")
        as_choice(derivatives, "derivatives", ("complex-step", "finite-differences"))
        self.residual, self.final, self.derivatives = residual, final, derivatives

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        squares = [self._residual(x[i], u[i], start + i) for i in range(len(u))]
        return np.array([0.5 * float(r @ r) for r in squares])

    def final_value(self, x: Array) -> float:
        r = self._last(x)
        return 0.5 * float(r @ r)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        nx = x.shape[1]
        slopes = np.empty((len(u), nx + u.shape[1]))
        for k in range(len(u)):
            slopes[k] = self._residual(x[k], u[k], k) @ self._jacobian(x[k], u[k], k)
        last = self._last(x[-1]) @ self._of_last(x[-1])
        return CostGradient(slopes[:, :nx].copy(), slopes[:, nx:].copy(), last)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        nx = x.shape[1]
        J = np.array([self._jacobian(x[k], u[k], k) for k in range(len(u))])
        H = J.swapaxes(1, 2) @ J
        last = self._of_last(x[-1])
        Q, R, S = (np.ascontiguousarray(part) for part in (H[:, :nx, :nx], H[:, nx:, nx:], H[:, :nx, nx:]))
        return CostHessian(Q, R, S, last.T @ last)

    def convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return all of it, which is convex; see `Cost`."""
        return self.hessian(x, u)

    def _residual(self, x: Array, u: Array, k: int) -> Array:
        return as_array(self.residual(read_only(x), read_only(u), k), f"residual(x, u, {k})", (None,), meaning="(m,)")

    def _jacobian(self, x: Array, u: Array, k: int) -> Array:
        nx = len(x)
        return self._slopes(lambda z: self.residual(z[:nx], z[nx:], k), np.concatenate([x, u]))

    def _last(self, x: Array) -> Array:
        if self.final is None:
            return np.zeros(0)
        return as_array(self.final(read_only(x)), "final(x)", (None,), meaning="(n,)")

    def _of_last(self, x: Array) -> Array:
        return np.zeros((0, len(x))) if self.final is None else self._slopes(self.final, x)

    def _slopes(self, function: Callable[[Any], Any], at: Array) -> Array:
        if self.derivatives == "complex-step":
            return complex_step(lambda y: np.asarray(function(y)), at)
        return np.asarray(central_differences(lambda y: np.asarray(function(y)), at))
