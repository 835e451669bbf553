"""Gains about a motion that was found on a mesh, as functions of time.

The cost to go ``x'P(t)x / 2`` is found backwards, piece by piece: from its P at the end of a piece that of any time t
in it, by one step of the mesh's own method from t to the end, whose inputs at all points are those of least cost. So
what is stiff costs nothing, and a large weight at the end is met by shorter and shorter pieces, as the gains ask for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import POINTS, Mesh, PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.mesh import NODES, STAGES, WEIGHTS
from leastaction.optimal.collocation.piece import newton_matrix, slopes_of_points
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.model import sample_model, with_identities
from leastaction.optimal.continuous.riccati import ModelSamples
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory

_CLOSE = 1e-6  # error of a gain, in parts of what it is in the piece
_IN_ROW = 1e-3  # part of the largest gain of an input below which others are small
_SHORTEST = 1e-12  # shortest piece, in parts of the horizon
_MOST = 1000  # pieces beside those of the model: what oscillates faster than they tell is left as it is


def regulator_along(
    system: ContinuousSystem, cost: ContinuousCost, curve: DenseTrajectory, jumps: Sequence[float], accuracy: Accuracy
) -> PiecewisePolynomial:
    """Return the gains of the cost's own regulator, without limits, and no feedforward, as functions of time.

    Where the cost has none they are those with identities for weights. ``jumps``: times at which pieces have to end.
    """
    model = sample_model(system, cost, curve, jumps, accuracy)
    gains = _Backwards(model.mesh, model.samples).gains(model.Q_final)
    if gains is None:
        gains = _Backwards(model.mesh, with_identities(model.samples)).gains(np.eye(system.nx))
    assert gains is not None
    return gains


class _Backwards:
    """The way backwards through a linear-quadratic problem that is sampled on a mesh."""

    def __init__(self, mesh: Mesh, samples: ModelSamples) -> None:
        self.mesh = mesh
        self.nx, self.nu = samples.B.shape[1:]
        packed = np.concatenate([part.reshape(len(mesh.t), -1) for part in samples], axis=1)
        self.problem = mesh.fit(packed, packed.shape[1:])

    def gains(self, P: Array) -> PiecewisePolynomial | None:
        """Return the gains; None where there is no minimum. ``P`` (nx, nx): at the end."""
        breaks, found = [float(self.mesh.breaks[-1])], []
        ahead = self.mesh.breaks[:-1].tolist()
        least, most = _SHORTEST * (self.mesh.breaks[-1] - self.mesh.breaks[0]), _MOST + len(ahead)
        while ahead:
            begin, end = ahead[-1], breaks[-1]
            may_halve = end - begin > least and len(breaks) + len(ahead) < most
            at = self._piece(begin, end, P, may_halve=may_halve)
            if at is None and not may_halve:
                return None
            if at is None:
                ahead.append(0.5 * (begin + end))
                continue
            K, P = at
            found.append(K)
            breaks.append(ahead.pop())
        values = np.concatenate(found[::-1])
        return Mesh(np.array(breaks[::-1])).fit(
            np.hstack([values, np.zeros((len(values), self.nu))]), (self.nu * (self.nx + 1),)
        )

    def _piece(self, begin: float, end: float, P: Array, *, may_halve: bool) -> tuple[Array, Array] | None:
        """Return the gains at the points of a piece and P at its begin; None where it is too long or has no minimum."""
        points, middle = Mesh(np.array([begin, end])), 0.5 * (begin + end)
        starts = np.concatenate([points.t, [middle, begin]])
        before = self._steps(starts, np.full(len(starts), end), P)
        if before is None:
            return None
        first = self._steps(np.array([begin]), np.array([middle]), before[-2])
        if first is None:
            return None
        here = self._samples(points.t)
        right = here.B.transpose(0, 2, 1) @ before[:POINTS] + here.S.transpose(0, 2, 1)
        K: Array = np.asarray(np.linalg.solve(here.R, right), dtype=np.float64).reshape(POINTS, -1)
        size = np.sqrt(np.abs(np.diag(first[0])))
        off = np.abs(first[0] - before[-1]) > _CLOSE * (size[:, None] * size + 1e-3 * np.abs(first[0]).max())
        return None if may_halve and (off.any() or self._rough(points, K)) else (K, first[0])

    def _rough(self, points: Mesh, K: Array) -> bool:
        coefficients = np.abs(points.coefficients(K))[0]
        size = coefficients.max(axis=0).reshape(self.nu, self.nx)
        size = np.maximum(size, _IN_ROW * size.max(axis=1, keepdims=True)).ravel()
        tail = np.maximum(coefficients[-1], 0.1 * coefficients[-2])
        return bool((tail > _CLOSE * size + 1e-300).any())

    def _steps(self, starts: Array, ends: Array, P: Array) -> Array | None:
        """Return P (n, nx, nx) at times from which one step leads to others; None where there is no minimum."""
        n, nx, nu = len(starts), self.nx, self.nu
        h = (ends - starts)[:, None, None]
        t = starts[:, None] + h[:, 0] * NODES
        t[:, -1] = np.nextafter(ends, -np.inf)
        along = self._samples(t.ravel())
        A, B = along.A.reshape(n, STAGES, nx, nx), along.B.reshape(n, STAGES, nx, nu)
        moves = np.zeros((n, STAGES, nx + nu, nx + STAGES * nu))
        moves[:, :, :nx] = slopes_of_points(newton_matrix(h, A), h, B)
        for stage in range(STAGES):
            moves[:, stage, nx:, nx + stage * nu : nx + (stage + 1) * nu] = np.eye(nu)
        weights = np.concatenate([
            np.concatenate([along.Q, along.S], axis=2),
            np.concatenate([along.S.transpose(0, 2, 1), along.R], axis=2),
        ], axis=1).reshape(n, STAGES, nx + nu, nx + nu)  # fmt: skip
        weights = (h[:, 0] * WEIGHTS)[:, :, None, None] * weights
        H = (moves.transpose(0, 1, 3, 2) @ weights @ moves).sum(axis=1)
        last = moves[:, -1, :nx]
        H += last.transpose(0, 2, 1) @ P @ last
        by_u, mixed = H[:, nx:, nx:], H[:, nx:, :nx]
        try:
            np.linalg.cholesky(by_u)
        except np.linalg.LinAlgError:
            return None
        found = H[:, :nx, :nx] - mixed.transpose(0, 2, 1) @ np.linalg.solve(by_u, mixed)
        return np.asarray(0.5 * (found + found.transpose(0, 2, 1)))

    def _samples(self, t: Array) -> ModelSamples:
        return ModelSamples.unpack(self.problem(t), self.nx, self.nu)
