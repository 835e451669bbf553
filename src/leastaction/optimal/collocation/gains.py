"""Gains about a motion that was found on a mesh, as functions of time.

The cost to go ``x'P(t)x / 2`` is found backwards: from its P at the end of a piece that of any time t in it, by one
step of the mesh's own method from t to the end, whose inputs at all points are those of least cost. So what is stiff
costs nothing. Ends of pieces follow from each other by the recursion of discrete time; all else is done for all pieces
at once. Those that are too long are halved, until none is: a large weight at the end is met by shorter ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import POINTS, Mesh, PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.mesh import NODES, STAGES, WEIGHTS
from leastaction.optimal.collocation.piece import newton_matrix, slopes_of_points
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.model import ModelSamples, TangentModel, sample_model
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic

Flags = NDArray[np.bool_]

_CLOSE = 1e-6  # error of a gain, in parts of what it is in the piece
_IN_ROW = 1e-3  # part of the largest gain of an input below which others are small
_SHORTEST = 1e-12  # shortest piece, in parts of the horizon
_MOST = 1000  # pieces beside those of the model: what oscillates faster than they tell is left as it is
_GAINED = 6.0  # binary digits that an error loses with each halving, by the order of the steps
_DEEPEST = 8  # halvings of the end of a piece in one go
_AT_ONCE = 32  # pieces: what is behind them has to be known to tell whether they are too long
_ABSCISSAE = 2.0 * Mesh(np.array([0.0, 1.0])).t - 1.0


def regulator_along(
    system: ContinuousSystem, cost: ContinuousCost, curve: DenseTrajectory, jumps: Sequence[float], accuracy: Accuracy
) -> PiecewisePolynomial:
    """Return the gains of the cost's own regulator, without limits, and no feedforward, as functions of time.

    Where the cost has none they are those with identities for weights. ``jumps``: times at which pieces have to end.
    """
    model = sample_model(system, cost, curve, jumps, accuracy)
    gains = _Backwards(model).gains()
    if gains is None:
        gains = _Backwards(model.with_identities()).gains()
    assert gains is not None
    return gains


class _PiecesAhead(NamedTuple):
    """Pieces one after the other, and the steps within them as far as no cost to go is known at their ends.

    ``begin``, ``end`` (n,): times (s). ``moves`` (n, 11, nx, m): where steps lead, by the state that they begin with
    and the inputs at their points. ``H`` (n, 11, m, m): their cost, by the same. The steps are from each point, from
    the middle and from the begin to the end, and from the begin to the middle. ``here`` (n, 8, size): the problem at
    the points.
    """

    begin: Array
    end: Array
    moves: Array
    H: Array
    here: Array

    def some(self, which: slice | NDArray[np.intp]) -> _PiecesAhead:
        """Return some of them."""
        return _PiecesAhead(*(part[which] for part in self))

    def beside(self, others: _PiecesAhead) -> _PiecesAhead:
        """Return these and others, in order."""
        order = np.argsort(np.concatenate([self.begin, others.begin]))
        return _PiecesAhead(*(np.concatenate(parts)[order] for parts in zip(self, others, strict=True)))


def _last_of(ahead: list[_PiecesAhead]) -> _PiecesAhead:
    """Return the last pieces of all, and take them away: those that come at once.

    All others stay where they are in memory: they are many, and large.
    """
    last = ahead.pop()
    while len(last.end) < _AT_ONCE and ahead:
        before, lacks = ahead.pop(), _AT_ONCE - len(last.end)
        ahead += [before.some(slice(None, -lacks))] if len(before.end) > lacks else []
        last = before.some(slice(-lacks, None)).beside(last)
    if len(last.end) > _AT_ONCE:
        ahead.append(last.some(slice(None, -_AT_ONCE)))
        last = last.some(slice(-_AT_ONCE, None))
    return last


class _Backwards:
    """The way backwards through a linear-quadratic problem that is sampled on a mesh."""

    def __init__(self, model: TangentModel) -> None:
        self.mesh, self.Q_final = model.mesh, model.Q_final
        self.nx, self.nu = model.samples.B.shape[1:]
        packed = np.concatenate([part.reshape(len(self.mesh.t), -1) for part in model.samples], axis=1)
        self.problem = self.mesh.fit(packed, packed.shape[1:])

    def gains(self) -> PiecewisePolynomial | None:
        """Return the gains; None where there is no minimum."""
        P = self.Q_final
        ahead, found, made = [self._pieces(self.mesh.breaks[:-1], self.mesh.breaks[1:])], [], 0
        n = len(ahead[0].end)
        least, most = _SHORTEST * (ahead[0].end[-1] - ahead[0].begin[0]), _MOST + n
        while n > 0:
            pieces = _last_of(ahead)
            n -= len(pieces.end)
            may_halve = (pieces.end - pieces.begin > least) & (made + n + len(pieces.end) < most)
            known, escaped = self._costs_to_go(pieces, P)
            if escaped is None:
                K, there, parts = self._laws(pieces, known)
                parts[~may_halve] = 1
                first = int(np.max(np.flatnonzero(parts > 1) + 1, initial=0))  # of those that change no more
                if not there[first:].all():
                    return None
                found.append((pieces.begin[first:], K[first:]))
                P = known[2 * first]
            elif may_halve[escaped]:
                first, parts = len(pieces.end), 1 + (np.arange(len(pieces.end)) == escaped)
            else:
                return None
            made += len(pieces.end) - first
            if first > 0:
                ahead.append(self._exchanged(pieces, parts[:first]))
                n += len(ahead[-1].end)
        begins, values = (np.concatenate(parts[::-1]) for parts in zip(*found, strict=True))
        values = np.concatenate([values, np.zeros((*values.shape[:2], self.nu))], axis=2)
        return Mesh(np.append(begins, self.mesh.breaks[-1])).fit(values, (values.shape[2],))

    def _exchanged(self, pieces: _PiecesAhead, parts: NDArray[np.intp]) -> _PiecesAhead:
        """Return the first pieces in so many parts each, the shorter the later."""
        coarse, kept = np.flatnonzero(parts > 1), pieces.some(np.flatnonzero(parts == 1))
        if not len(coarse):
            return kept
        begins, ends = [], []
        for i in coarse.tolist():
            share = np.append(1.0 - 0.5 ** np.arange(parts[i]), 1.0)
            breaks = pieces.begin[i] + share * (pieces.end[i] - pieces.begin[i])
            breaks[-1] = pieces.end[i]
            begins.append(breaks[:-1])
            ends.append(breaks[1:])
        return kept.beside(self._pieces(np.concatenate(begins), np.concatenate(ends)))

    def _costs_to_go(self, pieces: _PiecesAhead, P: Array) -> tuple[Array, int | None]:
        """Return P (2n+1, nx, nx) at begins and middles of all pieces and at the end, and the piece that has none."""
        steps = [POINTS + 2, POINTS]
        moves, H = (part[:, steps].reshape(-1, *part.shape[2:]) for part in (pieces.moves, pieces.H))
        A, B = moves[:, :, : self.nx], moves[:, :, self.nx :]
        try:
            done = solve_linear_quadratic(A, B, H=H, Q_final=P, use_structure=False, keep_P=True)
        except ArgumentError:  # what is not finite any more
            return P, 0
        assert done.P is not None
        return done.P, None if done.stage is None else done.stage // 2

    def _laws(self, pieces: _PiecesAhead, known: Array) -> tuple[Array, Flags, NDArray[np.intp]]:
        """Return the gains (n, 8, nu nx) at the points, where there are any, and in how many parts pieces go."""
        begin, end = known[:-1:2], known[2::2]
        whole, good = self._steps(pieces, slice(POINTS + 1, POINTS + 2), end)
        size = np.sqrt(np.abs(np.diagonal(begin, axis1=1, axis2=2)))
        allowed = size[:, :, None] * size[:, None] + 1e-3 * np.abs(begin).max(axis=(1, 2), keepdims=True)
        off = (np.abs(begin - whole[:, 0]) / (_CLOSE * allowed + 1e-300)).max(axis=(1, 2))
        P, there = self._steps(pieces, slice(POINTS), end)
        here = self._unpacked(pieces.here.reshape(-1, pieces.here.shape[2]))
        right = here.B.transpose(0, 2, 1) @ P.reshape(-1, self.nx, self.nx) + here.S.transpose(0, 2, 1)
        K: Array = np.asarray(np.linalg.solve(here.R, right)).reshape(len(end), POINTS, -1)
        error = np.maximum(np.maximum(off, self._rough(K)), 1e-3)
        halvings = np.clip(np.ceil(np.log2(error) / _GAINED), 0, _DEEPEST)
        return K, there, 1 + np.where(good & there, halvings, 1).astype(np.intp)

    def _rough(self, K: Array) -> Array:
        """Return what gains are off the polynomials of the degree that these have, in parts of what they may be."""
        coefficients = np.abs(Mesh(np.arange(len(K) + 1.0)).coefficients(K))
        size = coefficients.max(axis=1).reshape(-1, self.nu, self.nx)
        size = np.maximum(size, _IN_ROW * size.max(axis=2, keepdims=True)).reshape(len(K), -1)
        tail = np.maximum(coefficients[:, -1], 0.1 * coefficients[:, -2])
        return np.asarray((tail / (_CLOSE * size + 1e-300)).max(axis=1))

    def _steps(self, pieces: _PiecesAhead, which: slice, end: Array) -> tuple[Array, Flags]:
        """Return P (n, steps, nx, nx) where steps begin, by that at the ends of pieces, and which have a minimum."""
        moves, nx = pieces.moves[:, which], self.nx
        H = pieces.H[:, which] + moves.transpose(0, 1, 3, 2) @ end[:, None] @ moves
        by_u, mixed = H[..., nx:, nx:], H[..., nx:, :nx]
        good = np.ones(H.shape[:2], dtype=np.bool_)
        try:
            np.linalg.cholesky(by_u)
        except np.linalg.LinAlgError:
            good = np.linalg.eigvalsh(by_u)[..., 0] > 0.0
            by_u = np.where(good[..., None, None], by_u, np.eye(by_u.shape[-1]))
        found = H[..., :nx, :nx] - mixed.transpose(0, 1, 3, 2) @ np.linalg.solve(by_u, mixed)
        return 0.5 * (found + found.transpose(0, 1, 3, 2)), np.asarray(good.all(axis=1))

    def _pieces(self, begins: Array, ends: Array) -> _PiecesAhead:
        """Return pieces and the steps within them, all made at once."""
        middles = 0.5 * (begins + ends)
        points = middles[:, None] + 0.5 * (ends - begins)[:, None] * _ABSCISSAE
        starts = np.column_stack([points, middles, begins, begins])
        stops = np.column_stack([np.tile(ends[:, None], (1, POINTS + 2)), middles])
        moves, H = self._made(starts.ravel(), stops.ravel())
        split = (len(begins), POINTS + 3)
        return _PiecesAhead(
            begins,
            ends,
            moves.reshape(*split, *moves.shape[1:]),
            H.reshape(*split, *H.shape[1:]),
            self.problem(points),
        )

    def _made(self, starts: Array, ends: Array) -> tuple[Array, Array]:
        """Return where steps between times lead, and what they cost, as of `_PiecesAhead`."""
        n, nx, nu = len(starts), self.nx, self.nu
        h = (ends - starts)[:, None, None]
        t = starts[:, None] + h[:, 0] * NODES
        t[:, -1] = np.nextafter(ends, -np.inf)
        along = self._unpacked(self.problem(t.ravel()))
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

    def _unpacked(self, samples: Array) -> ModelSamples:
        return ModelSamples.unpack(samples, self.nx, self.nu)
