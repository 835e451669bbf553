"""The solution of a step, followed from a time step of nothing in many small parts.

Of the package only momenta at the ends of a segment and the constraints are used; Newton's matrix is made of
differences.
"""

from __future__ import annotations

import numpy as np

from leastaction.mechanics import MidpointVI

Array = np.ndarray
_LEAST = 1e-6  # of the time step: nothing, and the shortest part


class _Path:
    """The equations of a step over a part ``tau`` of the time step, of the velocities and multipliers y."""

    def __init__(self, vi: MidpointVI, q1: Array, p1: Array, u: Array, dt: float) -> None:
        m = vi.mechanism
        assert m.nrho == 0
        self.vi, self.m, self.q1, self.p1, self.u, self.dt = vi, m, q1, p1, u, dt
        self.C1 = m.constraint_jacobian(q1)

    def residual(self, y: Array, tau: float) -> Array:
        nd = self.m.nd
        q2 = self.q1 + tau * y[:nd]
        p, _ = self.vi.core.momenta(self.q1, q2, self.u, tau)
        h = self.m.constraint_values(q2) / tau
        return np.concatenate([self.p1 - p - self.C1.T @ y[nd:], h])

    def matrix(self, y: Array, tau: float) -> Array:
        columns = []
        for i in range(len(y)):
            e = np.zeros(len(y))
            e[i] = 1e-6 * max(1.0, abs(y[i]))
            difference = self.residual(y + e, tau) - self.residual(y - e, tau)
            columns.append(difference / (2.0 * e[i]))
        return np.array(columns).T

    def correct(self, y: Array, tau: float) -> tuple[Array, float] | None:
        """Return the solution from a guess and how far the first correction went."""
        first = None
        for _ in range(12):
            with np.errstate(all="ignore"):
                r = self.residual(y, tau)
                if not np.all(np.isfinite(r)):
                    return None
                try:
                    d = np.linalg.solve(self.matrix(y, tau), -r)
                except np.linalg.LinAlgError:
                    return None
            y = y + d
            first = float(np.linalg.norm(d)) if first is None else first
            # Differences of configurations are rounded: velocities no better than this.
            if np.linalg.norm(d) < 1e-9 * (1.0 + np.linalg.norm(y)) + 1e-14 / tau:
                return y, first
        return None


def follow(vi: MidpointVI, q1: Array, p1: Array, u: Array, dt: float, parts: int = 60) -> tuple[Array, float] | None:
    """Return the next configuration and s, or None where the path ends before the time step does."""
    path = _Path(vi, q1, p1, u, dt)
    nd = vi.mechanism.nd
    tau = _LEAST * dt
    limit = path.correct(np.zeros(nd + vi.mechanism.nc), tau)
    assert limit is not None
    y, slope, size = limit[0], 0.0 * limit[0], dt / parts
    start = np.linalg.det(path.matrix(y, tau))
    s = 1.0
    while tau < dt:
        to = dt if tau + size > dt * (1.0 - 1e-9) else tau + size
        found = path.correct(y + slope * (to - tau), to)
        if found is not None:
            new, first = found
            with np.errstate(all="ignore"):
                s = float(start / np.linalg.det(path.matrix(new, to)))
            if s > 0.0 and first < 0.05 * (1.0 + np.linalg.norm(y[:nd])):
                slope, y, tau = (new - y) / (to - tau), new, to
                size = min(1.3 * size, dt / parts)
                continue
        size *= 0.5
        if size < _LEAST * dt:
            return None
    return q1 + dt * y[:nd], s
