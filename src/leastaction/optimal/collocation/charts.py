"""Pieces of a horizon whose states are no plain vectors: what is derived by numbers, by differences of states."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.mesh import STAGES, NodeLayout
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.space import ProductSpace, StateSpace, Vectors
from leastaction.optimal.system import Linearization


def space_on_mesh(system: ContinuousSystem) -> StateSpace | None:
    """Return how states ``[x(end); x(others); u]`` of pieces differ; None where they are plain vectors."""
    if system.space is None:
        return None
    return ProductSpace(*[system.space] * STAGES, Vectors(STAGES * system.nu))


def in_charts(found: Linearization, space: StateSpace, moves: NodeLayout, begin: Array, end: Array) -> Linearization:
    """Return derivatives by differences of states, given those of steps by their numbers.

    ``begin``, ``end`` (N, nx): where the steps lead from and to. ``moves``: where the differences of points are in
    those of a piece.
    """
    N, ndx, nu = len(found.B), space.ndx, found.B.shape[2]
    begin, end = begin.copy(), end.copy()
    P, G = space.plus_derivative(begin), space.changes(end)
    slopes = np.concatenate([found.A @ P, found.B], axis=2)
    A, B = G @ slopes[:, :, :ndx], G @ slopes[:, :, ndx:]

    def second(z: Array) -> Array:
        w = np.einsum("ki,kia->ka", z, G)
        bent = found.curvature(w)
        nx = P.shape[1]
        moved = np.zeros((N, nx + nu, ndx + nu))
        moved[:, :nx, :ndx], moved[:, nx:, ndx:] = P, np.eye(nu)
        H = np.swapaxes(moved, 1, 2) @ bent @ moved
        H[:, :ndx, :ndx] += space.plus_curvature(begin, np.einsum("ka,kab->kb", w, found.A))
        return np.asarray(H + np.swapaxes(slopes, 1, 2) @ space.changes_curvature(end, z) @ slopes)

    def packed(z: Array) -> Array:
        return np.asarray(second(z)[:, moves.used[:, None], moves.used][:, *moves.lower])

    return Linearization(A, B, second, pattern=moves.pattern, packed=packed)


class CostInCharts(Cost):
    """A cost that is derived by the numbers of states, by differences of these. As fit for threads as the cost is."""

    def __init__(self, cost: Cost, space: StateSpace) -> None:
        self.cost, self.on, self.nonnegative = cost, space, cost.nonnegative

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self.cost.stage_values(x, u, start)

    def final_value(self, x: Array) -> float:
        return self.cost.final_value(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(x, u)
        P = self.on.plus_derivative(x)
        return CostGradient(np.einsum("ka,kai->ki", q, P[:-1]), r, np.asarray(q_final @ P[-1]))

    def hessian(self, x: Array, u: Array) -> CostHessian:
        q, _, q_final = self.cost.gradient(x, u)
        return self._moved(x, self.cost.hessian(x, u), self.on.plus_curvature(x, np.concatenate([q, q_final[None]])))

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        return self._moved(x, self.cost.convex_hessian(x, u), np.zeros((len(x), self.on.ndx, self.on.ndx)))

    def _moved(self, x: Array, found: CostHessian, bent: Array) -> CostHessian:
        P = self.on.plus_derivative(x)
        back = np.swapaxes(P, 1, 2)
        Q = back @ np.concatenate([found.Q, found.Q_final[None]]) @ P + bent
        return CostHessian(Q[:-1], found.R, found.S, Q[-1])
