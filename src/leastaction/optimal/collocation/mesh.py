"""The pieces of a horizon and their points (Radau IIA of three stages, order 5)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.quantity import Instants

_ROOT = np.sqrt(6.0)
NODES = np.array([(4.0 - _ROOT) / 10.0, (4.0 + _ROOT) / 10.0, 1.0])
"""The points of a piece of length 1."""
STAGES = len(NODES)
"""Points of a piece; the last one is its end."""

# The state's rate is a polynomial through its values at the points; integrals of the polynomials that are one at one of
# them give the method's matrix: the exactness of collocation.
_POWERS = np.arange(STAGES)
MATRIX = (NODES[:, None] ** (_POWERS + 1) / (_POWERS + 1)) @ np.linalg.inv(NODES[:, None] ** _POWERS)
"""``x_i = x_0 + h sum_j MATRIX[i, j] f(x_j)``."""
WEIGHTS = MATRIX[-1]
"""``int g = h sum_i WEIGHTS[i] g(t_i)``, exact up to degree 4."""

_FROM_STATES = np.linalg.inv(chebyshev.chebvander(np.concatenate([[-1.0], 2.0 * NODES - 1.0]), STAGES))
_FROM_INPUTS = np.linalg.inv(chebyshev.chebvander(2.0 * NODES - 1.0, STAGES - 1))
_START = chebyshev.chebvander(np.array([-1.0]), STAGES - 1)[0] @ _FROM_INPUTS

# Where the rate of the polynomial is held against the dynamics: between the points.
_BETWEEN = np.concatenate([[0.5 * NODES[0]], 0.5 * (NODES[1:] + NODES[:-1])])


class RadauMesh:
    """A horizon in pieces. Nothing in it changes.

    ``breaks`` (N+1,): ends of the pieces (s). ``h`` (N,): their lengths. ``t`` (N, STAGES): times of the points, the
    last one just before the end of the piece, so that what jumps there is taken from before. ``points``
    (1 + N STAGES,): all of them, the start first, as they are told. ``weights`` (N, STAGES): of the quadrature over
    them.
    """

    def __init__(self, breaks: Array) -> None:
        self.breaks = breaks
        self.h: Array = np.diff(breaks)
        at = breaks[:-1, None] + self.h[:, None] * NODES
        at[:, -1] = breaks[1:]
        self.points: Array = np.concatenate([breaks[:1], at.ravel()])
        self.t: Array = at.copy()
        self.t[:, -1] = np.nextafter(breaks[1:], -np.inf)
        self.weights: Array = self.h[:, None] * WEIGHTS
        self.N = len(self.h)

    @property
    def weights_of_points(self) -> Array:
        """The weights (1 + N STAGES,) of all points, the start first, where there is 1."""
        return np.concatenate([[1.0], self.weights.ravel()])

    @classmethod
    def first(cls, t0: float, tf: float, inner: Sequence[float], pieces: int) -> RadauMesh:
        """Return a mesh of about so many pieces, with these times among their ends."""
        span = tf - t0
        ends = np.array([t0, *sorted({t for t in inner if t0 + 1e-9 * span < t < tf - 1e-9 * span}), tf])
        ends = ends[np.concatenate([[True], np.diff(ends) > 1e-9 * span])]
        parts = [np.linspace(a, b, 1 + max(1, round(pieces * (b - a) / span)))[:-1] for a, b in pairwise(ends.tolist())]
        return cls(np.concatenate([*parts, [tf]]))

    def halved(self, coarse: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> RadauMesh:
        """Return the mesh with these pieces halved."""
        middles = 0.5 * (self.breaks[1:] + self.breaks[:-1])
        return RadauMesh(np.sort(np.concatenate([self.breaks, middles[coarse]])))

    def curve(self, x0: Array, x: Array, u: Array) -> PiecewisePolynomial:
        """Return states and inputs in one vector over time, given those at the points (N, STAGES, ...)."""
        starts = np.concatenate([x0[None, :], x[:-1, -1]])[:, None]
        states = _FROM_STATES @ np.concatenate([starts, x], axis=1)
        inputs = np.zeros((self.N, STAGES + 1, u.shape[2]))
        inputs[:, :STAGES] = _FROM_INPUTS @ u
        return PiecewisePolynomial(
            self.breaks, np.concatenate([states, inputs], axis=2), (states.shape[2] + u.shape[2],)
        )

    @staticmethod
    def inputs_at_breaks(u: Array) -> Array:
        """Return inputs (N+1, nu) at the ends of pieces, of the piece that begins there, given those at the points."""
        return np.concatenate([np.einsum("s,nsi->ni", _START, u), u[-1:, -1]])

    def between(self) -> Array:
        """Return times (N, n) between the points."""
        return np.asarray(self.breaks[:-1, None] + self.h[:, None] * _BETWEEN)

    @staticmethod
    def leaps(u: Array) -> Array:
        """Return by how much inputs (N, STAGES, nu) jump where one piece's polynomial ends and the next one's begins.

        At the first piece nothing ends, so its own is that of the second.
        """
        jumps = np.abs(np.einsum("s,nsi->ni", _START, u[1:]) - u[:-1, -1])
        return np.concatenate([jumps[:1], jumps]) if len(jumps) else np.zeros((1, u.shape[2]))


# The state at the end of a piece comes first, then those of its other points.
ORDER = np.array([STAGES - 1, *range(STAGES - 1)])
PLACE = np.argsort(ORDER)


class NodeLayout:
    """Where states and inputs of the points are in the state of the discrete system, ``z = [x(end); x(others); u]``.

    The end of a piece comes first, so the state of the continuous system is the first nx entries.
    """

    def __init__(self, nx: int, nu: int) -> None:
        self.nx, self.nu = nx, nu
        self.nz = STAGES * (nx + nu)
        # Which entries of [A B] may differ from zero: inputs are copied, and the rest depends on the end before.
        self.pattern = np.zeros((self.nz, self.nz + STAGES * nu), dtype=np.bool_)
        self.pattern[: STAGES * nx, :nx] = self.pattern[: STAGES * nx, self.nz :] = True
        self.pattern[STAGES * nx :, self.nz :] = np.eye(STAGES * nu, dtype=np.bool_)
        self.pattern.setflags(write=False)
        # The entries of [z; u] that it has columns of, and those of a matrix by them that are packed.
        self.used = np.concatenate([np.arange(nx), self.nz + np.arange(STAGES * nu)])
        self.lower = np.tril_indices(len(self.used))

    def places(self, stage: int) -> Instants:
        """Return where state and input of a point are in z, (nx + nu,)."""
        x = int(PLACE[stage]) * self.nx + np.arange(self.nx)
        return np.concatenate([x, STAGES * self.nx + stage * self.nu + np.arange(self.nu)])

    def points(self, z: Array) -> tuple[Array, Array]:
        """Return states (n, STAGES, nx) and inputs (n, STAGES, nu) of the points, given z (n, nz)."""
        x = z[:, : STAGES * self.nx].reshape(len(z), STAGES, self.nx)[:, PLACE]
        return x, z[:, STAGES * self.nx :].reshape(len(z), STAGES, self.nu)

    def joined(self, x: Array, u: Array) -> Array:
        """Return z (n, nz) of states and inputs of the points."""
        n = len(x)
        return np.hstack([x[:, ORDER].reshape(n, -1), u.reshape(n, -1)])
