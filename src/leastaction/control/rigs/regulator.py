"""A predictive controller along a plan, from where the machine is, that knows that strings do not push.

At instant k, with the machine at ``x_k``, it is after the least of ::

    sum_{j=k}^{k+n-1} 1/2 |x_j - xbar_j|_Q^2 + 1/2 |u_j - ubar_j|_R^2 + sum_i w_i/2 min(0, r_i(q_j))^2 + V(x_{k+n})
    subject to x_{j+1} = g(x_j, u_j)

along a plan ``xbar, ubar``. In ``g`` strings are springs that push as well, ``r_i`` is by how much the spring i may
shrink until it does, and ``w_i`` the price of the energy that it has then, times its stiffness: a string that goes
slack follows no command, and is missed when it has to pull again. ``V`` is what the rest of the plan costs, by the
linear-quadratic problem along it; there is no rest after its end.

An `MPC` makes one real-time iteration an instant. A law that is linear about the plan holds for a tenth of a radian on
a limb near the singular pose of its angles; this one is linear about what will be done.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.predictive import MPC
from leastaction.control.rigs.pushing import Pushing, PushingCost
from leastaction.control.rigs.strings import Strings, as_springs
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.optimal.cost import final_of
from leastaction.optimal.discrete.cost import Cost, QuadraticCost
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic
from leastaction.systems.midpoint import MidpointSystem

_AHEAD = 0.4  # s that it plans ahead: that long a limb falls or flies freely
_PUSHING = 100.0  # 1/J, the price of the energy of a spring that pushes


class Regulator:
    """A predictive controller along a plan; see the module. For one thread at a time: it goes forward along the plan.

    ``model``: With elastic strings that only pull. ``x``, ``u`` (N+1, nx), (N, nu): The plan. The model need not go
    along it. ``Q``, ``R``: Weights, as of `regulate`. Raises `ArgumentError`: where the model has no steps along the
    plan, or with weights for which there is no regulator.
    """

    def __init__(self, model: MidpointSystem, x: Array, u: Array, Q: ArrayLike, R: ArrayLike) -> None:
        m, t, N = model.mechanism, model.t, model.N
        self.ahead = n = max(1, int(np.ceil(_AHEAD / float(np.diff(t).mean()) - 1e-9)))
        vi = model.integrator.like(as_springs(m))
        along = MidpointSystem(vi, t)
        made = along.step_each(x, u)
        if not made.complete:
            raise ArgumentError(f"plan: the model cannot go along it: {made.failure}")
        Q, R = as_array(Q, "Q"), as_array(R, "R")
        A, B = along.linearize_each(x, u, made.x)
        plan = solve_linear_quadratic(
            A, B, Q=Q, R=R, c=along.difference(made.x, x[1:]), Q_final=final_of(Q), keep_P=True
        )
        if not plan.definite or plan.P is None:
            raise ArgumentError(
                f"Q, R: there is no regulator: {plan.message} Give a positive definite R and a positive semidefinite Q."
            )
        # After its end the plan stands still, and costs nothing but inputs.
        dt = float(t[-1] - t[-2])
        self.t = np.concatenate([t, t[-1] + dt * np.arange(1, n + 1)])
        self.x, self.u, self.K = (np.concatenate([a, np.repeat(a[-1:], n, axis=0)]) for a in (x, u - plan.C, plan.K))
        self.wanted = np.concatenate([u, np.repeat(u[-1:], n, axis=0)])
        self.Q = np.concatenate([_stages(Q, N), _stages(final_of(Q), 1), _stages(0.0 * final_of(Q), n)])
        self.R = np.concatenate([_stages(R, N), _stages(R[-1] if R.ndim == 3 else R, n)])
        self.P = np.concatenate([plan.P, np.zeros((n, *plan.P.shape[1:]))])
        # Where what is to come is least, which is in the range of P as it is bounded below.
        least = [np.linalg.pinv(P, rcond=1e-12, hermitian=True) @ b for P, b in zip(plan.P, plan.b, strict=True)]
        self.least = np.concatenate([np.array(least), np.zeros((n, along.ndx))])
        strings = Strings(m)
        room = strings.room_along(x[:, : m.nq])
        self.pushing = Pushing(strings, np.concatenate([room, np.full((n, room.shape[1]), np.inf)]), _PUSHING)
        self.springs = MidpointSystem(vi, self.t)
        self.window = MidpointSystem(vi, self.t[: n + 1])
        self.mpc = MPC(self.springs, self.cost, horizon=n)

    def command(self, k: int, x: Array) -> Array:
        """Return the input of step k, with a state x (nx,) at its start; k grows by one from call to call."""
        if self.mpc.info.planned:
            self._go_on(k)
            u = self.mpc(x, float(self.t[k]))
        if not self.mpc.info.planned:
            self._begin(k)
            u = self.mpc(x, float(self.t[k]))
        return u

    def cost(self, t: float) -> Cost:
        """Return what the next instants cost, and the rest of the plan."""
        n = self.ahead
        k = min(int(np.argmin(np.abs(self.t - t))), len(self.u) - n)
        stages = slice(k, k + n)
        wanted = self.x[k : k + n + 1].copy()
        wanted[-1] = self.springs.plus(wanted[-1], -self.least[k + n])
        tracked = QuadraticCost(
            wanted, self.wanted[stages], Q=self.Q[stages], R=self.R[stages], Q_final=self.P[k + n], space=self.springs
        )
        return PushingCost(tracked, self.window, self.pushing.later(k)) if self.pushing.strings.names else tracked

    def _go_on(self, k: int) -> None:
        """Go on from what was planned an instant ago; at its end by the law along the plan."""
        j, mpc = k + self.ahead - 1, self.mpc
        away = self.springs.difference(mpc.x[-1], self.x[j])
        inputs = np.concatenate([mpc.u[1:], (self.u[j] - self.K[j] @ away)[None]])
        end = self.springs.plus(self.x[j + 1], away)
        mpc.begin(
            np.concatenate([mpc.x[1:], end[None]]), inputs, np.concatenate([mpc.K[1:], self.K[j : j + 1]]),
            float(self.t[k]),
        )  # fmt: skip

    def _begin(self, k: int) -> None:
        """Plan anew from the plan at instant k, and the law along it."""
        n = self.ahead
        self.mpc.begin(self.x[k : k + n + 1], self.u[k : k + n], self.K[k : k + n], float(self.t[k]))


def _stages(weight: Array, n: int) -> Array:
    """Return a weight as one for each of n stages."""
    if weight.ndim == 1:
        weight = weight[:, None]
    return weight if weight.ndim == 3 else np.repeat(weight[None], n, axis=0)
