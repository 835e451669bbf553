"""The point of a constraint surface that is nearest to a given one.

    minimise 1/2 (q - q0)^T W (q - q0)   subject to   h(q) = 0

over the free variables, W diagonal, by sequential quadratic programming in ``s = W^(1/2) (q - q0)``, where ``q - q0``
is the rotation vector between them of a rotation that is a quaternion, and the metric is the identity, with steps as in
`leastaction.mechanics.configuration.null_space`: the slope is s, and ``B = 1 + sum_i lam_i d2h_i``.

The curvature of the constraints in B makes the convergence quadratic however far q0 is; without it the iteration
diverges as soon as the correction is longer than the radius of curvature. Where ``Z^T B Z`` is not positive definite,
``t = -Z Z^T s`` descends. The exact penalty ``1/2 |s|^2 + sum_i m_i |h_i|`` decides how far to go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.mechanics.configuration.null_space import (
    RANK_TOLERANCE,
    Indices,
    NullSpace,
    all_finite,
    restoring,
    row_scales,
)
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import difference, moved_by, turned
from leastaction.numerics.arrays import Array

# Part of the squared residual that a motion of size one may lessen, to first order, where it counts as least.
_BLOCKED = 1e-4
# The penalty may fall in the first steps of every so many.
_FORGETFUL, _PERIOD = 40, 50
# Steps along the search direction that are shorter are left for plain restoration.
_SHORTEST = 1e-5
# Steps of the search for where the constraints are violated least.
_MOST_STEPS = 200
# Of numbers near the largest double squares overflow; a point where they do is no better than the last.
_QUIET = np.errstate(over="ignore", invalid="ignore")


@dataclass(frozen=True, eq=False)
class ConstraintProjection:
    """A least-change problem.

    ``mechanism``: whose constraints are h. ``start`` (nq,): the wanted point q0. ``free`` (n_free,): the variables
    that may change. ``root`` (n_free,): square roots of their weights.
    """

    mechanism: Mechanism
    start: Array
    free: Indices
    root: Array

    @_QUIET
    def solve(self, tolerance: float, max_iterations: int, attempts: int = 1) -> tuple[Array, int]:
        """Return the point that was reached and the number of steps; the caller checks h there.

        ``tolerance``: largest ``|h_i| / row_scales``. ``max_iterations``: bound on the steps of each attempt.
        ``attempts``: starting points that are tried until one leads to the constraints, the wanted point first.
        """
        total = 0
        reached = self.start
        for attempt in range(attempts):
            # |h| can be stuck where its gradient vanishes and h does not; setting out from beside the
            # wanted point leads around. The change is still measured from the wanted point.
            aside = np.random.default_rng(attempt).normal(size=len(self.free))
            s, steps = self._descend(0.5 * attempt * aside, tolerance, max_iterations)
            total += steps
            h, jacobian, limits = self._at(s)
            if attempt == 0 or np.all(np.abs(h) <= tolerance * limits):
                reached = self._configuration(s)
            if np.all(np.abs(h) <= tolerance * limits) or not all_finite(h, jacobian):
                break
        return reached, total

    def _descend(self, s: Array, tolerance: float, max_iterations: int) -> tuple[Array, int]:
        """Iterate from s; return the point that was reached and the number of steps."""
        h, jacobian, limits = self._at(s)
        penalty = np.ones(len(h))
        steps, only_restoring = 0, False
        while steps < max_iterations and all_finite(h, jacobian):
            feasible = bool(np.all(np.abs(h) <= tolerance * limits))
            only_restoring = only_restoring and not feasible
            normal, along, multiplier = self._directions(s, h, jacobian, loose=not feasible)
            if feasible and np.linalg.norm(along) <= 1e-9 * (1.0 + np.linalg.norm(s)):
                break
            # A multiplier that was large near a singular place is forgotten again; but not at all times, or
            # two places that each make the other look better may take turns for ever.
            kept = penalty if steps % _PERIOD >= _FORGETFUL else penalty / 2.0
            penalty = np.maximum(kept, 1.0 + 2.0 * np.abs(multiplier))
            following = None
            if not only_restoring:
                following = self._search(s, h, jacobian, normal, along, penalty)
            if following is None and not feasible:
                # The penalty is stuck: plain restoration tells whether the constraints can be met. It goes on
                # until they are, or the next search would lead back.
                only_restoring = True
                following = self._restore(s, h, jacobian)
            if following is None:
                break
            s = following
            h, jacobian, limits = self._at(s)
            steps += 1
        return self._polish(s), steps

    def _configuration(self, s: Array) -> Array:
        return moved_by(self.mechanism, self.start, self._move(s))

    def _move(self, s: Array) -> Array:
        """Return how far all variables are from the wanted point, (nv,)."""
        move = np.zeros(self.mechanism.nv)
        move[self.free] = s / self.root
        return move

    def _by_s(self, s: Array) -> Array:
        """Return the derivative (nv, n_free) of the configuration by s, as moves of that."""
        return turned(self.mechanism, self._move(s))[:, self.free] / self.root

    def _h(self, s: Array) -> Array:
        return self.mechanism.core.constraints(self._configuration(s))

    def _at(self, s: Array) -> tuple[Array, Array, Array]:
        """Return h, its Jacobian by s, and the scale of each h_i."""
        q = self._configuration(s)
        # What has been checked once is not looked at again, and a point out of range ends the search by its values.
        m = self.mechanism
        full = m.core.constraint_jacobian(q).reshape(m.nc, m.nv)
        jacobian = full @ self._by_s(s) if m.tree.rotations else full[:, self.free] / self.root
        return m.core.constraints(q), jacobian, row_scales(full)

    def _directions(self, s: Array, h: Array, jacobian: Array, *, loose: bool) -> tuple[Array, Array, Array]:
        """Return the restoring part of the step, the part along the constraints, and the multiplier."""
        space = NullSpace.of(jacobian, h if loose else None)
        null, normal, multiplier = space.basis, -space.inverse @ h, space.multiplier(s)
        if not jacobian.size or not null.shape[1]:
            return normal, -null @ (null.T @ s), multiplier
        curvature = self._curvature(s, multiplier)
        reduced = np.eye(null.shape[1]) + space.reduced(curvature)
        try:
            np.linalg.cholesky(reduced)
        except np.linalg.LinAlgError:
            return normal, -null @ (null.T @ s), multiplier
        target = null.T @ (s + normal + curvature @ normal)
        return normal, -null @ np.linalg.solve(reduced, target), multiplier

    def _curvature(self, s: Array, multiplier: Array) -> Array:
        """Return the Hessian of ``multiplier . h`` by s."""
        full = self.mechanism.core.constraint_hessian(self._configuration(s), multiplier)
        if self.mechanism.tree.rotations:
            # How the chart about the wanted point bends is left out: it is small, and costs steps at most.
            by_s = self._by_s(s)
            return np.asarray(by_s.T @ full @ by_s)
        return full[np.ix_(self.free, self.free)] / np.outer(self.root, self.root)

    def _search(self, s: Array, h: Array, jacobian: Array, normal: Array, along: Array, penalty: Array) -> Array | None:
        """Return the next point, at which the exact penalty has fallen enough; None if there is none."""

        def falls(point: Array, h_there: Array, length: float) -> bool:
            there = 0.5 * float(point @ point) + float(penalty @ np.abs(h_there))
            return there <= here + 1e-4 * length * expected

        here = 0.5 * float(s @ s) + float(penalty @ np.abs(h))
        direction = normal + along
        # What the step leaves of h: nothing, but for singular values that were passed over.
        left = np.abs(h + jacobian @ direction)
        expected = float(s @ direction) - float(penalty @ (np.abs(h) - left))
        if expected >= 0.0:
            return None
        trial = s + direction
        h_trial, jacobian, _ = self._at(trial)
        if falls(trial, h_trial, 1.0):
            return trial
        # A full step along a curved surface leaves it; bringing it back first keeps convergence fast.
        corrected = trial + restoring(jacobian, h_trial)
        if falls(corrected, self._h(corrected), 1.0):
            return corrected
        length = 0.5
        while length > _SHORTEST:
            trial = s + length * direction
            if falls(trial, self._h(trial), length):
                return trial
            length *= 0.5
        return None

    def _restore(self, s: Array, h: Array, jacobian: Array) -> Array | None:
        """Return the next point on the way to the constraints, where |h| has fallen; None if none.

        Levenberg's and Marquardt's step: near a place where the Jacobian loses rank the undamped one is
        long and leads nowhere.
        """
        if not jacobian.size:
            return None
        left, sizes, right = np.linalg.svd(jacobian, full_matrices=False)
        parts, here = left.T @ h, float(np.linalg.norm(h))
        for damping in (0.0, *np.logspace(-8, 2, 11)):
            filtered = sizes / (sizes**2 + damping * sizes[0] ** 2 + np.finfo(float).tiny)
            filtered[sizes <= RANK_TOLERANCE * sizes[0]] = 0.0
            change = -right.T @ (filtered * parts)
            gain = here - float(np.linalg.norm(h + jacobian @ change))
            trial: Array = s + change
            if float(np.linalg.norm(self._h(trial))) <= here - 0.1 * gain and gain > 1e-9 * here:
                return trial
        return None

    def _polish(self, s: Array) -> Array:
        """Return s after the few restoring steps that still lessen |h|, down to rounding."""
        h, jacobian, _ = self._at(s)
        for _ in range(3):
            if not jacobian.size or not np.any(h) or not all_finite(h, jacobian):
                break
            trial = s + restoring(jacobian, h)
            h_trial, jacobian, _ = self._at(trial)
            if float(np.linalg.norm(h_trial)) >= float(np.linalg.norm(h)):
                break
            s, h = trial, h_trial
        return s

    @_QUIET
    def least_residual(self, q: Array) -> tuple[Array, Array]:
        """Return the point near q where the constraints are violated least, and which of them block there.

        Minimises ``sum_i (h_i / scale_i)^2`` by Levenberg's and Marquardt's method. Where that sum is least and
        not zero, the residuals are a combination in the left null space of the Jacobian: the equations with a
        part in it pull against each other.

        ``q`` (nq,): where to start. Returns ``q`` (nq,): the point that was
        reached; ``parts`` (nc,): part of the residual of each equation, relative to its scale, that no small motion
        lessens; zero where q is no such point.
        """
        s = difference(self.mechanism, q, self.start)[self.free] * self.root
        scales = self._at(s)[2]

        def scaled(s: Array) -> tuple[Array, Array]:
            h, jacobian, _ = self._at(s)
            return h / scales, jacobian / scales[:, None]

        h, jacobian = scaled(s)
        damping, eye = 1e-3, np.eye(len(s))
        for _ in range(_MOST_STEPS):
            slope, normal = jacobian.T @ h, jacobian.T @ jacobian
            if not all_finite(h, jacobian) or np.linalg.norm(slope) <= 1e-14 * np.linalg.norm(h):
                break
            # Where the residual is large, its own curvature, left out of `normal`, is of its size.
            size = max(float(np.trace(normal)), float(np.linalg.norm(h)))
            try:
                trial = s - np.linalg.solve(normal + damping * size * eye, slope)
            except np.linalg.LinAlgError:
                break  # numbers so small that their squares vanish, or so large that they overflow
            h_trial, jacobian_trial = scaled(trial)
            if np.linalg.norm(h_trial) < np.linalg.norm(h):
                s, h, jacobian, damping = trial, h_trial, jacobian_trial, 0.2 * damping
            elif damping > 1e6:
                break
            else:
                damping *= 5.0
        residual = float(np.linalg.norm(h))
        # h is in the left null space of the Jacobian: to first order no motion of size one lessens it.
        slope = jacobian.T @ h
        blocked = all_finite(h, jacobian) and np.linalg.norm(slope) <= _BLOCKED * residual * residual
        return self._configuration(s), h if blocked else np.zeros(len(h))
