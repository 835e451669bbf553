"""A cost with the barriers of limits added to it: what the optimiser's loop minimises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import copied, empty
from leastaction.optimal.cost import is_diagonal, own_matrices
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import ModelHessian, same
from leastaction.optimal.limits.duals import Duals, LimitSide
from leastaction.optimal.limits.entries import EntryRows
from leastaction.optimal.limits.rows import Rows, Weights
from leastaction.optimal.limits.sides import Sided, SideLayout
from leastaction.optimal.limits.together import together
from leastaction.optimal.quantity import Entries, Instants

Jacobians = list[Array]
"""Derivatives of the rows that are no entries, of those that are taken together."""


class LimitedCost:
    """A cost, the elastic barriers of limits, and their duals.

    Its gradient is that of the sum. Its Hessian takes the duals' stiffness in place of the barrier's own second
    derivative, which holds over much longer steps: a primal-dual interior point method.

    Parameters
    ----------
    cost : Cost
    rows : sequence of Rows
        Both sides of equations one after the other.
    nx, nu : int
        Entries of differences of states, and of inputs.
    """

    def __init__(self, cost: Cost, rows: Sequence[Rows], nx: int, nu: int) -> None:
        self.cost, self.rows, self.nx = cost, tuple(rows), nx
        self.duals = Duals(
            [
                LimitSide(
                    r.limit,
                    r.labels,
                    r.equal,
                    r.equal and r.sign > 0.0,
                    r.scale,
                    np.abs(r.bounds).max(axis=0),
                    hard=not r.is_asked,
                    worth=r.worth,
                )
                for r in self.rows
            ],
            SideLayout([r.bounds.shape for r in self.rows]),
        )
        self.layout = self.duals.layout
        self.instants: list[Instants] = [each.k.copy() for each in self.rows]
        for k in self.instants:
            k.setflags(write=False)
        self.of_states = EntryRows(self.rows, self.layout, of_state=True, width=nx)
        self.of_inputs = EntryRows(self.rows, self.layout, of_state=False, width=nu)
        self.spare: dict[bool, Weights] = {}  # memory that is used again, of whole and of convex ones
        others = [i for i, each in enumerate(self.rows) if not isinstance(each.quantity, Entries)]
        self.others = together(self.rows, others, self.layout, nx, nu)
        weighed = [np.empty(0, dtype=np.intp), *(each.rows.weighs(nx, nu) for each in self.others)]
        self.columns = np.unique(np.concatenate(weighed))
        self.looks_ahead = any(each.quantity.looks_ahead for each in self.rows)

    # ---- Values -----------------------------------------------------------------------------------

    def limits(self, x: Array, u: Array) -> Sided:
        """Return the values c of all rows, with the leeway that they are lent now."""
        return self.duals.leeway.added(self.asked(x, u))

    def asked(self, x: Array, u: Array) -> Sided:
        """Return the values c of all rows, as they are asked for: without leeway."""
        found = self.layout.empty()
        self.of_states.values(x, found)
        self.of_inputs.values(u, found)
        for each in self.others:
            found.flat[each.at] = each.rows.values(x, u)
        return found

    def check(self, c: Sided, when: Callable[[int], str]) -> None:
        """Complain about values along the motion to start from that are no numbers; see `Rows.check_values`."""
        if not isfinite(c.flat.dot(c.flat)):
            for rows, values in zip(self.rows, c, strict=True):
                rows.check_values(values, when)

    # ---- Derivatives ------------------------------------------------------------------------------

    def jacobians(self, x: Array, u: Array) -> Jacobians:
        """Return the derivatives of the rows that are no entries."""
        return [each.rows.jacobian(x, u) for each in self.others]

    def with_duals(self, gradient: CostGradient, duals: Sided, jacobians: Jacobians) -> CostGradient:
        """Return the gradient of the cost less the duals times the limits, given that of the cost."""
        q, r, q_final = gradient
        r = self.of_inputs.pulled(duals, r)
        if self.others or self.of_states.core is not None:
            whole = empty((len(q) + 1, self.nx))
            whole[:-1], whole[-1] = q, q_final
            whole = self.of_states.pulled(duals, whole)
            r = copied(r) if r is gradient.r else r
            for each, jacobian in zip(self.others, jacobians, strict=True):
                each.rows.add_gradient(jacobian, each.of(duals), whole, r)
            q, q_final = whole[:-1], whole[-1]
        return CostGradient(q, r, q_final)

    def hessian(
        self,
        x: Array,
        u: Array,
        sigmas: Sided,
        jacobians: Jacobians,
        dynamics: Array | None = None,
        *,
        plain: ModelHessian,
        share: float = 1.0,
    ) -> ModelHessian:
        """Return the second derivatives of the primal-dual model, which the next are written over.

        Not those of a part over those of the whole, nor the other way round.

        Parameters
        ----------
        x, u : ndarray
        plain : ModelHessian
            Those of the cost alone.
        sigmas, jacobians
            Stiffnesses of the limits, and their derivatives there.
        dynamics : ndarray (N, nx, nx+nu) or None
            ``[A B]``, for what looks ahead.
        share : float
            Of what may bend downwards of the limits, as `plain` then has of the cost.
        """
        Q, R, S, Q_final, part = plain
        N, nx = len(u), self.nx
        states, inputs = self.of_states.hessian(sigmas, (N + 1, nx)), self.of_inputs.hessian(sigmas, u.shape)
        few, beside = [self.columns], None  # by which there is a part, and a diagonal in it
        if states is not None:
            Q_final = _with_diagonal(Q_final, states[-1])
            if self.of_states.first < N * nx and is_diagonal(Q):
                Q = _with(Q, states[:-1])
            elif self.of_states.first < N * nx:
                beside = states[:-1, self.of_states.columns]
                few.append(self.of_states.columns)
        if part is not None:
            few.append(part.columns)
        R = R if inputs is None else _with(R, inputs)
        columns = self.columns if len(few) == 1 else np.unique(np.concatenate(few))
        if not len(columns):
            return ModelHessian(Q, R, S, Q_final)
        weights = self._weights(N, columns, whole=share == 1.0)
        if part is not None:
            part.add_to(weights.matrices[:-1], columns)
        if beside is not None:
            at = np.searchsorted(columns, self.of_states.columns)
            weights.matrices[:-1, at, at] += beside
        for each, jacobian in zip(self.others, jacobians, strict=True):
            duals = share * each.of(self.duals.y) if share > 0.0 else None
            each.rows.add_hessian(x, u, jacobian, duals, each.of(sigmas), weights, dynamics, nx=nx)
        return ModelHessian(Q, R, S, Q_final).weighed(columns, weights.matrices)

    def _weights(self, N: int, columns: Instants, *, whole: bool) -> Weights:
        """Return an empty sum by some columns, where the last of its kind was."""
        if whole not in self.spare or len(self.spare[whole].columns) != len(columns):
            self.spare[whole] = Weights(N, columns)
        else:
            self.spare[whole].clear()
        return self.spare[whole]

    def bends(self, x: Array, u: Array, convex: ModelHessian, whole: ModelHessian) -> bool:
        """Whether the convex part of the second derivatives is another than all of them, given those of the cost."""
        if any(each.rows.bends(x, u) for each in self.others):
            return True
        return not same(convex, whole)

    def along(self, dx: Array, du: Array, jacobians: Jacobians) -> Sided:
        """Return the changes of the limits along a direction."""
        found = self.layout.empty()
        self.of_states.along(dx, found)
        self.of_inputs.along(du, found)
        for each, jacobian in zip(self.others, jacobians, strict=True):
            found.flat[each.at] = each.rows.along(jacobian, dx, du)
        return found


def _with(weight: Array, diagonal: Array) -> Array:
    """Return a weight with a diagonal (N, n) of every stage added, which may be written over."""
    if is_diagonal(weight):
        diagonal += weight if weight.ndim == 1 else weight[:, :, 0]
        return diagonal[:, :, None]
    n = weight.shape[-1]
    full = own_matrices(weight, (len(diagonal), n, n))
    full[:, np.arange(n), np.arange(n)] += diagonal
    return full


def _with_diagonal(weight: Array, diagonal: Array) -> Array:
    """Return a weight (n,) or (n, n) with a diagonal (n,) added."""
    result: Array = weight + (diagonal if weight.ndim == 1 else np.diag(diagonal))
    return result
