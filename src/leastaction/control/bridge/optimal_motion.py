"""Optimal motions as functions of where they begin and of parameters, and their derivatives.

At an optimum the first derivatives of the Lagrangian ``sum l(x, u) + z+ . (f(x, u, th) - x+)`` vanish; by the implicit
function theorem the optimum follows ``x_0`` and ``th`` as the solution of the linear-quadratic problem whose weights
are its second derivatives, with the drift ``f_th`` and the slopes ``z+ . f_(x,u)th``. Its cost follows by ``z_0`` and
the sum of ``z+ . f_th``. All of it is by differences of states; derivatives that are told are by their numbers, as in
`leastaction.control.bridge.derivatives`.
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
from leastaction.optimal.space import StateSpace, Vectors
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
        require_instance(cost, "cost", Cost, "such as a QuadraticCost")
        for name in _NOT_DIFFERENTIATED:
            if name in settings:
                raise ArgumentError(
                    f"{name}: got {'it' if name != 'limits' else 'some'}, expected none: the derivatives of an optimum "
                    "are those of one without limits, from a given first state, by `parameters` alone"
                )
        self.space: StateSpace = system.charts() or Vectors(system.nx)
        self.system, self.cost, self.names = system, cost.over(system.N), checked_names(system, parameters)
        wanted = getattr(self.cost, "u_wanted", np.zeros((system.N, system.nu))) if guess is None else guess
        self.guess = as_array(wanted, "u", (system.N, system.nu), meaning="(N, nu)")
        self.settings = {"tolerance": 1e-9, "max_iterations": 200, **settings}

    def solve(self, x0: Array, values: Array) -> tuple[Array, Array]:
        """Return the optimum x (N+1, nx), u (N, nu).

        The first state is x0 as it is; a quaternion in it may have any length, the others are unit quaternions.

        Raises `ArgumentError`: none was found.
        """
        system = with_values(self.system, self.names, values)
        found = optimize(system, self.cost, initial=(self._on(x0), self.guess), **self.settings)
        if found.status is not Status.CONVERGED:
            raise ArgumentError(f"there is no optimum from here to differentiate: {found.message}")
        x = np.array(found.x)
        x[0] = x0
        return x, np.asarray(found.u)

    def value(self, x: Array, u: Array) -> float:
        """Return the cost of an optimum."""
        return self.cost.value(self._on(x), np.asarray(u))

    def _on(self, x: Array) -> Array:
        """Return the states that numbers (..., nx) stand for."""
        given = np.array(x, dtype=np.float64)
        return self.space.plus(given, np.zeros((*given.shape[:-1], self.space.ndx)))

    def slopes(self, x: Array, u: Array, values: Array) -> tuple[Array, Array, Array]:
        """Return how an optimum follows (x_0, parameters): dx (N+1, nx, n), du (N, nu, n), and its cost (n,).

        Raises `ArgumentError`: it is no strict minimum: of second order.
        """
        system, names = with_values(self.system, self.names, values), self.names
        first, x, u = np.array(x[0], dtype=np.float64), read_only(self._on(x)), read_only(np.array(u, dtype=np.float64))
        N, nx, nu, P = system.N, self.space.ndx, system.nu, len(names)
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
        by = np.zeros((nx + P, system.nx + P))  # directions of x_0 by its numbers
        by[:nx, : system.nx], by[nx:, system.nx :] = self.space.changes(first), np.eye(P)
        by_numbers: Array = self.space.plus_derivative(x) @ dx @ by
        by_numbers[0] = np.eye(system.nx, system.nx + P)
        return by_numbers, du @ by, np.concatenate([z[0], np.einsum("ki,kij->j", weights, drift)]) @ by

    def _by_parameters(
        self, system: DiscreteSystem, x: Array, u: Array, z: Array, values: Array
    ) -> tuple[Array, Array]:
        """Return ``f_th`` (N, ndx, P) and ``z . f_(x,u)th`` (N, P, ndx+nu) of the steps."""
        names, n = self.names, self.space.ndx + system.nu
        if not names:
            return np.zeros((len(u), self.space.ndx, 0)), np.zeros((len(u), 0, n))
        drift = derivatives_by(system, x, u, names)
        exact = system.curvature_by_parameters(x, u, z, names)
        if exact is not None:
            return drift, exact[:, :, :n]
        pull = np.empty((len(u), len(names), n))
        for j in range(len(names)):

            def slopes(moved: Array) -> Array:
                near = with_parameters(system, dict(zip(names, moved.tolist(), strict=True)), near=True)
                ends = near.step_each(x, u).x
                A, B = near.linearize_each(x, u, ends)
                read = np.einsum("ki,kij->kj", z, self.space.difference_derivative(ends, x[1:]))
                return np.asarray(np.einsum("ki,kij->kj", read, np.concatenate([A, B], axis=2)))

            pull[:, j] = by_differences(slopes, np.asarray(values, dtype=np.float64), j)
        return drift, pull
