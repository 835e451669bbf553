"""The state of a rig by noisy readings of its dynamic variables: an extended Kalman filter."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from leastaction.errors import StepError
from leastaction.numerics.arrays import Array
from leastaction.systems.midpoint import MidpointSystem

_SURPRISE = 0.5  # m/s^2 or rad/s^2, with which the estimate reckons beside what the model says
_UNSURE = 0.1  # m, rad, m/s or rad/s: how far off the start may be
_LEAST_NOISE = 1e-6  # m or rad


class Estimator:
    """An extended Kalman filter: the model's steps, linearised about the estimate itself. For one thread at a time.

    About the estimate, because a string that is slack there moves nothing, whatever was planned.

    The momenta that chance adds have covariances in proportion to the mass matrix, as if each direction got the same
    energy: whatever the variables. Accelerations of the same size for each variable would be huge forces where angles
    are singular and hardly any where they are not, and the filter would take noise for motion.

    Parameters
    ----------
    model : MidpointSystem
    x : ndarray, shape (nx,)
        Where it is believed to begin.
    noise : float
        Standard deviation of the readings.
    """

    def __init__(self, model: MidpointSystem, x: Array, noise: float) -> None:
        self.model, self.x = model, x
        m = model.mechanism
        # What is off at the start keeps to the constraints.
        directions = _UNSURE * model.start_directions(x, [*m.dynamic, *(f"p_{name}" for name in m.dynamic)])
        self.P = directions @ directions.T
        self.V = max(noise, _LEAST_NOISE) ** 2 * np.eye(m.nd)

    def advance(self, k: int, u: Array, after: Array) -> None:
        """Go on over step k with what was commanded (nu,), which leads to the state ``after`` (nx,)."""
        m, dt = self.model.mechanism, self.model.t[k + 1] - self.model.t[k]
        mass = m.mass_matrix(np.ascontiguousarray(self.x[: m.nq]))[: m.nd, : m.nd]
        with suppress(StepError):  # where the model has no such step, what is known stays as it is
            A, _ = self.model.derivatives(self.x, u, k)
            P = A @ self.P @ A.T
            self.P = 0.5 * (P + P.T)
        self.x = after
        momenta = slice(m.nq, m.nq + m.nd)
        self.P[momenta, momenta] += np.mean(np.diagonal(mass)) * (_SURPRISE * dt) ** 2 * mass

    def read(self, reading: Array) -> None:
        """Make use of a reading (nd,) of the dynamic variables."""
        nd = len(reading)
        gain = np.linalg.solve(self.P[:nd, :nd] + self.V, self.P[:nd]).T
        self.x = self.x + gain @ (reading - self.x[:nd])
        self.P = self.P - gain @ self.P[:nd]
