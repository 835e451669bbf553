"""A price on the accelerations of prescribed variables, beside any other cost."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from fnmatch import fnmatchcase

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array, as_number
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.discrete.cost import Cost, CostGradient, CostHessian
from leastaction.systems.midpoint import MidpointSystem


class SmoothCost(Cost):
    """Another cost and half the weighted squares of the accelerations of prescribed variables.

    Where a prescribed variable may be anywhere, an optimal motion rings: it alternates from step to step wherever the
    variable has little hold on what is followed. In a step the acceleration is ``((rho_next - rho)/dt - v_rho)/dt``,
    linear in state and input: the price costs no iterations. As fit for several threads as the other cost.

    Parameters
    ----------
    cost : Cost
        Such as a `QuadraticCost`.
    system : MidpointSystem
        Whose variables are meant.
    accelerations : mapping of str to float
        Weights by the names of kinematic variables or patterns of them (``"string-*"``), in units of the cost by
        (m/s^2)^2 or (rad/s^2)^2; none for the others.

    Raises
    ------
    ArgumentError
        For a name that no kinematic variable has, or a weight that is negative or not finite.
    """

    def __init__(self, cost: Cost, system: MidpointSystem, accelerations: Mapping[str, float]) -> None:
        m = system.integrator.mechanism
        weights = np.zeros(m.nrho)
        for pattern, value in accelerations.items():
            found = [i for i, name in enumerate(m.kinematic) if name == pattern or fnmatchcase(name, pattern)]
            if not found:
                known = closest(pattern, m.kinematic, what="kinematic variables")
                raise ArgumentError(f"accelerations: nothing is called {pattern!r}; {known}")
            weights[found] = as_number(value, f"accelerations: the weight of {pattern!r}")
        if (weights < 0.0).any():
            name = m.kinematic[int(np.argmin(weights))]
            raise ArgumentError(f"accelerations: {name!r}: got {weights.min():g}, expected a weight of zero or more")
        priced = np.flatnonzero(weights)
        self.cost, self.system = cost, system
        self.nonnegative = cost.nonnegative
        self._weights = weights[priced]
        self._rho, self._v_rho, self._next = m.nd + priced, m.nq + m.nd + priced, m.n_inputs + priced

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        """Complain if the other cost, or the system whose variables are meant, is of other sizes."""
        expected = (self.system.N, self.system.nx, self.system.nu)
        if (N, nx, nu) != expected:
            raise ArgumentError(
                f"cost: accelerations are those of a system of N, nx, nu = {expected}, and this one has {(N, nx, nu)}"
            )
        self.cost.check_shapes(N, nx, nu)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        """Return the costs of the stages from `start` on."""
        squares = self._accelerations(x, u, start) ** 2 @ self._weights
        return np.asarray(self.cost.stage_values(x, u, start) + 0.5 * squares)

    def final_value(self, x: Array) -> float:
        """Return the cost of the last state."""
        return self.cost.final_value(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives."""
        q, r, q_final = self.cost.gradient(x, u)
        q, r, dt = q.copy(), r.copy(), self._dt()
        slope = self._weights * self._accelerations(x[:-1], u, 0) / dt
        q[:, self._rho] -= slope / dt
        q[:, self._v_rho] -= slope
        r[:, self._next] += slope / dt
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives: matrices, one for each stage where steps are not all as long."""
        Q, R, S, Q_final = self.cost.hessian(x, u)
        dt = self._dt()[:, 0]
        if np.ptp(dt) < 1e-9 * dt.max():
            dt = dt.mean(keepdims=True)
        rows = np.arange(len(self._weights))
        by_x, by_u = np.zeros((len(dt), len(rows), x.shape[1])), np.zeros((len(dt), len(rows), u.shape[1]))
        by_x[:, rows, self._rho] = -1.0 / dt[:, None] ** 2
        by_x[:, rows, self._v_rho] = -1.0 / dt[:, None]
        by_u[:, rows, self._next] = 1.0 / dt[:, None] ** 2
        weighed = by_x.swapaxes(1, 2) * self._weights
        QS, RR = (weighed @ by_x, weighed @ by_u), by_u.swapaxes(1, 2) * self._weights @ by_u
        bent, cross, turned = (part[0] if len(dt) == 1 else part for part in (*QS, RR))
        return CostHessian(matrix_of(Q) + bent, matrix_of(R) + turned, cross if S is None else S + cross, Q_final)

    def window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        """Return the cost of the stages ``start .. stop-1``, with their accelerations; see `Cost`."""
        system = self.system.window(start, stop)
        assert isinstance(system, MidpointSystem)
        return self._with(self.cost.window(start, stop, N=N, nu=nu), system)

    def eased(self, ease: float) -> tuple[Cost, Array] | None:
        """Return the other cost eased, with the same accelerations; see `Cost`."""
        found = self.cost.eased(ease)
        return None if found is None else (self._with(found[0], self.system), found[1])

    def refined(self, parts: int) -> Cost | None:
        """Return the cost of the same motion in shorter steps; see `Cost`."""
        cost, system = self.cost.refined(parts), self.system.refined(parts)
        if cost is None or not isinstance(system, MidpointSystem):
            return None
        result = self._with(cost, system)
        result._weights = self._weights / parts
        return result

    def _with(self, cost: Cost, system: MidpointSystem) -> SmoothCost:
        result = copy(self)
        result.cost, result.system, result.nonnegative = cost, system, cost.nonnegative
        return result

    def _dt(self) -> Array:
        return np.diff(self.system.t)[:, None]

    def _accelerations(self, x: Array, u: Array, start: int) -> Array:
        dt = self._dt()[start : start + len(u)]
        return np.asarray(((u[:, self._next] - x[:, self._rho]) / dt - x[:, self._v_rho]) / dt)
