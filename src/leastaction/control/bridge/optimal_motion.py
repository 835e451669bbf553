"""Optimal motions as functions of where they begin and of parameters, and their derivatives.

At an optimum the first derivatives of the Lagrangian ``sum l(x, u) + z+ . (f(x, u, th) - x+)`` vanish; by the implicit
function theorem the optimum follows ``x_0`` and ``th`` as the solution of the linear-quadratic problem whose weights
are its second derivatives, with the drift ``f_th`` and the slopes ``z+ . f_(x,u)th``. Its cost follows by ``z_0`` and
the sum of ``z+ . f_th``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, unknown
from leastaction.numerics.arrays import Array, as_array, read_only, require_instance
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.linear_quadratic import adjoint, solve_linear_quadratic
from leastaction.optimal.discrete.system import DiscreteSystem, derivatives_by, with_parameters
from leastaction.optimal.optimization import optimize
from leastaction.optimal.result import Status
from leastaction.optimal.unknowns.extended import by_differences

# Settings of `optimize` by which an optimum is another than the implicit function theorem is applied to here.
_NOT_DIFFERENTIATED = ("limits", "free_start", "unknowns", "initial", "resume", "horizon")


def with_values(system: DiscreteSystem, names: Sequence[str], values: Array) -> DiscreteSystem:
    """Return a system with values of some parameters, or itself where there are no names."""
    if not names:
        return system
    return with_parameters(system, dict(zip(names, np.asarray(values, dtype=np.float64).tolist(), strict=True)))


def checked_names(system: DiscreteSystem, parameters: Sequence[str]) -> tuple[str, ...]:
    """Return names of parameters of a system.

    Raises `ArgumentError`: one that it has not.
    """
    names = tuple(parameters)
    for name in names:
        if name not in system.parameters:
            raise unknown("parameter", name, system.parameters, "parameters")
    return names


class OptimalMotion:
    """The optimal motion of a system as a function of x_0 and of parameters; it has no state of its own.

    ``guess`` (N, nu): inputs to begin with. ``settings``: of `optimize`.
    """

    def __init__(
        self, system: DiscreteSystem, cost: Cost, parameters: Sequence[str], guess: Any, settings: dict[str, Any]
    ) -> None:
        if system.charts() is not None:
            raise ArgumentError("system: its states are no plain vectors, expected some that are")
        require_instance(cost, "cost", Cost, "such as a QuadraticCost")
        for name in _NOT_DIFFERENTIATED:
            if name in settings:
                raise ArgumentError(
                    f"{name}: got {'it' if name != 'limits' else 'some'}, expected none: the derivatives of an optimum "
                    "are those of one without limits, from a given first state, by `parameters` alone"
                )
        self.system, self.cost, self.names = system, cost.over(system.N), checked_names(system, parameters)
        wanted = getattr(self.cost, "u_wanted", np.zeros((system.N, system.nu))) if guess is None else guess
        self.guess = as_array(wanted, "u", (system.N, system.nu), meaning="(N, nu)")
        self.settings = {"tolerance": 1e-9, "max_iterations": 200, **settings}

    def solve(self, x0: Array, values: Array) -> tuple[Array, Array]:
        """Return the optimum x (N+1, nx), u (N, nu).

        Raises `ArgumentError`: none was found.
        """
        system = with_values(self.system, self.names, values)
        found = optimize(system, self.cost, initial=(np.array(x0, dtype=np.float64), self.guess), **self.settings)
        if found.status is not Status.CONVERGED:
            raise ArgumentError(f"there is no optimum from here to differentiate: {found.message}")
        return np.asarray(found.x), np.asarray(found.u)

    def slopes(self, x: Array, u: Array, values: Array) -> tuple[Array, Array, Array]:
        """Return how an optimum follows (x_0, parameters): dx (N+1, nx, n), du (N, nu, n), and its cost (n,).

        Raises `ArgumentError`: it is no strict minimum: of second order.
        """
        system, names = with_values(self.system, self.names, values), self.names
        x, u = (read_only(np.array(each, dtype=np.float64)) for each in (x, u))
        N, nx, nu, P = system.N, system.nx, system.nu, len(names)
        linear = system.linearize(x, u)
        A, B = np.array(linear.A), np.array(linear.B)
        z = adjoint(A, B, np.zeros((N, nu, nx)), *self.cost.gradient(x, u))
        weights = np.ascontiguousarray(z[1:])
        H = linear.curvature(weights) if linear.second is not None else system.curvatures(x, u, z)
        weigh = self.cost.hessian(x, u)
        drift, pull = self._by_parameters(system, x, u, weights, values)
        dx, du = np.zeros((N + 1, nx, nx + P)), np.zeros((N, nu, nx + P))
        dx[0, :, :nx] = np.eye(nx)
        laws = []
        for j in range(P + 1):  # that of the state alone, then one for each parameter
            moved: dict[str, Any] = {} if j == P else {"c": drift[:, :, j], "q": pull[:, j, :nx], "r": pull[:, j, nx:]}
            law = solve_linear_quadratic(A, B, Q=weigh.Q, R=weigh.R, S=weigh.S, Q_final=weigh.Q_final, H=H, **moved)
            if not law.definite:
                raise ArgumentError(f"the optimum is no strict minimum, so it has no derivative: {law.message}")
            laws.append((np.array(law.K), np.array(law.C)))
        K = laws[-1][0]
        C = np.zeros((N, nu, nx + P))
        for j in range(P):
            C[:, :, nx + j] = laws[j][1]
        for k in range(N):
            du[k] = -K[k] @ dx[k] - C[k]
            dx[k + 1] = A[k] @ dx[k] + B[k] @ du[k]
            dx[k + 1, :, nx:] += drift[k]
        return dx, du, np.concatenate([z[0], np.einsum("ki,kij->j", weights, drift)])

    def _by_parameters(
        self, system: DiscreteSystem, x: Array, u: Array, z: Array, values: Array
    ) -> tuple[Array, Array]:
        """Return ``f_th`` (N, nx, P) and ``z . f_(x,u)th`` (N, P, nx+nu) of the steps."""
        names, n = self.names, system.nx + system.nu
        if not names:
            return np.zeros((len(u), system.nx, 0)), np.zeros((len(u), 0, n))
        drift = derivatives_by(system, x, u, names)
        exact = system.curvature_by_parameters(x, u, z, names)
        if exact is not None:
            return drift, exact[:, :, :n]
        pull = np.empty((len(u), len(names), n))
        for j in range(len(names)):

            def slopes(moved: Array) -> Array:
                near = with_parameters(system, dict(zip(names, moved.tolist(), strict=True)), near=True)
                A, B = near.linearize_each(x, u, near.step_each(x, u).x)
                return np.asarray(np.einsum("ki,kij->kj", z, np.concatenate([A, B], axis=2)))

            pull[:, j] = by_differences(slopes, np.asarray(values, dtype=np.float64), j)
        return drift, pull
