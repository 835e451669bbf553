"""A regulator that plans ahead at every instant, from where the machine is, and knows that strings do not push.

At instant k, with the machine at ``x_k``, it is after the least of ::

    sum_{j=k}^{k+n-1} 1/2 |x_j - xbar_j|_Q^2 + 1/2 |u_j - ubar_j|_R^2 + sum_i w_i/2 min(0, r_i(q_{j+1}))^2 + V(x_{k+n})
    subject to x_{j+1} = g(x_j, u_j)

along a plan ``xbar, ubar``. In ``g`` strings are springs that push as well, ``r_i`` is by how much the spring i may
shrink until it does, and ``w_i`` the price of the energy that it has then, times its stiffness: a string that goes
slack follows no command, and is missed when it has to pull again. ``V`` is what the rest of the plan costs, by the
linear-quadratic problem along it.

Each instant makes one step of Gauss and Newton towards that (a *real-time iteration*: M. Diehl, H. G. Bock, J. P.
Schloeder, SIAM J. Control Optim. 43, 2005): the motion found an instant ago, with where the machine is now in the place
of its start, is linearised, with the gaps that this leaves between its steps, and one recursion finds the next one. A
law that is linear about the plan holds for a tenth of a radian on a limb near the singular pose of its angles; this
one is linear about what will be done.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.arrays import Array, as_array
from leastaction.optimal.cost import final_of, weigh
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic, sweep_forward
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.rigs.pushing import Pushing
from leastaction.systems.rigs.strings import Strings, as_springs

_AHEAD = 0.4  # s that it plans ahead: that long a limb falls or flies freely
_PUSHING = 100.0  # 1/J, the price of the energy of a spring that pushes


class Regulator:
    """A regulator along a plan; see the module. For one thread at a time: it goes forward along the plan.

    Parameters
    ----------
    model : MidpointSystem
        With elastic strings that only pull.
    x, u : ndarray (N+1, nx), (N, nu)
        The plan. The model need not go along it: what it is off by in each step is reckoned with.
    Q, R : array_like
        Weights, as of `regulate`.

    Raises
    ------
    ArgumentError
        Where the model has no steps along the plan, or with weights for which there is no regulator.
    """

    def __init__(self, model: MidpointSystem, x: Array, u: Array, Q: ArrayLike, R: ArrayLike) -> None:
        m, t = model.mechanism, model.t
        self.x, self.u = x, u
        self.Q, self.R = as_array(Q, "Q"), as_array(R, "R")
        strings = Strings(m)
        self.springs = MidpointSystem(model.integrator.like(as_springs(m)), t)
        made, sprung = model.step_each(x, u), self.springs.step_each(x, u)
        for steps in (made, sprung):
            if not steps.complete:
                raise ArgumentError(f"plan: the model cannot go along it: {steps.failure}")
        # Strings that become slack little by little pull a little more than springs.
        self.smoothed = made.x - sprung.x
        A, B = self.springs.linearize_each(x, u, sprung.x)
        plan = solve_linear_quadratic(A, B, Q=self.Q, R=self.R, c=made.x - x[1:], Q_final=final_of(self.Q), keep_P=True)
        if not plan.definite or plan.P is None:
            raise ArgumentError(
                f"Q, R: there is no regulator: {plan.message} Give a positive definite R and a positive semidefinite Q."
            )
        self.plan, self.P = plan, plan.P
        self.pushing = Pushing(strings, strings.room_along(x[:, : m.nq]), _PUSHING)
        self.ahead = max(1, int(np.ceil(_AHEAD / float(np.diff(t).mean()) - 1e-9)))
        # States (n+1, nx) and inputs (n, nu) from the next instant on, as they were found at the last one.
        self.found: tuple[Array, Array] | None = None

    def command(self, k: int, x: Array) -> Array:
        """Return the input of step k, with a state x (nx,) at its start; k grows by one from call to call."""
        begin = [self._along_plan] if self.found is None else [self._gone_on, self._along_plan]
        for begun in begin:
            found = self._improved(k, *begun(k, x))
            if found is not None:
                self.found = found[0][1:], found[1][1:]
                return np.asarray(found[1][0])
        self.found = None
        return self._law(k, x)

    def _law(self, k: int, x: Array) -> Array:
        """Return the input of step k by the linear-quadratic problem along the plan."""
        return np.asarray(self.u[k] - self.plan.K[k] @ (x - self.x[k]) - self.plan.C[k])

    def _stop(self, k: int) -> int:
        """Return the end of what is planned at instant k."""
        return min(k + self.ahead, len(self.u))

    def _along_plan(self, k: int, x: Array) -> tuple[Array, Array]:
        """Return the plan from instant k on, but begun at x."""
        stop = self._stop(k)
        return np.concatenate([x[None], self.x[k + 1 : stop + 1]]), self.u[k:stop]

    def _gone_on(self, k: int, x: Array) -> tuple[Array, Array]:
        """Return what was found an instant ago, but begun at x, and what follows at its end by the law."""
        assert self.found is not None
        states, inputs = self.found
        states = np.concatenate([x[None], states[1:]])
        j = k + len(inputs)
        if j < self._stop(k):
            end = states[-1]
            u = self._law(j, end)
            try:
                end = self.springs.f(end, u, j) + self.smoothed[j]
            except StepError:
                end = end - self.x[j] + self.x[j + 1]
            states, inputs = np.concatenate([states, end[None]]), np.concatenate([inputs, u[None]])
        return states, inputs

    def _improved(self, k: int, x: Array, u: Array) -> tuple[Array, Array] | None:
        """Return the motion from instant k on after one step of Gauss and Newton; None where the model has none.

        ``x`` (n+1, nx), ``u`` (n, nu): the motion before. There may be gaps between its steps.
        """
        n, nq = len(u), self.springs.mechanism.nq
        here = slice(k, k + n)
        system = self.springs.window(k, k + n)
        ends = system.step_each(x, u) if np.isfinite(x).all() and np.isfinite(u).all() else None
        if ends is None or not ends.complete or not np.isfinite(ends.x).all():
            return None
        linear = system.linearize_each(x, u, ends.x)
        Q, R = (weight[here] if weight.ndim == 3 else weight for weight in (self.Q, self.R))
        final = self.P[k + n].copy()
        q, r = weigh(Q, x[:-1] - self.x[here]), weigh(R, u - self.u[here])
        q_final = final @ (x[-1] - self.x[k + n]) + self.plan.b[k + n]
        part = None
        priced = self.pushing.derivatives(np.ascontiguousarray(x[1:, :nq]), k + 1)
        if priced is not None:
            slope, bend = priced
            q[1:, :nq] += slope[:-1]
            q_final[:nq] += slope[-1]
            final[:nq, :nq] += bend[-1]
            part = np.arange(nq), np.concatenate([np.zeros((1, nq, nq)), bend[:-1]])
        gaps = ends.x + self.smoothed[here] - x[1:]
        solution = solve_linear_quadratic(
            linear.A, linear.B, Q=Q, R=R, part=part, q=q, r=r, c=gaps, Q_final=final, q_final=q_final,
            pattern=linear.pattern,
        )  # fmt: skip
        if not solution.definite:
            return None
        dx, du = sweep_forward(linear.A, linear.B, solution, c=gaps, pattern=linear.pattern)
        return x + dx, u + du
