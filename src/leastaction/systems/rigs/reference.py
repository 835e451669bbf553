"""What a model makes of a plan for another one."""

from __future__ import annotations

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import final_of
from leastaction.optimal.discrete.cost import QuadraticCost
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic, sweep_forward
from leastaction.systems.midpoint import MidpointSystem

_ROUNDS, _MADE = 4, 1e-9


def made_by(model: MidpointSystem, x: Array, u: Array, Q: Array, R: Array) -> tuple[Array, Array]:
    """Return states and inputs near a plan, x (N+1, nx) and u (N, nu), such that the model goes along them.

    Where a string that stretches pulls for a few steps only, it does not give the impulse that an inextensible one
    gives: the model comes off the plan there in a single step, by degrees, and a regulator would meet that too late.

    Gauss-Newton steps with weights as of `regulate`: the gaps between the steps are closed by the inputs that cost
    least. Where strings go slack these jump from round to round, so the rounds are few, and the least gaps are taken.

    Raises
    ------
    ArgumentError
        If the model cannot go along the plan.
    """
    cost = QuadraticCost(x, u, Q=Q, R=R, Q_final=final_of(Q))
    best: tuple[float, Array, Array] | None = None
    for _ in range(_ROUNDS):
        made = model.step_each(x, u)
        if not made.complete:
            break
        gaps = made.x - x[1:]
        size = float(np.abs(gaps).max())
        if best is None or size < best[0]:
            best = size, x, u
        if size < _MADE:
            break
        A, B = model.linearize_each(x, u, made.x)
        q, r, q_final = cost.gradient(x, u)
        solution = solve_linear_quadratic(A, B, Q=Q, R=R, q=q, r=r, c=gaps, Q_final=final_of(Q), q_final=q_final)
        if not solution.definite:
            break
        dx, du = sweep_forward(A, B, solution, c=gaps)
        x, u = x + dx, u + du
    if best is None:
        raise ArgumentError(f"plan: the model cannot go along it: {made.failure}")
    return best[1], best[2]
