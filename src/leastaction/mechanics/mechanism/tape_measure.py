"""Lengths of paths over frames, with their rates and derivatives, of whatever mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import final

import numpy as np

from leastaction.errors import ArgumentError, brief
from leastaction.mechanics.mechanism.arguments import batch, batch_of_states, frame_index, shaped
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, Row, require_instance
from leastaction.numerics.names import as_names
from leastaction.numerics.public import public


@public
@final
class TapeMeasure:
    """The length s of the path through the origins of frames, as a function of the configuration.

    Nothing in it changes: threads may share it.

    Parameters
    ----------
    mechanism : Mechanism
    frames : sequence of str
        Two frames or more, in the order of the path.

    Raises
    ------
    ArgumentError
        For fewer than two frames, unknown ones, or one that follows itself.
    """

    def __init__(self, mechanism: Mechanism, frames: Sequence[str]) -> None:
        require_instance(mechanism, "mechanism", Mechanism)
        frames = as_names(frames, "frames", "frames")
        if len(frames) < 2:
            raise ArgumentError(f"frames: got {brief(repr(frames))}, expected two frames or more")
        for name in frames:
            frame_index(mechanism, name)
        for first, second in pairwise(frames):
            if first == second:
                raise ArgumentError(f"frames: {first!r} follows itself, expected another frame between")
        self.mechanism = mechanism
        self.frames = tuple(frames)

    def length(self, q: Row) -> float | Array:
        """Return the length (m) at q of shape (nq,), or (N,) for a batch (N, nq)."""
        values, one = batch(self.mechanism, q)
        length = self._pieces(values)[1].sum(axis=1)
        return float(length[0]) if one else length

    def gradient(self, q: Row) -> Array:
        """Return ``ds/dq`` (nq,), or (N, nq) for a batch. Raises `ArgumentError` where two frames of the path meet."""
        values, one = batch(self.mechanism, q)
        directions, _ = self._directions(values)
        return shaped(np.einsum("npa,npai->ni", directions, self._by_variables(values)), one)

    def hessian(self, q: Row) -> Array:
        """Return the second derivative (nq, nq), or (N, nq, nq) for a batch; errors as of `gradient`."""
        m = self.mechanism
        values, one = batch(m, q)
        n, lengths = self._directions(values)
        J = self._by_variables(values)
        bends = [m.frame_jacobian_derivative(values, frame)[:, :3] for frame in self.frames]
        bend = np.stack([second - first for first, second in pairwise(bends)], axis=1)
        along = np.einsum("npa,npai->npi", n, J)
        square = np.einsum("npai,npaj->npij", J, J) - along[..., :, None] * along[..., None, :]
        found = np.einsum("npa,npaij->nij", n, bend) + (square / lengths[:, :, None, None]).sum(axis=1)
        return shaped(np.asarray(0.5 * (found + found.swapaxes(1, 2))), one)

    def rate(self, q: Row, v: Row) -> float | Array:
        """Return how fast the length grows (m/s) at q, v of shape (nq,), or (N,) for a batch (N, nq)."""
        values, speeds, one = batch_of_states(self.mechanism, q, v)
        rate = np.einsum("ni,ni->n", self.gradient(values), speeds)
        return float(rate[0]) if one else rate

    def rate_derivatives(self, q: Row, v: Row) -> tuple[Array, Array]:
        """Return the derivatives of `rate` by q and by v, (nq,) each, or (N, nq) for a batch."""
        values, speeds, one = batch_of_states(self.mechanism, q, v)
        by_q = np.einsum("nij,nj->ni", self.hessian(values), speeds)
        return shaped(by_q, one), shaped(self.gradient(values), one)

    def __repr__(self) -> str:
        return f"<TapeMeasure {' - '.join(self.frames)}>"

    def _pieces(self, q: Array) -> tuple[Array, Array]:
        """Return from which frame to the next (N, pieces, 3), and how far (N, pieces)."""
        between = np.diff(self.mechanism.positions(q, self.frames), axis=1)
        return between, np.linalg.norm(between, axis=2)

    def _directions(self, q: Array) -> tuple[Array, Array]:
        between, lengths = self._pieces(q)
        if not np.all(lengths > 0.0):
            k = int(np.argwhere(~(lengths > 0.0))[0][1])
            raise ArgumentError(
                f"the frames {self.frames[k]!r} and {self.frames[k + 1]!r} meet in this configuration, where the "
                "length between them has no derivative; keep them apart"
            )
        return between / lengths[:, :, None], lengths

    def _by_variables(self, q: Array) -> Array:
        """Return the derivatives of the pieces by the variables (N, pieces, 3, nq)."""
        J = [self.mechanism.frame_jacobian(q, frame)[:, :3] for frame in self.frames]
        return np.stack([second - first for first, second in pairwise(J)], axis=1)
