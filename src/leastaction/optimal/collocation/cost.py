"""A cost in continuous time on a mesh: a sum over the points."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.mesh import STAGES, NodeLayout, RadauMesh
from leastaction.optimal.continuous.cost import ContinuousCost, ContinuousQuadraticCost, RateHessian
from leastaction.optimal.discrete.cost import Cost, CostGradient, convex
from leastaction.optimal.discrete.hessians import CostHessian


class CollocationCost(Cost):
    """The integral of a cost's rate by the quadrature of the mesh; what a piece costs, its last state does.

    The base of two ways to it: see `collocation_cost`. As fit for several threads as the cost is.
    """

    def __init__(self, cost: ContinuousCost, mesh: RadauMesh, layout: NodeLayout) -> None:
        self.cost, self.mesh, self.layout = cost, mesh, layout
        self.nonnegative = cost.nonnegative
        self.weights: Array = mesh.weights
        self.tf = float(mesh.t[-1, -1])

    def stage_values(self, x: Array, u: Array, start: int) -> Array:  # noqa: ARG002 - inputs are part of the state
        """Return what the pieces before these states cost; before the first there is none."""
        first = int(start == 0)
        values = np.zeros(len(x))
        values[first:] = self._pieces(x[first:], start + first - 1)
        return values

    def final_value(self, x: Array) -> float:
        """Return what the last piece costs, and the end."""
        last = float(self._pieces(x[None, :], self.mesh.N - 1)[0])
        return last + self.cost.final_value(x[: self.layout.nx], self.tf)

    @abstractmethod
    def _pieces(self, z: Array, first: int) -> Array:
        """Return what pieces cost, from this one on."""


class AnyCollocationCost(CollocationCost):
    """That of any cost. As fit for several threads as the cost is."""

    def _pieces(self, z: Array, first: int) -> Array:
        if not len(z):
            return np.empty(0)
        states, inputs = self.layout.points(z)
        t, weights = self.mesh.t[first : first + len(z)], self.weights[first : first + len(z)]
        rates = self.cost.rates(states.reshape(t.size, -1), inputs.reshape(t.size, -1), t.ravel())
        return np.asarray(np.sum(weights * rates.reshape(t.shape), axis=1))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        states, inputs, t = self._points(x)
        by_x, by_u = self.cost.gradient(states, inputs, t)
        weights = self.weights.reshape(-1, 1)
        N, nx = self.mesh.N, self.layout.nx
        q = np.zeros_like(x)
        q[1:] = self.layout.joined((weights * by_x).reshape(N, STAGES, -1), (weights * by_u).reshape(N, STAGES, -1))
        q[-1, :nx] += self.cost.final_gradient(x[-1, :nx], self.tf)
        return CostGradient(q[:-1], np.zeros_like(u), q[-1])

    def hessian(self, x: Array, u: Array) -> CostHessian:
        rate, final = self.cost.hessian(*self._points(x)), self.cost.final_hessian(x[-1, : self.layout.nx], self.tf)
        return self._over(rate, final, u)

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        last = x[-1, : self.layout.nx]
        rate, final = self.cost.convex_hessian(*self._points(x)), self.cost.convex_final_hessian(last, self.tf)
        return convex(self._over(rate, final, u))

    def _over(self, rate: RateHessian, final: Array, u: Array) -> CostHessian:
        """Return second derivatives over the pieces, given those at their points and at the end."""
        Q, R, S = rate
        t = self.mesh.t.ravel()
        nx, nz, N = self.layout.nx, self.layout.nz, self.mesh.N
        H = np.concatenate([Q, np.zeros((len(t), nx, self.layout.nu)) if S is None else S], axis=2)
        below = np.zeros((len(t), self.layout.nu, nx)) if S is None else S.transpose(0, 2, 1)
        H = np.concatenate([H, np.concatenate([below, R], axis=2)], axis=1)
        H = (self.weights.reshape(-1, 1, 1) * H).reshape(N, STAGES, *H.shape[1:])
        whole = np.zeros((N + 1, nz, nz))
        for stage in range(STAGES):
            places = self.layout.places(stage)
            whole[1:, places[:, None], places] = H[:, stage]
        whole[-1, :nx, :nx] += final
        return CostHessian(whole[:-1], np.zeros(u.shape[1]), None, whole[-1])

    def _points(self, x: Array) -> tuple[Array, Array, Array]:
        states, inputs = self.layout.points(x[1:])
        count = self.mesh.N * STAGES
        return states.reshape(count, -1), inputs.reshape(count, -1), self.mesh.t.ravel()


class QuadraticCollocationCost(CollocationCost):
    """That of a quadratic cost whose weights are diagonals: what does not depend on the motion is looked up once.

    Any number of threads may share one. ``wanted``, ``weight`` (N, nz): of the states of the discrete system after
    every piece.
    """

    def __init__(self, cost: ContinuousQuadraticCost, mesh: RadauMesh, layout: NodeLayout) -> None:
        super().__init__(cost, mesh, layout)
        t = mesh.t.ravel()

        def on_pieces(x: Array, u: Array) -> Array:
            return layout.joined(x.reshape(mesh.N, STAGES, -1), u.reshape(mesh.N, STAGES, -1))

        shares = self.weights.reshape(-1, 1)
        self.wanted = on_pieces(cost.x_wanted.samples(t), cost.u_wanted.samples(t))
        self.weight = on_pieces(shares * cost.Q.samples(t), shares * cost.R.samples(t))
        last = np.diag(self.weight[-1])
        last[: layout.nx, : layout.nx] += cost.final_hessian(self.wanted[-1, : layout.nx], self.tf)
        before = np.concatenate([np.zeros((1, layout.nz)), self.weight[:-1]])
        self._hessian = CostHessian(before[:, :, None], np.zeros(STAGES * layout.nu), None, last)

    def _pieces(self, z: Array, first: int) -> Array:
        here = slice(first, first + len(z))
        return np.asarray(0.5 * np.einsum("ki,ki->k", self.weight[here], (z - self.wanted[here]) ** 2))

    def gradient(self, x: Array, u: Array) -> CostGradient:
        nx = self.layout.nx
        q = np.zeros_like(x)
        q[1:] = self.weight * (x[1:] - self.wanted)
        q[-1, :nx] += self.cost.final_gradient(x[-1, :nx], self.tf)
        return CostGradient(q[:-1], np.zeros_like(u), q[-1])

    def hessian(self, x: Array, u: Array) -> CostHessian:  # noqa: ARG002 - it is constant
        return self._hessian


def collocation_cost(cost: ContinuousCost, mesh: RadauMesh, layout: NodeLayout) -> CollocationCost:
    """Return a cost on a mesh, in the way that is fastest for it."""
    if type(cost) is ContinuousQuadraticCost and cost.space is None:
        t = float(mesh.breaks[0])
        if cost.Q.at(t).ndim == cost.R.at(t).ndim == 1:
            return QuadraticCollocationCost(cost, mesh, layout)
    return AnyCollocationCost(cost, mesh, layout)
