"""The second derivatives of a cost, and of a quadratic model: these, and a part by a few entries of state and input."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array
from leastaction.optimal.cost import is_diagonal, matrix_of, own_matrices

Places = NDArray[np.intp]


class CostHessian(NamedTuple):
    """Second derivatives of a cost along a trajectory.

    Q and R may be a diagonal ``(n,)``, a matrix ``(n, n)``, a diagonal per stage ``(N, n, 1)`` or a
    matrix per stage ``(N, n, n)``; the fewer numbers, the faster.

    Attributes
    ----------
    Q, R : ndarray
        ``d2l/dx2`` and ``d2l/du2``.
    S : ndarray (nx, nu) or (N, nx, nu), or None
        ``d2l/dxdu``; None is zero.
    Q_final : ndarray (nx,) or (nx, nx)
        ``d2m/dx2``.
    """

    Q: Array
    R: Array
    S: Array | None
    Q_final: Array


class HessianPart(NamedTuple):
    """Symmetric matrices by some entries of ``(x, u)`` only, such as what a few rows of limits weigh.

    ``columns`` (m,): the entries, ascending. ``matrices`` (N, m, m): one for each stage.
    """

    columns: Places
    matrices: Array

    def add_to(self, matrices: Array, columns: Places | None = None) -> None:
        """Add it to matrices (N, n, n) by all entries, or by ``columns`` (n,) among which its own are."""
        at = self.columns if columns is None else np.searchsorted(columns, self.columns)
        if len(at) and at[-1] - at[0] == len(at) - 1:  # as are configurations: several times as fast
            matrices[:, at[0] : at[-1] + 1, at[0] : at[-1] + 1] += self.matrices
        else:
            matrices[:, at[:, None], at] += self.matrices


class ModelHessian(NamedTuple):
    """The weights of a model: ``Q, R, S, Q_final`` as in a `CostHessian`, and what is added to those of the stages."""

    Q: Array
    R: Array
    S: Array | None
    Q_final: Array
    part: HessianPart | None = None

    @classmethod
    def of(cls, hessian: CostHessian) -> ModelHessian:
        """Return the weights of a cost alone."""
        return cls(*hessian)

    def whole(self) -> CostHessian:
        """Return them without a part, which is added to the weights of all stages."""
        Q, R, S, Q_final, part = self
        if part is None or not len(part.columns):
            return CostHessian(Q, R, S, Q_final)
        N, nx, nu = len(part.matrices), len(Q_final), len(R) if R.ndim == 1 else R.shape[1]
        if part.columns[-1] < nx:
            stages = own_matrices(matrix_of(Q), (N, nx, nx))
            part.add_to(stages)
            return CostHessian(stages, R, S, Q_final)
        whole = np.zeros((N, nx + nu, nx + nu))
        whole[:, :nx, :nx], whole[:, nx:, nx:] = matrix_of(Q), matrix_of(R)
        if S is not None:
            whole[:, :nx, nx:] = S
        part.add_to(whole)
        return CostHessian(whole[:, :nx, :nx], whole[:, nx:, nx:], whole[:, :nx, nx:], Q_final)

    def plus(self, more: HessianPart) -> ModelHessian:
        """Return them with another part."""
        if self.part is None:
            return self._replace(part=more)
        columns = np.union1d(self.part.columns, more.columns)
        both = np.zeros((len(more.matrices), len(columns), len(columns)))
        for each in (self.part, more):
            each.add_to(both, columns)
        return self._replace(part=HessianPart(columns, both))

    def weighed(self, columns: Places, matrices: Array) -> ModelHessian:
        """Return them with matrices (N+1, m, m) by some columns of all instants: a part, and of the last state."""
        last = _by_states(self.Q_final, HessianPart(columns, matrices), -1)
        return self.plus(HessianPart(columns, matrices[:-1]))._replace(Q_final=last)

    @property
    def of_first_state(self) -> Array:
        """The weight (nx, nx) of the first state."""
        weight = matrix_of(self.Q[:1] if self.Q.ndim == 3 else self.Q)
        weight = weight[0] if weight.ndim == 3 else weight
        return weight if self.part is None else _by_states(weight, self.part, 0)


def _by_states(weight: Array, part: HessianPart, k: int) -> Array:
    """Return a weight (n,) or (n, n) of states as a matrix, with what a part is by states at an instant."""
    total = np.array(matrix_of(weight))
    own = part.columns < len(total)
    total[np.ix_(part.columns[own], part.columns[own])] += part.matrices[k][np.ix_(own, own)]
    return total


def between(low: ModelHessian, high: ModelHessian, share: float) -> ModelHessian:
    """Return ``low + share (high - low)`` of two Hessians of the same cost and limits."""
    if share == 0.0 or all(a is b for a, b in zip(low, high, strict=True)):
        return low
    Q, Q_final = _between(low.Q, high.Q, share), _between(low.Q_final, high.Q_final, share)
    S = high.S if low.S is None else low.S
    if S is not None and low.S is not None and high.S is not None:
        S = _between(low.S, high.S, share)
    elif S is not None:
        S = (share if low.S is None else 1.0 - share) * S
    part = low.part
    if part is not None and high.part is not None:
        part = part._replace(matrices=_between(part.matrices, high.part.matrices, share))
    return ModelHessian(Q, _between(low.R, high.R, share), S, Q_final, part)


def same(one: ModelHessian, other: ModelHessian) -> bool:
    """Whether two Hessians of the same cost and limits have the same numbers."""
    (*weights, part), (*others, other_part) = one, other
    if part is not None and other_part is not None:
        weights, others = [*weights, part.matrices], [*others, other_part.matrices]
    elif part is not other_part:
        return False
    pairs = zip(weights, others, strict=True)
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in pairs)


def _between(low: Array, high: Array, share: float) -> Array:
    if low is high:
        return low
    if is_diagonal(low) and low.ndim == high.ndim and is_diagonal(high):
        return np.asarray(low + share * (high - low))
    low, high = matrix_of(low), matrix_of(high)
    # Stage after stage in memory: by itself a difference with one matrix for all of them need not be.
    part = np.subtract(high, low, out=np.empty(np.broadcast_shapes(low.shape, high.shape)))
    part *= share
    part += low
    return part


def shifted(hessian: ModelHessian, shift: float) -> ModelHessian:
    """Return the Hessian with a multiple of the identity added to all weights.

    The multiple is measured in the mean of the weights of the stages.
    """
    amount = 0.5 * shift * (_mean(hessian.Q) + _mean(hessian.R) + _mean_of_part(hessian))
    return hessian._replace(Q=_add(hessian.Q, amount), R=_add(hessian.R, amount), Q_final=_add(hessian.Q_final, amount))


def _mean(weight: Array) -> float:
    """Return the mean of a weight's diagonal; zero for that of no entries."""
    if weight.size == 0:
        return 0.0
    if weight.ndim == 1 or weight.shape[-1] == 1:
        return float(np.mean(np.abs(weight)))
    return float(np.mean(np.abs(np.diagonal(weight, axis1=-2, axis2=-1))))


def _mean_of_part(hessian: ModelHessian) -> float:
    """Return what the part adds to the means of the diagonals by states and by inputs."""
    if hessian.part is None:
        return 0.0
    columns, matrices = hessian.part
    each = np.abs(np.einsum("kii->ki", matrices)).mean(axis=0)
    nx, nu = (W.shape[0] if W.ndim == 1 else W.shape[1] for W in (hessian.Q, hessian.R))
    return float(each[columns < nx].sum() / max(nx, 1) + each[columns >= nx].sum() / max(nu, 1))


def _add(weight: Array, amount: float) -> Array:
    if is_diagonal(weight):
        return weight + amount
    result: Array = weight + amount * np.eye(weight.shape[-1])
    return result
