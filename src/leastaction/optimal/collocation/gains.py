"""Gains about a motion that was found on a mesh, as functions of time.

The cost to go ``x'P(t)x / 2`` is found backwards, piece by piece: from its P at the end of a piece that of any time t
in it, by one step of the mesh's own method from t to the end, whose inputs at all points are those of least cost. So
what is stiff costs nothing, and a large weight at the end is met by shorter and shorter pieces, as the gains ask for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
_ONE = Mesh(np.array([0.0, 1.0]))


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


class _PieceAhead(NamedTuple):
    """A piece, and the steps within it as far as no cost to go is known at its end.

    ``begin``, ``end``: times (s). ``moves`` (n, nx, m): where steps lead, by the state that they begin with and the
    inputs at their points. ``H`` (n, m, m): their cost, by the same. The steps are from each point, from the middle and
    from the begin to the end, and from the begin to the middle. ``here``: the problem at the points.
    """

    begin: float
    end: float
    moves: Array
    H: Array
    here: ModelSamples


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
        ahead = self._pieces(self.mesh.breaks)
        least, most = _SHORTEST * (self.mesh.breaks[-1] - self.mesh.breaks[0]), _MOST + len(ahead)
        while ahead:
            piece = ahead.pop()
            begin, end = piece.begin, piece.end
            may_halve = end - begin > least and len(breaks) + len(ahead) + 1 < most
            at = self._along(piece, P, may_halve=may_halve)
            if at is None and not may_halve:
                return None
            if at is None:
                ahead += self._pieces(np.array([begin, 0.5 * (begin + end), end]))
                continue
            K, P = at
            found.append(K)
            breaks.append(begin)
        values = np.concatenate(found[::-1])
        return Mesh(np.array(breaks[::-1])).fit(
            np.hstack([values, np.zeros((len(values), self.nu))]), (self.nu * (self.nx + 1),)
        )

    def _along(self, piece: _PieceAhead, P: Array, *, may_halve: bool) -> tuple[Array, Array] | None:
        """Return the gains at the points of a piece and P at its begin; None where it is too long or has no minimum."""
        before = self._steps(piece, slice(-1), P)
        if before is None:
            return None
        first = self._steps(piece, slice(-1, None), before[-2])
        if first is None:
            return None
        size = np.sqrt(np.abs(np.diag(first[0])))
        off = np.abs(first[0] - before[-1]) > _CLOSE * (size[:, None] * size + 1e-3 * np.abs(first[0]).max())
        if may_halve and off.any():
            return None
        here = piece.here
        right = here.B.transpose(0, 2, 1) @ before[:POINTS] + here.S.transpose(0, 2, 1)
        K: Array = np.asarray(np.linalg.solve(here.R, right), dtype=np.float64).reshape(POINTS, -1)
        return None if may_halve and self._rough(K) else (K, first[0])

    def _rough(self, K: Array) -> bool:
        coefficients = np.abs(_ONE.coefficients(K))[0]
        size = coefficients.max(axis=0).reshape(self.nu, self.nx)
        size = np.maximum(size, _IN_ROW * size.max(axis=1, keepdims=True)).ravel()
        tail = np.maximum(coefficients[-1], 0.1 * coefficients[-2])
        return bool((tail > _CLOSE * size + 1e-300).any())

    def _steps(self, piece: _PieceAhead, which: slice, P: Array) -> Array | None:
        """Return P (n, nx, nx) where some steps begin, by that where they end; None where there is no minimum."""
        moves, nx = piece.moves[which], self.nx
        H = piece.H[which] + moves.transpose(0, 2, 1) @ P @ moves
        by_u, mixed = H[:, nx:, nx:], H[:, nx:, :nx]
        try:
            np.linalg.cholesky(by_u)
        except np.linalg.LinAlgError:
            return None
        found = H[:, :nx, :nx] - mixed.transpose(0, 2, 1) @ np.linalg.solve(by_u, mixed)
        return np.asarray(0.5 * (found + found.transpose(0, 2, 1)))

    def _pieces(self, breaks: Array) -> list[_PieceAhead]:
        """Return pieces, one after the other, and the steps within them, all made at once."""
        begins, ends = breaks[:-1], breaks[1:]
        middles, points = 0.5 * (begins + ends), Mesh(breaks).t
        starts = np.column_stack([points.reshape(-1, POINTS), middles, begins, begins])
        stops = np.column_stack([np.tile(ends[:, None], (1, POINTS + 2)), middles])
        moves, H = self._made(starts.ravel(), stops.ravel())
        split, here = (len(begins), POINTS + 3), self._samples(points)
        each = zip(
            begins.tolist(), ends.tolist(), moves.reshape(*split, *moves.shape[1:]), H.reshape(*split, *H.shape[1:]),
            strict=True,
        )  # fmt: skip
        return [
            _PieceAhead(*piece, ModelSamples(*(part[i * POINTS : (i + 1) * POINTS] for part in here)))
            for i, piece in enumerate(each)
        ]

    def _made(self, starts: Array, ends: Array) -> tuple[Array, Array]:
        """Return where steps between times lead, and what they cost, as of `_PieceAhead`."""
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
        return moves[:, -1, :nx].copy(), (moves.transpose(0, 1, 3, 2) @ weights @ moves).sum(axis=1)

    def _samples(self, t: Array) -> ModelSamples:
        return ModelSamples.unpack(self.problem(t), self.nx, self.nu)
