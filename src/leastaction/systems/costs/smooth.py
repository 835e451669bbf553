"""A price on the accelerations of prescribed variables, beside any other cost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.discrete.prescribed import places_of
from leastaction.numerics.arrays import Array, as_number, read_only, require_mapping
from leastaction.numerics.names import matching
from leastaction.numerics.public import public
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.discrete.cost import AddedCost, Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.systems.midpoint import MidpointSystem

IntArray = NDArray[np.integer]


@public
class CostOfAccelerations(AddedCost):
    """Another cost and half the weighted squares of the accelerations of prescribed variables, by their places.

    In a step the acceleration is ``((rho_next - rho)/dt - v_rho)/dt``, linear in state and input: what it costs is
    quadratic. Of turns of a rotation that is a quaternion, whose input is the turn of a step, it is ``(turn/dt -
    v_rho)/dt``. As fit for several threads as the other cost.

    ``dt`` (N,): the time steps (s). ``nx``, ``nu``: numbers of states and inputs. ``weights`` (m,): of half the squared
    accelerations. ``rho``, ``v_rho`` (m,): where the variables and their rates over the step before are in the state.
    ``rho_next`` (m,): where the variables at the end of the step are in the input. ``turns`` (m,): which are turns.
    ``ndx``, ``moves`` (2, m): the number of directions of a state, and where the variables and their rates are among
    these, if they are others than its numbers.
    """

    def __init__(
        self,
        cost: Cost,
        *,
        dt: Array,
        nx: int,
        nu: int,
        weights: Array,
        rho: IntArray,
        v_rho: IntArray,
        rho_next: IntArray,
        turns: NDArray[np.bool_] | None = None,
        ndx: int | None = None,
        moves: IntArray | None = None,
    ) -> None:
        super().__init__(cost, "accelerations", (len(dt), nx, nu))
        self.dt, self.weights = read_only(dt), read_only(weights)
        self.rho, self.v_rho, self.rho_next = rho, v_rho, rho_next
        self.counts = np.ones(len(rho)) if turns is None else 1.0 - turns  # of the variables at the start of a step
        self.ndx, self.moves = nx if ndx is None else ndx, np.stack([rho, v_rho]) if moves is None else moves

    def stage_prices(self, x: Array, u: Array, start: int) -> Array:
        return np.asarray(0.5 * (self._accelerations(x, u, start) ** 2 @ self.weights))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        q, r, dt = q.copy(), r.copy(), self.dt[:, None]
        slope, (rho, v_rho) = self.weights * self._accelerations(x[:-1], u, 0), self.moves
        q[:, rho] -= self.counts * slope / dt**2
        q[:, v_rho] -= slope / dt
        r[:, self.rho_next] += slope / dt**2
        return CostGradient(q, r, q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives: matrices, one for each stage where steps are not all as long."""
        return self._with_price(self.cost.hessian(x, u), u)

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the other cost's, with the price, which is convex; see `Cost`."""
        return self._with_price(self.cost.convex_hessian(x, u), u)

    def _with_price(self, other: CostHessian, u: Array) -> CostHessian:
        dt = self.dt[:, None]
        if np.ptp(dt) < 1e-9 * dt.max():
            dt = dt.mean(keepdims=True)
        Q, R, S, Q_final = other
        ndx, nu, n = self.ndx, u.shape[1], len(dt)
        (rho, v_rho), rho_next, counts = self.moves, self.rho_next, self.counts
        by_states, by_inputs, cross = np.zeros((n, ndx, ndx)), np.zeros((n, nu, nu)), np.zeros((n, ndx, nu))
        by_rate = self.weights / dt**2
        by_inputs[:, rho_next, rho_next] = by_rate / dt**2
        by_states[:, rho, rho] = counts * by_rate / dt**2
        by_states[:, rho, v_rho] = by_states[:, v_rho, rho] = counts * by_rate / dt
        by_states[:, v_rho, v_rho] = by_rate
        cross[:, rho, rho_next], cross[:, v_rho, rho_next] = -counts * by_rate / dt**2, -by_rate / dt
        Q_more, R_more, cross = (part[0] if n == 1 else part for part in (by_states, by_inputs, cross))
        return CostHessian(matrix_of(Q) + Q_more, matrix_of(R) + R_more, cross if S is None else S + cross, Q_final)

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        result = self._beside(self.cost.window(start, stop, N=N, nu=nu), stop - start)
        result.dt = self.dt[start:stop]
        return result

    def _accelerations(self, x: Array, u: Array, start: int) -> Array:
        dt = self.dt[start : start + len(u), None]
        return np.asarray(((u[:, self.rho_next] - self.counts * x[:, self.rho]) / dt - x[:, self.v_rho]) / dt)


@public
class SmoothCost(CostOfAccelerations):
    """Another cost and half the weighted squares of the accelerations of prescribed variables.

    Where a prescribed variable may be anywhere, an optimal motion rings: it alternates from step to step wherever the
    variable has little hold on what is followed. In a step the acceleration is ``((rho_next - rho)/dt - v_rho)/dt``,
    linear in state and input: the price costs no iterations. Of turns (``"hand.w*"``) it is that of the angular
    velocity. As fit for several threads as the other cost.

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
        require_mapping(accelerations, "accelerations", "{'string-*': 1e-3}")
        m = system.mechanism
        weights = np.zeros(m.nrho)
        for pattern, value in accelerations.items():
            found = matching(m.kinematic, pattern)
            if not found:
                known = closest(pattern, m.kinematic, what="kinematic variables")
                raise ArgumentError(f"accelerations: nothing is called {pattern!r}; {known}")
            weights[found] = as_number(value, f"accelerations: the weight of {pattern!r}", least=0.0)
        priced, (places, turns) = np.flatnonzero(weights), places_of(m)
        super().__init__(
            cost,
            dt=np.diff(system.t),
            nx=system.nx,
            nu=system.nu,
            weights=weights[priced],
            rho=places[priced],
            v_rho=m.nq + m.nd + priced,
            rho_next=m.n_inputs + priced,
            turns=turns[priced],
            ndx=system.ndx,
            moves=np.stack([m.nd + priced, m.nv + m.nd + priced]),
        )
