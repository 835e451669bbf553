"""The point of a constraint surface that is nearest to a given one.

    minimise 1/2 (q - q0)^T W (q - q0)   subject to   h(q) = 0

over the free entries of q, W diagonal, by sequential quadratic programming in ``s = W^(1/2) (q - q0)``, where
the metric is the identity. With ``A = dh/ds`` and the multiplier ``lam = -A^+T s``, a step ``d = n + t`` has
a part that restores the constraints, ``n = -A^+ h`` (of least norm, so redundant constraints do no harm),
and a part along them, with Z a basis of the null space of A:

    t = -Z (Z^T B Z)^-1 Z^T (s + B n),   B = 1 + sum_i lam_i d2h_i.

The curvature of the constraints in B makes the convergence quadratic however far q0 is; without it the
iteration diverges as soon as the correction is longer than the radius of curvature. Where ``Z^T B Z`` is
not positive definite, ``t = -Z Z^T s`` descends. The exact penalty
``1/2 |s|^2 + sum_i m_i |h_i|`` decides how far to go.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from leastaction.mechanics.arguments import Array

Indices = npt.NDArray[np.intp]

# Singular values below this fraction of the largest count as zero: redundant constraints.
RANK_TOLERANCE = 1e-10
# Starting points that are tried until one leads to the constraints.
ATTEMPTS = 6


def row_scales(jacobian: Array) -> Array:
    """Return the scale that the residual of each constraint is compared with.

    ``max(1, |Dh_i|, |Dh_i|^2 / 4)``: the second makes it a distance in units of q, the third is the square
    of a `Distance`'s length, whose rounding the residual cannot fall below.
    """
    norms = np.linalg.norm(jacobian, axis=1)
    scales: Array = np.maximum(np.maximum(1.0, norms), norms**2 / 4.0)
    return scales


def _finite(*arrays: Array) -> bool:
    return all(bool(np.isfinite(array).all()) for array in arrays)


class LeastChange:
    """A least-change problem.

    Parameters
    ----------
    values, jacobian : callable
        h(q), shape (nc,), and Dh(q), shape (nc, nq).
    start : ndarray, shape (nq,)
        The wanted point q0.
    free : ndarray of int, shape (n_free,)
        The entries of q that may change.
    root : ndarray, shape (n_free,)
        Square roots of their weights.
    """

    def __init__(
        self,
        values: Callable[[Array], Array],
        jacobian: Callable[[Array], Array],
        start: Array,
        free: Indices,
        root: Array,
    ) -> None:
        self._values = values
        self._jacobian = jacobian
        self.start = start
        self.free = free
        self.root = root

    def solve(self, tolerance: float, max_iterations: int) -> tuple[Array, int]:
        """Return the point that was reached and the number of steps; the caller checks h there.

        Parameters
        ----------
        tolerance : float
            Largest ``|h_i| / row_scales``.
        max_iterations : int
            Bound on the steps of each attempt.
        """
        total = 0
        reached = self.start
        for attempt in range(ATTEMPTS):
            # |h| can be stuck where its gradient vanishes and h does not; setting out from beside the
            # wanted point leads around. The change is still measured from the wanted point.
            aside = np.random.default_rng(attempt).normal(size=len(self.free))
            s, steps = self._descend(0.5 * attempt * aside, tolerance, max_iterations)
            total += steps
            h, jacobian, limits = self._at(s)
            if attempt == 0 or np.all(np.abs(h) <= tolerance * limits):
                reached = self._configuration(s)
            if np.all(np.abs(h) <= tolerance * limits) or not _finite(h, jacobian):
                break
        return reached, total

    def _descend(self, s: Array, tolerance: float, max_iterations: int) -> tuple[Array, int]:
        """Iterate from s; return the point that was reached and the number of steps."""
        h, jacobian, limits = self._at(s)
        penalty = np.ones(len(h))
        steps = 0
        while steps < max_iterations and _finite(h, jacobian):
            feasible = bool(np.all(np.abs(h) <= tolerance * limits))
            normal, along, multiplier = self._directions(s, h, jacobian)
            if feasible and np.linalg.norm(along) <= 1e-9 * (1.0 + np.linalg.norm(s)):
                break
            # Halved at most: a multiplier that was large near a singular place is forgotten again.
            penalty = np.maximum(penalty / 2.0, 1.0 + 2.0 * np.abs(multiplier))
            following = self._search(s, h, normal, along, penalty)
            if following is None and not feasible:
                # The penalty is stuck: plain restoration tells whether the constraints can be met.
                following = self._restore(s, h, normal)
            if following is None:
                break
            s = following
            h, jacobian, limits = self._at(s)
            steps += 1
        return self._polish(s), steps

    def _configuration(self, s: Array) -> Array:
        q = self.start.copy()
        q[self.free] += s / self.root
        return q

    def _h(self, s: Array) -> Array:
        return self._values(self._configuration(s))

    def _at(self, s: Array) -> tuple[Array, Array, Array]:
        """Return h, its Jacobian by s, and the scale of each h_i."""
        q = self._configuration(s)
        full = self._jacobian(q)
        return self._values(q), full[:, self.free] / self.root, row_scales(full)

    def _directions(self, s: Array, h: Array, jacobian: Array) -> tuple[Array, Array, Array]:
        """Return the restoring part of the step, the part along the constraints, and the multiplier."""
        if not jacobian.size:
            return np.zeros(len(s)), -s, np.zeros(len(h))
        left, sizes, right = np.linalg.svd(jacobian)
        rank = int(np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes[0])))
        inverse = (right[:rank].T / sizes[:rank]) @ left[:, :rank].T
        normal, multiplier = -inverse @ h, -inverse.T @ s
        null = right[rank:].T
        if not null.shape[1]:
            return normal, np.zeros(len(s)), multiplier
        curvature = self._curvature(s, multiplier)
        reduced = np.eye(null.shape[1]) + null.T @ curvature @ null
        try:
            np.linalg.cholesky(reduced)
        except np.linalg.LinAlgError:
            return normal, -null @ (null.T @ s), multiplier
        target = null.T @ (s + normal + curvature @ normal)
        return normal, -null @ np.linalg.solve(reduced, target), multiplier

    def _curvature(self, s: Array, multiplier: Array) -> Array:
        """Return the Hessian of ``multiplier . h`` by s: central differences of the exact Jacobian.

        Its error slows the last steps a little and does not move the solution, so differences do.
        """
        result = np.zeros((len(s), len(s)))
        if not np.any(multiplier):
            return result
        for i in range(len(s)):
            step = np.zeros(len(s))
            step[i] = 1e-5 * max(1.0, abs(s[i]))
            change = self._at(s + step)[1] - self._at(s - step)[1]
            result[i] = multiplier @ change / (2.0 * step[i])
        return (result + result.T) / 2.0

    def _search(
        self, s: Array, h: Array, normal: Array, along: Array, penalty: Array
    ) -> Array | None:
        """Return the next point, at which the exact penalty has fallen enough; None if there is none."""

        def falls(point: Array, h_there: Array, length: float) -> bool:
            there = 0.5 * float(point @ point) + float(penalty @ np.abs(h_there))
            return there <= here + 1e-4 * length * expected

        here = 0.5 * float(s @ s) + float(penalty @ np.abs(h))
        direction = normal + along
        expected = float(s @ direction) - float(penalty @ np.abs(h))
        if expected >= 0.0:
            return None
        trial = s + direction
        h_trial, jacobian, _ = self._at(trial)
        if falls(trial, h_trial, 1.0):
            return trial
        # A full step along a curved surface leaves it; bringing it back first keeps convergence fast.
        corrected = trial + np.linalg.lstsq(jacobian, -h_trial, rcond=RANK_TOLERANCE)[0]
        if falls(corrected, self._h(corrected), 1.0):
            return corrected
        length = 0.5
        while length > 1e-10:
            trial = s + length * direction
            if falls(trial, self._h(trial), length):
                return trial
            length *= 0.5
        return None

    def _restore(self, s: Array, h: Array, normal: Array) -> Array | None:
        """Return the next point on the way to the constraints, where |h| has fallen; None if none."""
        length, here = 1.0, float(np.linalg.norm(h))
        while length > 1e-6:
            trial = s + length * normal
            if float(np.linalg.norm(self._h(trial))) < (1.0 - 1e-4 * length) * here:
                return trial
            length *= 0.5
        return None

    def _polish(self, s: Array) -> Array:
        """Return s after the few restoring steps that still lessen |h|, down to rounding."""
        h, jacobian, _ = self._at(s)
        for _ in range(3):
            if not jacobian.size or not np.any(h) or not _finite(h, jacobian):
                break
            trial = s + np.linalg.lstsq(jacobian, -h, rcond=RANK_TOLERANCE)[0]
            h_trial, jacobian, _ = self._at(trial)
            if float(np.linalg.norm(h_trial)) >= float(np.linalg.norm(h)):
                break
            s, h = trial, h_trial
        return s
